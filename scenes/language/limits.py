"""Numbers that several parts of the program go by; imports nothing, so that `--help` stays quick."""

MOVIE_S = 30.0
"""Longer runs are animated up to here [s]."""
