"""`worm3d fit`: keys of a scene that make a simulation follow a measurement, and how well the data determine them."""
