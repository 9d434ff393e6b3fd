"""`worm3d fit`: fit keys of a scene to a measurement, and determine the uncertainty of the fitted values."""
