"""Colours of shortened, resting and lengthened chambers, the same in all pictures of 3D and planar worms."""

SHORT_CHAMBER = (0.78, 0.12, 0.16)
RESTING_CHAMBER = (0.96, 0.80, 0.69)
LONG_CHAMBER = (0.14, 0.36, 0.78)

RAMP = (SHORT_CHAMBER, RESTING_CHAMBER, LONG_CHAMBER)
"""Colours (red, green, blue) of chambers, from the shortest to the longest."""
