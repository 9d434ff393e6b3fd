"""`worm3d study gait`: fit the delays of a chain of neurons to recordings of crawling animals."""
