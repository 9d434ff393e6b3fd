"""Planar models of the paper's worm robot: `published` reproduces the results, `linkage` has the corrected physics.

The package is an independent reference for the tests of the 3D worm. From `worm3d` it imports the checks of arguments
(`worm3d.values`) and the compilation of functions (`worm3d.machine.compiled`), but no formula.
"""
