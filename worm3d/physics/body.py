"""Sizes, masses, stiffnesses and strokes of a worm.

Some parameters may be an array with a number for each segment or for each joint between segments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worm3d.physics.part import Numbers
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, parameter
from worm3d.values.read_only import ReadOnly

MOST_SEGMENTS = 1000
"""Maximum number of segments. Worms with more segments do not settle on their world."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Body(ReadOnly):
    """The body of a worm: a chain of N rhombic linkages, without actuators. Segment 0 and joint 0 are at the tail."""

    segments: int = parameter(
        6, "number of segments, N", ge=1, le=MOST_SEGMENTS, key="segments", aka=("n", "n_segments")
    )
    length: float = parameter(1.0, "length at rest; segments are equally long, l0 = length / N", "m", gt=0)
    mass: float = parameter(0.1, "mass of the whole worm", "kg", gt=0)
    joint_mass_fraction: float = parameter(
        0.5,
        "share of the mass on the joints, with half as much on an end joint; the rest is on the apexes",
        ge=0,
        le=1,
    )
    payload: float = parameter(
        0.0,
        "part of the mass that is on the joint at the head in addition to its share, such as a camera or a tool",
        "kg",
        ge=0,
        aka=("head_mass_kg",),
    )
    chamber_offset: float = parameter(0.03, "distance b of the chambers from the centre line", "m", ge=0, aka=("b_m",))
    half_height: Numbers = parameter(
        0.05,
        "rest half-height h0 of a chamber's rhombus; it determines the length a of the links, a^2 = h0^2 + l0^2/4",
        "m",
        gt=0,
        each="segment",
        aka=("h0_m",),
    )
    k_spring: Numbers = parameter(
        13.0, "stiffness k of a segment's springs, the sum of both chambers", "N", gt=0, each="segment", key="spring_N"
    )
    k_torsion: Numbers = parameter(
        10.0, "stiffness of a joint in pitch", "J", ge=0, each="joint", key="torsion_J", aka=("pitch_J",)
    )
    k_yaw: Numbers = parameter(0.5, "stiffness of a joint in yaw", "J", ge=0, each="joint", key="yaw_J")
    k_twist: Numbers = parameter(0.5, "stiffness of a joint in twist", "J", ge=0, each="joint", key="twist_J")
    cross0: Numbers = parameter(
        0.0,
        "rest value of the pitch, the cross product of successive tangents in the (x, z) plane (sine of an angle); "
        "positive bends the head up",
        gt=-1,
        lt=1,
        each="joint",
    )
    k_apex: Numbers = parameter(
        0.0,
        "torsional stiffness of an apex hinge of a segment, the sum of the left and the right chamber",
        "N m/rad",
        ge=0,
        each="segment",
        key="apex_hinge_N_m_rad",
    )
    kelvin_voigt_time: float = parameter(
        0.05, "ratio of damping coefficient and stiffness, the same for every strain", "s", ge=0
    )
    drag: float = parameter(
        0.0,
        "viscous medium: force on the whole worm over speed; an end joint has half the share of another joint",
        "N s/m",
        ge=0,
    )
    actuator_lag: float = parameter(0.1, "time constant of a chamber's first-order response to its command", "s", ge=0)
    stroke: tuple[float, float] = parameter(
        (-0.1, 0.45), "least and greatest contraction of a chamber, as a fraction of its length, below 1"
    )
    rate_limit: float = parameter(
        float("inf"), "greatest speed of contraction of a chamber", "1/s", gt=0, infinite=True, left_out="no limit"
    )
    outward_apexes: bool = parameter(True, "whether the outward apexes exist, i.e. have mass and touch the world")
    end_faces: bool = parameter(
        True,
        "whether the end faces (discs as high as the end segments at rest) and the joints between segments (as points) "
        "touch the world",
    )

    def __post_init__(self) -> None:
        n = arguments.whole("segments", self.segments, le=MOST_SEGMENTS)
        check(self, segment=n, joint=n - 1)
        object.__setattr__(self, "stroke", _stroke(self.stroke))
        if self.payload >= self.mass:
            raise ValueError(
                f"payload: got {self.payload!r} kg, must be below mass ({self.mass!r} kg), which includes the payload"
            )

    @property
    def l0(self) -> float:
        """Rest length of a segment [m]."""
        return self.length / self.segments

    @property
    def link_length(self) -> FloatArray:
        """Length a of the links of each segment, shape (N,) [m]."""
        length: FloatArray = np.sqrt(np.asarray(self.half_height) ** 2 + self.l0**2 / 4.0)
        return length

    @property
    def joint_mass(self) -> FloatArray:
        """Mass of each joint, shape (N+1,) [kg]."""
        mass = np.full(self.segments + 1, self.joint_mass_fraction * (self.mass - self.payload) / self.segments)
        mass[[0, -1]] /= 2.0
        mass[-1] += self.payload
        return mass

    @property
    def apex_mass(self) -> FloatArray:
        """Mass of each apex in the order of NOTATION.md, shape (N, 6) [kg]."""
        share = np.array([1.0, 1.0, float(self.outward_apexes)] * 2)
        each = (1.0 - self.joint_mass_fraction) * (self.mass - self.payload) / self.segments * share / share.sum()
        return np.full((self.segments, 6), each)


def _stroke(given: tuple[float, float]) -> tuple[float, float]:
    found = arguments.floats("stroke", given)
    if found.shape != (2,) or not (-arguments.MAX_MAGNITUDE <= found[0] <= 0.0 <= found[1] < 1.0):
        raise ValueError(
            f"stroke: got {arguments.shown(given)}, must be finite and (c_min, c_max) with c_min <= 0 <= c_max < 1"
        )
    return float(found[0]), float(found[1])
