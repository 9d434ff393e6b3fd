"""Scene files, programs that run and study them, and the command line `worm3d`."""
