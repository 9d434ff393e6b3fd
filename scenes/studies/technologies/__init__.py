"""`worm3d study technologies`: the worm of a scene on each actuator technology: speed, cost and limit."""
