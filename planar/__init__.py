"""Planar models of the worm robot of the paper: `published`, its results number for number; `linkage`, put right.

Stands alone, so that it can judge the other packages: of these it imports only how arguments are checked
(`worm3d.values`) and functions compiled (`worm3d.machine.compiled`), no formula.
"""
