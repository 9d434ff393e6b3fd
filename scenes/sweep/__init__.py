"""Sweeps: many runs of one scene with varied keys; each case has a file, so that finished cases are never lost."""
