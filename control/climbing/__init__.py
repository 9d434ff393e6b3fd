"""Climbing between walls that enclose the worm: detection of the walls, gait, pace and controller."""
