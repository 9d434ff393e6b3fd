"""The corrected planar worm: its parameters, its rest shape, and the weight that would flatten it.

Segment i is a rhombic four-bar linkage with rigid links of length a (their axial stiffness k_link is infinite) on the
horizontal diagonal l_i; half of its vertical diagonal is h_i = sqrt(a^2 - l_i^2/4), so that (2 h)^2 + l^2 = (2 a)^2.
An active segment shortens and thereby widens.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

MOST_SEGMENTS = 10_000
"""Memory of a step, as of a run, is taken for each."""

PER_SEGMENT = ("k_spring", "k_apex", "half_height")
PER_JOINT = ("k_torsion", "cross0")
_RANGES: dict[str, dict[str, Any]] = {
    **{name: {"gt": 0.0} for name in ("k_spring", "half_height")},
    **{name: {"ge": 0.0} for name in ("k_apex", "k_torsion")},
    "cross0": {"gt": -1.0, "lt": 1.0},
}


@dataclass(frozen=True, eq=False)
class Linkage(ReadOnly):
    """A chain of N rhombic linkages in the plane (x, z); frozen, validated, with read-only arrays.

    Attributes
    ----------
    segments : int
        N, at least 1.
    length : float
        Rest length of the body [m]; segments are equally long, l0 = length / N.
    half_height : float or ndarray, shape (N,)
        Rest half-height h0 of each rhombus [m]; sqrt(3)/4 l0 (the paper's) if left out.
    density, depth : float
        Mass = density [kg/m^3] x rest area of the rhombi x depth [m].
    mass : float
        Total mass [kg]; density and depth decide if left out.
    apex_mass_fraction : float
        Share of the mass on the apexes, equally; the rest is on the joints, shared like rod nodes (the ends
        half as much). In [0, 1].
    k_spring : float or ndarray, shape (N,)
        Stiffness of the horizontal spring in (P7) [N].
    k_torsion : float or ndarray, shape (N-1,)
        Stiffness between neighbouring segments in (P6) [J].
    cross0 : float or ndarray, shape (N-1,)
        Rest value of the cross product in (P6).
    k_apex : float or ndarray, shape (N,)
        Stiffness of each of the two apex hinges of a rhombus, on its angle [N m/rad].
    kelvin_voigt_time : float
        Damping of every strain: its coefficient is this time [s] x the stiffness of that strain.
    drag : float
        Viscous medium (P8): force over speed of the whole worm [N s/m], shared over the joints like their mass.
    """

    segments: int = 6
    length: float = 1.0
    half_height: float | FloatArray | None = None
    density: float = 10.0
    depth: float = 0.1
    mass: float | None = None
    apex_mass_fraction: float = 0.5
    k_spring: float | FloatArray = 13.0
    k_torsion: float | FloatArray = 1e4
    cross0: float | FloatArray = 0.0
    k_apex: float | FloatArray = 0.12
    kelvin_voigt_time: float = 0.05
    drag: float = 0.0

    def __post_init__(self) -> None:
        arguments.whole("segments", self.segments, le=MOST_SEGMENTS)
        for name in ("length", "density", "depth"):
            arguments.number(name, getattr(self, name), gt=0.0)
        if self.half_height is None:
            object.__setattr__(self, "half_height", np.sqrt(3.0) / 4.0 * self.l0)
        for names, size in ((PER_SEGMENT, self.segments), (PER_JOINT, self.segments - 1)):
            for name in names:
                array = arguments.array(name, getattr(self, name), (size,), fill=True, **_RANGES[name])
                object.__setattr__(self, name, array)
        if self.mass is None:
            area = float(self.l0 * np.sum(self.rest_half_height))
            object.__setattr__(self, "mass", self.density * area * self.depth)
        arguments.number("mass", self.mass, gt=0.0)
        for name in ("kelvin_voigt_time", "drag"):
            arguments.number(name, getattr(self, name), ge=0.0)
        arguments.number("apex_mass_fraction", self.apex_mass_fraction, ge=0.0, le=1.0)

    @property
    def l0(self) -> float:
        """Rest length of a segment [m]."""
        return self.length / self.segments

    @property
    def rest_half_height(self) -> FloatArray:
        """Rest half-height h0 of each rhombus, shape (N,) [m]."""
        return np.asarray(self.half_height, dtype=float)

    @property
    def link_length(self) -> FloatArray:
        """Length a of the links of each segment, shape (N,) [m]."""
        length: FloatArray = np.sqrt(self.rest_half_height**2 + self.l0**2 / 4.0)
        return length

    @property
    def total_mass(self) -> float:
        """Mass of the worm [kg]."""
        assert self.mass is not None
        return self.mass

    @property
    def joint_mass(self) -> FloatArray:
        """Mass of each joint, shape (N+1,) [kg]."""
        mass = np.full(self.segments + 1, (1.0 - self.apex_mass_fraction) * self.total_mass / self.segments)
        mass[[0, -1]] /= 2.0
        return mass

    @property
    def apex_mass(self) -> FloatArray:
        """Mass of each apex [bottom, top], shape (N, 2) [kg]."""
        return np.full((self.segments, 2), self.apex_mass_fraction * self.total_mass / (2 * self.segments))

    def rest(self) -> FloatArray:
        """Return the straight rest shape with joint 0 at the origin, shape (N+1, 2) [m]."""
        x = np.arange(self.segments + 1) * self.l0
        return np.column_stack([x, np.zeros_like(x)])

    def with_changes(self, **changes: object) -> Linkage:
        """Return a copy with some parameters changed."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        return Linkage(**{**given, **changes})

    def flattening_weight(self, contraction: float = 0.0) -> FloatArray:
        """Return the weight on each segment's bottom apex that flattens it (limit point), shape (N,) [N].

        A segment that carries the vertical load w on its apexes (joints at height h, top apex at 2 h) is in
        equilibrium where dE/dl = w l/(4 h), since dh/dl = -l/(4 h). The greatest w with a solution in
        l < l < 2 a is the limit point: any more and the rhombus collapses.

        Parameters
        ----------
        contraction : float
            Common contraction of all segments.
        """
        shapes = zip(np.asarray(self.k_spring), np.asarray(self.k_apex), self.link_length, strict=True)
        return np.array([self._limit_point(*shape, contraction) for shape in shapes])

    def _limit_point(self, k: float, k_apex: float, a: float, contraction: float) -> float:
        l0, l_cmd = self.l0, self.l0 * (1.0 - contraction)

        def weight(length: FloatArray) -> FloatArray:
            h = np.sqrt(a**2 - length**2 / 4.0)
            hinge = 2.0 * k_apex * 2.0 * (np.arcsin(length / (2 * a)) - np.arcsin(l0 / (2 * a))) / h
            tension = -k * l0 / l_cmd * (1.0 - length / l_cmd) + hinge
            carried: FloatArray = tension * 4.0 * h / length
            return carried

        low, high = l_cmd, 2 * a * (1 - 1e-12)
        for _ in range(5):  # each time between the neighbours of the best: to 1e-7 of the length
            place = np.linspace(low, high, 65)
            carried = weight(place)
            best = int(np.argmax(carried))
            low, high = place[max(best - 1, 0)], place[min(best + 1, 64)]
        return float(carried[best])

    def apex_load(self, gravity: float = 9.81) -> FloatArray:
        """Return the weight that each rhombus has to hold up if all share it, shape (N,) [N].

        The joints hang on it with once, the top apex with twice their height.
        """
        joints = (self.joint_mass[:-1] + self.joint_mass[1:]) / 2.0
        ends = np.zeros(self.segments)
        ends[0] += self.joint_mass[0] / 2.0
        ends[-1] += self.joint_mass[-1] / 2.0
        load: FloatArray = gravity * (joints + ends + 2.0 * self.apex_mass[:, 1])
        return load
