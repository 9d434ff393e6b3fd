"""Actuator technologies: one law, and the numbers of the technologies used in worm robots."""
