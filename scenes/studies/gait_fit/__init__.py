"""`worm3d gait fit`: a chain of neurons whose waves are timed as those of recorded animals."""
