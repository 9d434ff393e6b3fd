"""The actuators that come with worm3d, and the base classes of new actuators."""

from worm3d.physics.actuators import ACTUATORS, Actuator, FirstOrder, Response
from worm3d.physics.fill_and_vent import FillAndVent
from worm3d.physics.pneumatic import Pneumatic
from worm3d.physics.technologies.law import Technology
from worm3d.physics.technologies.presets import TECHNOLOGIES

__all__ = [
    "ACTUATORS",
    "TECHNOLOGIES",
    "Actuator",
    "FillAndVent",
    "FirstOrder",
    "Pneumatic",
    "Response",
    "Technology",
]
