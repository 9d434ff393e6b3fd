"""A plain part of Python, compiled."""
