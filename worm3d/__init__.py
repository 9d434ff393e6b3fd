"""The plant: what a worm robot is, and what it can be commanded to do."""

from worm3d.command import Command

__all__ = ["Command"]
