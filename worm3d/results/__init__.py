"""Results of runs: measured, kept in files, and drawn."""
