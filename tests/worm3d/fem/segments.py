"""Segments that several test files share. Import it only where scikit-fem is installed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from worm3d.fem.description import Cylinder, Load, Profile, Segment
from worm3d.fem.material import NeoHookean
from worm3d.values.arrays import FloatArray

MU = 1e5
"""Shear modulus of the test rubber [Pa]."""


def tube(radius: float = 0.03, thickness: float = 0.01, length: float = 0.1, **others: Any) -> Segment:
    """Return a neo-Hookean tube under pressure."""
    parts = {"rubber": NeoHookean(shear_modulus_Pa=MU), "load": Load(values=(0.0, 1e4)), **others}
    return Segment(profile=Cylinder(length_m=length, radius_m=radius), thickness_m=thickness, **parts)


class Quarter(Profile):
    """Meridian of a sphere, from the equator to the pole."""

    def __init__(self, radius: float) -> None:
        self.radius, self.length_m = radius, 2.0 * radius

    def meridian(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = np.asarray(s) * np.pi / 2.0
        outward = np.stack([np.cos(angle), np.sin(angle)])
        outward[0, np.asarray(s) == 1.0] = 0.0
        return self.radius * outward, np.stack([-np.sin(angle), np.cos(angle)])


class Closed(Segment):
    """Segment without plates, whose profile ends on the axis; use it with `held="r"`."""

    def __post_init__(self) -> None:
        """Accept a profile that reaches the axis."""


def sphere(radius: float = 0.05, thickness: float = 0.001) -> Segment:
    """Return a neo-Hookean sphere under pressure."""
    rubber, load = NeoHookean(shear_modulus_Pa=MU), Load(values=(0.0, 1e4))
    return Closed(profile=Quarter(radius), thickness_m=thickness, rubber=rubber, load=load)


def cable(segment: Segment) -> Segment:
    """Return the segment with a cable along the axis in place of the pressure."""
    return replace(segment, load=Load(input="cable_N", values=(0.0, 5.0)))
