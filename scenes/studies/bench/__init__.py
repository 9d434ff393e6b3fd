"""Measurements of the program: speed of the 3D worm, quality of its controllers, accuracy of time steps."""
