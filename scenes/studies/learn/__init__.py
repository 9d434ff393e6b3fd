"""`worm3d learn`: training of a policy that controls a worm, by reinforcement learning on many worms at once."""
