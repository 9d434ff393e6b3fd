"""Estimation of the worm's place, heading and drift from measurements."""
