"""Runs: what a worm is told and put on, the steps of a run, what looks on, and what runs worms to measure them."""
