"""The worm's parameters: sizes, masses, stiffnesses and actuators; one value for all segments or one each."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from worm3d.physics.actuators import Actuator, FirstOrder
from worm3d.physics.hysteresis import Hysteresis
from worm3d.physics.media import Medium
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.read_only import ReadOnly
from worm3d.values.spelling import spelled

Numbers = float | FloatArray
"""A number, or one for each segment or joint."""

MOST_SEGMENTS = 1000
"""Largest number of segments: longer worms do not come to rest on their world."""


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Worm(ReadOnly):
    """A chain of N rhombic linkages with left and right chambers; frozen, validated, with read-only arrays.

    The defaults are the default worm of the project. Segment and joint 0 are the tail.

    Raises
    ------
    ValueError
        A value that is not finite or out of range, or an array of the wrong shape.
    """

    segments: int = parameter(
        6, meaning="number of segments, N", ge=1, le=MOST_SEGMENTS, key="segments", aka=("n", "n_segments")
    )
    length: float = parameter(1.0, meaning="length at rest; segments are equally long, l0 = length / N", unit="m", gt=0)
    mass: float = parameter(0.1, meaning="mass of the whole worm", unit="kg", gt=0)
    joint_mass_fraction: float = parameter(
        0.5,
        meaning="share of the mass on the joints, like rod nodes (the ends half as much); the rest is on the apexes",
        ge=0,
        le=1,
    )
    payload: float = parameter(
        0.0,
        meaning="part of the mass that the head's joint carries beside its share, such as a camera or a tool",
        unit="kg",
        ge=0,
        aka=("head_mass_kg",),
    )
    chamber_offset: float = parameter(
        0.03, meaning="distance b of the chambers from the centre line", unit="m", ge=0, aka=("b_m",)
    )
    half_height: Numbers = parameter(
        0.05,
        meaning="rest half-height h0 of a chamber's rhombus; the links follow, a^2 = h0^2 + l0^2/4",
        unit="m",
        gt=0,
        each="segment",
        aka=("h0_m",),
    )
    k_spring: Numbers = parameter(
        13.0,
        meaning="stiffness k of a segment's springs, both chambers together",
        unit="N",
        gt=0,
        each="segment",
        key="spring_N",
    )
    k_torsion: Numbers = parameter(
        10.0, meaning="stiffness of a joint in pitch", unit="J", ge=0, each="joint", key="torsion_J", aka=("pitch_J",)
    )
    k_yaw: Numbers = parameter(0.5, meaning="stiffness of a joint in yaw", unit="J", ge=0, each="joint", key="yaw_J")
    k_twist: Numbers = parameter(
        0.5, meaning="stiffness of a joint in twist", unit="J", ge=0, each="joint", key="twist_J"
    )
    cross0: Numbers = parameter(
        0.0,
        meaning="rest value of the pitch, the cross product of successive tangents in the (x, z) plane (sine of an "
        "angle); positive bends the head up",
        gt=-1,
        lt=1,
        each="joint",
    )
    k_apex: Numbers = parameter(
        0.0,
        meaning="stiffness of a segment's apex hinges, both chambers together, on their angle",
        unit="N m/rad",
        ge=0,
        each="segment",
        key="apex_hinge_N_m_rad",
    )
    kelvin_voigt_time: float = parameter(0.05, meaning="damping of every strain over its stiffness", unit="s", ge=0)
    drag: float = parameter(
        0.0,
        meaning="viscous medium: force over speed of the whole worm, shared over the joints like their mass",
        unit="N s/m",
        ge=0,
    )
    actuator_lag: float = parameter(
        0.1, meaning="time constant of a chamber's first-order response to its command", unit="s", ge=0
    )
    stroke: tuple[float, float] = parameter(
        (-0.1, 0.45), meaning="least and greatest contraction of a chamber, as a fraction of its length, below 1"
    )
    rate_limit: float = parameter(
        float("inf"),
        meaning="greatest speed of contraction of a chamber",
        unit="1/s",
        gt=0,
        infinite=True,
        left_out="no limit",
    )
    outward_apexes: bool = parameter(True, meaning="whether the outward apexes exist: have mass and touch the world")
    end_faces: bool = parameter(
        True,
        meaning="whether the end faces (discs of the end segments' rest height) and, as points, the joints between "
        "them touch the world",
    )
    actuator: Actuator = field(default_factory=FirstOrder)
    """What drives the chambers."""
    hinge_actuator: Actuator = field(default_factory=FirstOrder)
    """What drives the hinges."""
    hysteresis: Hysteresis = field(default_factory=Hysteresis)
    """Friction in the joints of the chambers; `Hysteresis()` is none."""
    medium: Medium = field(default_factory=Medium)
    """Makes `drag` follow the shape; `Medium()` resists alike whatever it is."""
    flat: bool = parameter(False, meaning="whether the worm stays in its plane: y, roll and bend are held (`planar`)")

    @classmethod
    @spelled
    def planar(
        cls,
        *,
        segments: int = 6,
        length: float = 1.0,
        half_height: Numbers | None = None,
        density: float = 10.0,
        depth: float = 0.1,
        mass: float | None = None,
        payload: float = 0.0,
        apex_mass_fraction: float = 0.5,
        k_spring: Numbers = 13.0,
        k_torsion: Numbers = 1e4,
        cross0: Numbers = 0.0,
        k_apex: Numbers = 0.12,
        kelvin_voigt_time: float = 0.05,
        drag: float = 0.0,
    ) -> Worm:
        """Return the planar special case, with the parameters of `planar.linkage.Linkage`.

        Left and right chambers coincide (b = 0) and share mass, stiffness and contact; the worm stays in the plane
        y = const. without roll and bend; outward apexes, end faces and actuator lag do not exist.

        Parameters
        ----------
        half_height : float or ndarray, shape (N,), optional
            sqrt(3)/4 l0 (the paper's) if left out [m].
        density, depth : float
            Mass = density [kg/m^3] x rest area of the rhombi x depth [m], unless `mass` is given.
        apex_mass_fraction : float
            Share of the mass on the apexes.
        k_apex : float or ndarray, shape (N,)
            Stiffness of each of the two apex hinges of a rhombus [N m/rad].
        """
        segments = arguments.whole("segments", segments, le=MOST_SEGMENTS)
        for name, value in (("length", length), ("density", density), ("depth", depth)):
            arguments.number(name, value, gt=0.0)
        apex_mass_fraction = arguments.number("apex_mass_fraction", apex_mass_fraction, ge=0.0, le=1.0)
        l0 = length / segments
        h0 = np.sqrt(3.0) / 4.0 * l0 if half_height is None else half_height
        area = float(l0 * np.sum(arguments.array("half_height", h0, (segments,), fill=True)))
        return cls(
            segments=segments,
            length=length,
            mass=density * area * depth if mass is None else mass,
            payload=payload,
            joint_mass_fraction=1.0 - apex_mass_fraction,
            chamber_offset=0.0,
            half_height=h0,
            k_spring=k_spring,
            k_torsion=k_torsion,
            k_yaw=0.0,
            k_twist=0.0,
            cross0=cross0,
            k_apex=k_apex,
            kelvin_voigt_time=kelvin_voigt_time,
            drag=drag,
            actuator_lag=0.0,
            stroke=(-100.0, 0.999),
            outward_apexes=False,
            end_faces=False,
            flat=True,
        )

    def __post_init__(self) -> None:
        n = arguments.whole("segments", self.segments, le=MOST_SEGMENTS)
        check(self, segment=n, joint=n - 1)
        object.__setattr__(self, "stroke", _stroke(self.stroke))
        for name, count in (("actuator", n), ("hinge_actuator", n - 1)):
            given = getattr(self, name)
            arguments.instance(name, given, Actuator, "a worm3d.Actuator such as worm3d.FirstOrder()")
            given.require_size(name, count)
        arguments.instance("hysteresis", self.hysteresis, Hysteresis, "a worm3d.Hysteresis such as worm3d.Jenkins()")
        self.hysteresis.require_size("hysteresis", n)
        arguments.instance("medium", self.medium, Medium, "a worm3d.Medium such as worm3d.StrainDrag()")
        self.medium.require_size("medium", n)
        if self.drag == 0.0 and type(self.medium) is not Medium:
            raise ValueError(f"drag: got {self.drag!r} N s/m, must be above 0 with a medium, which multiplies it")
        if not self.hinge_actuator.drives_hinges:
            wrong = type(self.hinge_actuator).__name__
            raise ValueError(f"hinge_actuator: got {wrong}, which acts on chambers alone; use it as the actuator")
        if self.payload >= self.mass:
            raise ValueError(
                f"payload: got {self.payload!r} kg, must be below mass ({self.mass!r} kg), which has it in it"
            )
        if self.flat and self.chamber_offset != 0.0:
            raise ValueError(f"chamber_offset: got {self.chamber_offset!r}, must be 0 in a worm that is flat")

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
    if found.shape != (2,) or not (-arguments.LARGEST <= found[0] <= 0.0 <= found[1] < 1.0):
        raise ValueError(
            f"stroke: got {arguments.shown(given)}, must be finite and (c_min, c_max) with c_min <= 0 <= c_max < 1"
        )
    return float(found[0]), float(found[1])
