"""Types of the data of a run: series, energy ledger, states, status, estimated errors.

`worm3d.solver.records` writes the data of a run.
"""
