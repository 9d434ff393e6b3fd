"""Actuator technologies: one law, and the numbers of those that worm robots are built with."""
