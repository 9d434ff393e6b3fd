"""Runs of a scene: their progress and end at a terminal, and their pictures."""
