"""Comparison of runs, cases of sweeps and measurements: `worm3d compare`."""
