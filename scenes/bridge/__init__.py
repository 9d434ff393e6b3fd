"""Robots: a simulated robot as a process of its own, and runs of a scene's controller on a robot."""
