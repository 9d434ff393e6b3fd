"""Gaits of worm robots (worm3d's package, not the distribution python-control)."""

DISTRIBUTION = "worm3d"
"""Tells this package from python-control's, which has the same import name."""
