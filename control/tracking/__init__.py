"""Paths and references that a worm follows, and metrics of how well it follows them."""
