"""Planar models of the worm robot of the paper: `published`, its results number for number; `linkage`, put right.

Stands alone: it imports nothing of the other packages, so that it can judge them.
"""
