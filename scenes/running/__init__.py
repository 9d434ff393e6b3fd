"""Runs of a scene: progress, report at a terminal, and pictures."""
