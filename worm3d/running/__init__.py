"""Runs of worms: problem, actuation, plant, settling, steps, observers, and experiments that consist of several runs.

The plant is a worm in its world, in the form of the solver's arrays.
"""
