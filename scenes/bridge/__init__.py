"""Robots: a simulated robot as a separate process, and runs of a scene's controller on a robot."""
