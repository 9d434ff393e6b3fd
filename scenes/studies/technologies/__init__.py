"""`worm3d study technologies`: the speed, cost and limit of the worm of a scene with each actuator technology."""
