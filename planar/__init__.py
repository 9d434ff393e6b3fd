"""Planar models of the worm-inspired robot of the paper: `published`, its results number for number.

Stands alone: it imports nothing of the other packages, so that it can judge them.
"""
