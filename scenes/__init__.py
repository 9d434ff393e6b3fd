"""Scene files, the runner, the experiments and the command line `worm3d`."""
