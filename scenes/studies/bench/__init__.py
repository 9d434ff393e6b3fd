"""The benchmark of controllers, `worm3d bench control`."""
