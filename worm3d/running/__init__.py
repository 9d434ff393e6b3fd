"""Runs of worms: problem, actuation, plant (the solver's arrays of a worm in its world), settling, steps, observers,
and experiments made of runs."""
