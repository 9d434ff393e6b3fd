"""`worm3d fem`: tables of soft segments by finite elements."""
