"""The commands of `worm3d`."""
