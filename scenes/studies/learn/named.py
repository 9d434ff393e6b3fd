"""Environments with a name: tasks of a worm, each with new random values in every episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

NAMESPACE = "worm3d"
"""Namespace of the names in Gymnasium: "worm3d/PathFollow-v0"."""


@dataclass(frozen=True)
class Named:
    """A task with a name."""

    scene: str
    """Scene from `worm3d list`."""
    vary: Mapping[str, str]
    """Keys that have a random value in each episode, with their ranges."""
    overrides: Sequence[str] = field(default=())
    """Changes of the scene, each of the form `section.key=value`."""


NAMED: Mapping[str, Named] = MappingProxyType(
    {
        "PathFollow-v0": Named(
            "path_s_curve",
            {
                "reference.amplitude_m": "0.05:0.6",
                "reference.wavelength_m": "3:7",
                "reference.speed_m_s": "0.05:0.1",
                "reference.towards": "left,right",
            },
        ),
        "Velocity-v0": Named(
            "velocity_sine",
            {
                "reference.speed_m_s": "0.05:0.08",
                "reference.speed_sine_m_s": "0:0.02",
                "reference.speed_sine_period_s": "15:40",
            },
        ),
        "Pipe-v0": Named("velocity_pipe", {"world.radius_m": "0.11:0.14", "reference.speed_m_s": "0.04:0.07"}),
        # On descents above 1.7 degrees, a worm with the forward friction of the scene slides down.
        "Slope-v0": Named("path_s_curve_slope", {"world.slope_deg": "-1.5:3", "world.heading_deg": "-60:60"}),
        "Terrain-v0": Named(
            "path_line",
            {"world.stones": "0:1000000", "world.height_m": "0.005:0.02"},
            (
                *("world.kind=heightfield", "world.surface=rubble", "world.spacing_m=0.02", "world.extent_m=[6.0,2.0]"),
                *("world.size_m=0.15", "start.position_m=[0.4,0.0]"),
            ),
        ),
    }
)
"""Environments by their names without namespace."""


def named(name: str) -> Named | None:
    """Return the environment with a name such as "worm3d/Slope-v0", or None if there is no such name."""
    space, _, rest = name.partition("/")
    return NAMED.get(rest) if space == NAMESPACE else None
