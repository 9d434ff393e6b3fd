"""`worm3d study identify`: run the plant to find out how a worm crawls and turns."""
