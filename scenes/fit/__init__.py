"""`worm3d fit`: scene keys that make a simulation follow a measurement, and how well the data determine them."""



