"""Scene files, what runs and studies them, and the command line `worm3d`."""
