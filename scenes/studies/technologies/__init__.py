"""`worm3d technologies`: the worm of a scene on each actuator technology: speed, cost, and what limits it."""
