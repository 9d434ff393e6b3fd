"""The plant: what a worm robot is, and what it can be commanded to do."""

from worm3d.command import Command
from worm3d.worm import Worm

__all__ = ["Command", "Worm"]
