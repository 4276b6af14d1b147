"""Records of what was asked, fired and felt: their lines, reading them, what is made of them."""
