"""`worm3d study gait`: a chain of neurons whose waves are timed as those of recorded animals."""
