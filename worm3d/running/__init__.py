"""Runs of worms: their problem, actuation, start and steps, observers of a run, and experiments made of runs."""
