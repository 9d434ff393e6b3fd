"""The same worm in other units: its parameters and worlds, rescaled in length, mass and time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from worm3d import Bend, Centreline, Heightfield, Pipe, Plane, Profile, State, Straight, Worm, simulate
from worm3d.results.result import Result
from worm3d.values.parameters import PARAMETER
from worm3d.worlds import Groove, Union, World

Part = TypeVar("Part")

DIMENSIONS = {
    "m": (1, 0, 0),
    "m^3": (3, 0, 0),
    "kg": (0, 1, 0),
    "s": (0, 0, 1),
    "1/s": (0, 0, -1),
    "s/m": (-1, 0, 1),
    "N": (1, 1, -2),
    "J": (2, 1, -2),
    "N m": (2, 1, -2),
    "N m/rad": (2, 1, -2),
    "N s/m": (0, 1, -1),
    "Pa": (-1, 1, -2),
    "kg/(s Pa)": (1, 0, 1),
    "J/(kg K)": (2, 0, -2),
    "K": (0, 0, 0),
    "rad": (0, 0, 0),
    "": (0, 0, 0),
}
"""Powers of length, mass and time in each unit."""


@dataclass(frozen=True)
class Scales:
    """Factors of length, mass and time."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def of(self, unit: str) -> float:
        """Return the factor of a quantity with this unit."""
        metres, kilograms, seconds = DIMENSIONS[unit]
        return self.length**metres * self.mass**kilograms * self.time**seconds

    def part(self, it: Part) -> Part:
        """Return a worm or one of its parts in these units; each parameter names its own."""
        changed = {}
        for each in dataclasses.fields(it):  # type: ignore[arg-type]
            value, known = getattr(it, each.name), each.metadata.get(PARAMETER)
            if dataclasses.is_dataclass(value):
                changed[each.name] = self.part(value)
            elif known is not None and value is not None and known.hint is not bool:
                factor = self.of(known.unit)
                changed[each.name] = value if factor == 1.0 else np.asarray(value) * factor
        numbers = {
            name: value.item() if np.ndim(value) == 0 and isinstance(value, np.ndarray | np.generic) else value
            for name, value in changed.items()
        }
        return dataclasses.replace(it, **numbers)  # type: ignore[type-var]


def _pipe(bend: float, radius: float, towards: Any = "left", tilt: float = 0.0) -> Callable[[float], World]:
    def made(size: float) -> World:
        pieces = [Straight(1.2 * size), Bend(bend, 0.48 * size, towards), Straight(1.2 * size)]
        return Pipe(Centreline.of(pieces, tilt=tilt), radius * size)

    return made


def _hill(size: float) -> World:
    x, y = np.arange(0.0, 4.01, 0.05), np.arange(-1.0, 1.01, 0.05)
    heights = 0.1 * x[:, None] + 0.01 * np.sin(6.0 * x)[:, None] * np.cos(6.0 * y)
    return Heightfield(size * heights, 0.05 * size, origin=(0.0, -size))


def _sampled(size: float) -> World:
    def distance(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T / size
        return size * (z - 0.01 * np.sin(4.0 * x) * np.cos(5.0 * y))

    return World.from_distance(distance, size * np.array([[-0.5, -0.5, -0.1], [1.6, 0.5, 0.3]]), 0.04 * size)


WORLDS: dict[str, tuple[Callable[[float], World], float]] = {
    "plane": (lambda size: Plane(), 0.0),
    "slope": (lambda size: Plane(0.3, 0.5), 0.0),
    "groove": (lambda size: Groove(0.6, 0.1 * size), 0.0),
    "rubble": (
        lambda size: Heightfield.rubble(4.0 * size, 2.0 * size, 0.02 * size, height=0.03 * size, size=0.15 * size),
        1.7,
    ),
    "hill": (_hill, 1.5),
    "sampled": (_sampled, 0.0),
    "bend": (_pipe(np.pi / 2, 0.12), 0.9),
    "uphill": (_pipe(np.pi / 3, 0.1, "up"), 0.9),
    "narrowing": (
        lambda size: Pipe(
            Centreline.of([Straight(3.0 * size)]), Profile([0.3 * size, 0.6 * size], [0.12 * size, 0.1 * size])
        ),
        0.0,
    ),
    "steep": (lambda size: Pipe(Centreline.of([Straight(3.0 * size)], tilt=np.pi / 2), 0.092 * size), 0.0),
    "mouth": (lambda size: Union([Plane(), Pipe(Centreline.of([Straight(3.0 * size)]), 0.12 * size)]), 0.0),
}
"""Worlds of any size, and where along them the tail is put, each times the size in metres."""


def run(name: str, worm: Worm, scales: Scales, steps: int = 1, **more: Any) -> Result:
    """Return a run of a worm in other units on a world of `WORLDS`; `more` is that of `simulate`, in the old units."""
    make, place = WORLDS[name]
    world, scaled = make(scales.length), scales.part(worm)
    contraction = 0.2 if name == "steep" else 0.0
    state = State.straight(scaled, world, position=(place * scales.length, 0.0), contraction=contraction)
    gravity = more.pop("gravity", 9.81) * scales.length / scales.time**2
    dt = 0.01 * scales.time
    return simulate(scaled, world, gravity=(0.0, 0.0, -gravity), state=state, duration=steps * dt, dt=dt, **more)
