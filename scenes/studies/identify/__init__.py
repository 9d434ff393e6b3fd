"""`worm3d study identify`: simulate a worm to measure how its speed and turn depend on its gait."""
