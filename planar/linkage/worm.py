"""The corrected planar worm: parameters, rest shape, and the weight that would flatten the worm.

With the segment law "rhombus", segment i is a rhombus of four rigid links of length a (the paper's axial stiffness
k_link is infinite here). Its diagonal l_i lies between two joints of the chain. Half of the other diagonal, between the
apexes, is h_i = sqrt(a^2 - l_i^2/4), so that (2 h)^2 + l^2 = (2 a)^2. A segment that shortens becomes wider. Segments
with another law (`planar.linkage.segment_law`) have no links.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from planar.linkage.learned import Learned
from planar.linkage.segment_law import HYDROSTAT, LEARNED, RHOMBUS, SegmentLaw, values
from planar.linkage.shape import hinge_angles
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter, parameters_of
from worm3d.values.read_only import ReadOnly

MOST_SEGMENTS = 10_000
"""Largest number of segments, which limits the memory of a step."""


@documented
@dataclass(frozen=True, eq=False)
class Linkage(ReadOnly):
    """A chain of N segments in the plane (x, z). Instances are validated and cannot be changed.

    `segment` is the segment law: "rhombus" (the default), "hydrostat", the path of the file of a learned law, or a
    `planar.linkage.Learned`. With a learned law, `length`, `half_height` and `k_spring` follow from the file if they
    have their default values; other values must agree with the file. Only a rhombus has apex hinges.
    """

    segments: int = parameter(6, "number of segments, N", ge=1, le=MOST_SEGMENTS, aka=("n", "n_segments"))
    length: float = parameter(1.0, "length at rest; segments are equally long, l0 = length / N", "m", gt=0)
    half_height: float | FloatArray | None = parameter(
        None,
        "rest half-height h0 of a rhombus",
        "m",
        gt=0,
        each="segment",
        aka=("h0_m",),
        left_out="sqrt(3)/4 of a segment's length, as in the paper",
    )
    density: float = parameter(10.0, "mass per rest area and depth", "kg/m^3", gt=0)
    depth: float = parameter(0.1, "depth across the plane, for the mass", "m", gt=0)
    mass: float | None = parameter(None, "mass of the whole worm", "kg", gt=0, left_out="density x rest area x depth")
    apex_mass_fraction: float = parameter(
        0.5,
        "share of the mass on the apexes, equally; the rest is on the joints, half as much on each end joint",
        ge=0,
        le=1,
    )
    k_spring: float | FloatArray = parameter(
        13.0, "stiffness k of a segment's spring, (P7)", "N", gt=0, each="segment", key="spring_N"
    )
    k_torsion: float | FloatArray = parameter(
        1e4, "torsional stiffness between neighbouring segments, (P6)", "J", ge=0, each="joint", key="torsion_J"
    )
    cross0: float | FloatArray = parameter(0.0, "rest value of the cross product in (P6)", gt=-1, lt=1, each="joint")
    k_apex: float | FloatArray = parameter(
        0.12,
        "torsional stiffness of each of the two apex hinges of a rhombus",
        "N m/rad",
        ge=0,
        each="segment",
        key="apex_hinge_N_m_rad",
    )
    kelvin_voigt_time: float = parameter(0.05, "damping of every strain divided by the stiffness", "s", ge=0)
    drag: float = parameter(
        0.0,
        "viscous medium, (P8): force on the whole worm over speed; an end joint has half the share of another joint",
        "N s/m",
        ge=0,
    )
    segment: str | os.PathLike[str] | Learned = "rhombus"

    def __post_init__(self) -> None:
        n = arguments.whole("segments", self.segments, le=MOST_SEGMENTS)
        check(self, segment=n, joint=n - 1)
        object.__setattr__(self, "segment", _segment(self.segment))
        if not self.has_links:
            self._follow("k_apex", 0.0, "0: only a rhombus has apex hinges")
        if isinstance(self.segment, Learned):
            law, why = self.segment, "in the file of the segment law"
            self._follow("length", n * law.rest_length, f"{n * law.rest_length:.9g} m, {n} times the rest length {why}")
            self._follow("half_height", law.rest_radius, f"{law.rest_radius:.9g} m, the radius at rest {why}")
            self._follow("k_spring", law.stiffness, f"{law.stiffness:.9g} N, the stiffness {why}")
        if self.half_height is None:
            half_height = np.full(n, np.sqrt(3.0) / 4.0 * self.l0)
            half_height.setflags(write=False)
            object.__setattr__(self, "half_height", half_height)
        if self.mass is None:
            area = float(self.l0 * np.sum(self.rest_half_height))
            object.__setattr__(self, "mass", arguments.number("mass", self.density * area * self.depth, "kg", gt=0.0))

    def _follow(self, name: str, value: float, allowed: str) -> None:
        """Set a parameter that the segment law determines. It must have this value, or its default value."""
        known, given = parameters_of(type(self))[name], getattr(self, name)
        if given is not None and not (np.all(given == known.default) or np.allclose(given, value, rtol=1e-9, atol=0.0)):
            raise ValueError(f"{name}: got {given}, must be left out or be {allowed}")
        implied = arguments.array(name, value, (self.segments,), fill=True) if known.each else value
        object.__setattr__(self, name, implied)

    @property
    def has_links(self) -> bool:
        """Whether the segments are rhombi of links."""
        return self.segment == "rhombus"

    @property
    def segment_law(self) -> SegmentLaw:
        """Segment law as constants for the compiled functions."""
        sizes = self.l0, np.asarray(self.k_spring), self.link_length, np.asarray(self.half_height, dtype=float)
        if isinstance(self.segment, Learned):
            return SegmentLaw(LEARNED, *sizes, self.segment.scales, self.segment.energy, self.segment.radius)
        nothing = np.zeros(0)
        return SegmentLaw(RHOMBUS if self.has_links else HYDROSTAT, *sizes, nothing, nothing, nothing)

    @property
    def possible_lengths(self) -> tuple[FloatArray, FloatArray, str]:
        """Exclusive limits of the lengths of the segments, each of shape (N,) [m], and their reason in words."""
        nothing = np.zeros(self.segments)
        if isinstance(self.segment, Learned):
            low, high = self.segment.lengths
            return nothing + low, nothing + high, "the domain of the segment law"
        if self.has_links:
            return nothing, 2.0 * self.link_length, "twice the length of its links"
        return nothing, nothing + np.inf, "as any length of a hydrostat"

    @property
    def l0(self) -> float:
        """Rest length of a segment [m]."""
        return self.length / self.segments

    @property
    def rest_half_height(self) -> FloatArray:
        """Rest half-height h0 of each segment, shape (N,) [m]. For a learned law, this is the value of the network."""
        if isinstance(self.segment, Learned):
            return values(np.full(self.segments, self.l0), self.l0, self.segment_law).height
        return np.asarray(self.half_height, dtype=float)

    @property
    def link_length(self) -> FloatArray:
        """Length a of the links of each rhombus, shape (N,) [m]."""
        return np.asarray(np.sqrt(np.asarray(self.half_height, dtype=float) ** 2 + self.l0**2 / 4.0))

    @property
    def rest_angle(self) -> FloatArray:
        """Angle of the apex hinges at rest, shape (N,) [rad]."""
        return hinge_angles(np.full(self.segments, self.l0), self.link_length)

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
    def joint_drag(self) -> FloatArray:
        """Viscous drag (P8) on each joint, shape (N+1,) [N s/m]."""
        drag = np.full(self.segments + 1, self.drag / self.segments)
        drag[[0, -1]] /= 2.0
        return drag

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
        return replace(self, **changes)  # type: ignore[arg-type]

    def flattening_weight(self, contraction: float = 0.0) -> FloatArray:
        """Return the weight on each segment's bottom apex that flattens the segment (limit point), shape (N,) [N].

        A segment that stands on its bottom apex has its joints at the height h and its top apex at 2 h. Since
        dh/dl = -l/(4 h), the segment carries the load w in equilibrium if dE/dl = w l/(4 h), where E is the elastic
        energy of the segment. The limit point is the largest w for which this equation has a solution in
        l_cmd < l < 2 a. Under a larger load the rhombus collapses. `contraction` is the command to all segments.

        The weight is infinite for segments without links. A hydrostat carries any weight, and a run with a learned law
        ends if a segment leaves the domain of the law.
        """
        if not self.has_links:
            return np.full(self.segments, np.inf)
        shapes = zip(np.asarray(self.k_spring), np.asarray(self.k_apex), self.link_length, strict=True)
        return np.array([self._limit_point(*shape, contraction) for shape in shapes])

    def _limit_point(self, k: float, k_apex: float, a: float, contraction: float) -> float:
        l0, l_cmd = self.l0, self.l0 * (1.0 - contraction)

        def weight(length: FloatArray) -> FloatArray:
            h = np.sqrt(a**2 - length**2 / 4.0)
            hinge = 2.0 * k_apex * 2.0 * (np.arcsin(length / (2 * a)) - np.arcsin(l0 / (2 * a))) / h
            tension = -k * l0 / l_cmd * (1.0 - length / l_cmd) + hinge
            return np.asarray(tension * 4.0 * h / length)

        low, high = l_cmd, 2 * a * (1 - 1e-12)
        for _ in range(5):  # each round searches between the two neighbours of the best length so far
            place = np.linspace(low, high, 65)
            carried = weight(place)
            best = int(np.argmax(carried))
            low, high = place[max(best - 1, 0)], place[min(best + 1, 64)]
        return float(carried[best])

    def apex_load(self, gravity: float = 9.81) -> FloatArray:
        """Return the load of each rhombus under its own weight, shape (N,) [N], for `flattening_weight`.

        When the rhombus is pressed flat, the top apex sinks twice as far as the joints. Therefore the weight of the top
        apex counts twice.
        """
        joints = (self.joint_mass[:-1] + self.joint_mass[1:]) / 2.0
        ends = np.zeros(self.segments)
        ends[0] += self.joint_mass[0] / 2.0
        ends[-1] += self.joint_mass[-1] / 2.0
        return np.asarray(gravity * (joints + ends + 2.0 * self.apex_mass[:, 1]))


def _segment(given: str | os.PathLike[str] | Learned) -> str | Learned:
    """Return a segment law as the word of its kind, or as the content of its file."""
    if isinstance(given, Learned) or (isinstance(given, str) and given in ("rhombus", "hydrostat")):
        return given
    kinds = "'rhombus', 'hydrostat', the path of a file, or a planar.linkage.Learned"
    return Learned.read(arguments.instance("segment", given, str | os.PathLike, kinds))
