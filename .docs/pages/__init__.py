"""Generators of the pages of the reference; `reference.py` calls them."""
