"""Paths and references to follow, and the metrics of how well a run kept to them."""
