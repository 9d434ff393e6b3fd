"""Checks and types of the values that users pass and receive."""
