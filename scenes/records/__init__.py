"""Results of runs: records, measurements, their files, and the overview picture."""
