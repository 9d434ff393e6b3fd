"""The benchmark of controllers, `worm3d study control`."""
