"""`worm3d study gait`: a chain of neurons with the wave timing of recorded animals."""
