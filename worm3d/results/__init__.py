"""Results of runs, with their metrics, files and pictures. The package `worm3d.running` creates results."""
