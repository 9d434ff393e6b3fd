"""`worm3d optimise`: search for the best gait of a worm on a ground, and a card that says how far to trust the gait."""
