"""Faults of a run: what measurements show of them, and faults that are put in on purpose."""
