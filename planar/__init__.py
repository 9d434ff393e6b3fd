"""Planar models of the paper's worm robot: `published` reproduces the results, `linkage` has the corrected physics.

The package stands alone as a reference for the other packages, and imports only the checks of arguments
(`worm3d.values`) and the compilation of functions (`worm3d.machine.compiled`), no formula.
"""
