"""Runs of worms: problem, actuation, plant, settling, steps, observers, and experiments made of runs.

The plant is a worm in its world as the arrays of the solver.
"""
