"""Types of the data of a run, declared once: series, energy ledger, states, status, estimated errors.

The recorder is `worm3d.solver.records`.
"""
