"""Runs, cases of sweeps and measurements laid over one another: `worm3d compare`."""
