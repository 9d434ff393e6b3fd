"""Actuators by name, and what a new one is made of; each class stands in `worm3d.physics`."""

from worm3d.physics.actuators import ACTUATORS, Actuator, FirstOrder, Response
from worm3d.physics.pneumatic import Pneumatic

__all__ = ["ACTUATORS", "Actuator", "FirstOrder", "Pneumatic", "Response"]
