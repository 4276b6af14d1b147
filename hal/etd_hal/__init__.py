"""The boundary to hardware. Knows nothing of frames, clients or people."""
