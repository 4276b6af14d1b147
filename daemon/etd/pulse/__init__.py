"""What everybody means by a pulse that is requested, and by what was measured of an electrode."""
