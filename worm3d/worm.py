"""The worm's parameters: sizes, masses, stiffnesses and actuators; one value for all segments or one each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

Numbers = float | FloatArray
"""A number, or one for each segment or joint."""

MOST_SEGMENTS = 1000
"""Longer worms no longer come to rest on their world."""

_PER_SEGMENT = ("half_height", "k_spring", "k_apex")
_PER_JOINT = ("k_torsion", "k_yaw", "k_twist", "cross0")
_RANGES: dict[str, dict[str, Any]] = {
    **{name: {"gt": 0.0} for name in ("length", "mass", "half_height", "k_spring", "rate_limit")},
    **{name: {"ge": 0.0} for name in ("chamber_offset", "k_torsion", "k_yaw", "k_twist", "k_apex")},
    **{name: {"ge": 0.0} for name in ("kelvin_voigt_time", "drag", "actuator_lag")},
    "joint_mass_fraction": {"ge": 0.0, "le": 1.0},
    "cross0": {"gt": -1.0, "lt": 1.0},
}
_FLAGS = ("outward_apexes", "end_faces", "flat")


@dataclass(frozen=True, eq=False, kw_only=True)
class Worm(ReadOnly):
    """A chain of N rhombic linkages with left and right chambers; frozen, validated, with read-only arrays.

    The defaults are the default worm of the project.

    Attributes
    ----------
    segments : int
        N, at least 1; segment and joint 0 are the tail.
    length : float
        Rest length of the body [m]; segments are equally long, l0 = length / N.
    mass : float
        Total mass [kg].
    joint_mass_fraction : float
        Share of the mass on the joints, like rod nodes (the ends half as much); the rest is on the apexes, equally.
    chamber_offset : float
        b, lateral distance of the chambers from the centre line [m].
    half_height : float or ndarray, shape (N,)
        Rest half-height h0 of each chamber's rhombus [m]; the links follow, a^2 = h0^2 + l0^2/4.
    k_spring : float or ndarray, shape (N,)
        Stiffness of a segment's springs, both chambers together [N].
    k_torsion, k_yaw, k_twist : float or ndarray, shape (N-1,)
        Stiffness of the joints in pitch, yaw and twist [J].
    cross0 : float or ndarray, shape (N-1,)
        Rest value of the cross product of successive tangents in the (x, z) plane; positive bends the head up.
    k_apex : float or ndarray, shape (N,)
        Stiffness of the apex hinges of a segment, both chambers together, on their angle [N m/rad].
    kelvin_voigt_time : float
        Damping of every strain: its coefficient is this time [s] x the stiffness of that strain.
    drag : float
        Viscous medium: force over speed of the whole worm [N s/m], shared over the joints like their mass.
    actuator_lag : float
        Time constant of the chambers' first-order response to a command [s].
    stroke : tuple of float
        Least and greatest contraction of a chamber, below 1.
    rate_limit : float
        Greatest speed of contraction of a chamber [1/s].
    outward_apexes : bool
        Whether the outward apexes exist: have mass and touch the world.
    end_faces : bool
        Whether the end faces (discs of the end segments' rest height) and, as points, the inner joints touch the world.
    flat : bool
        Whether the worm stays in its plane: y, roll and bend are held (`Worm.planar`).

    Raises
    ------
    ValueError
        A value that is not finite or out of range, or an array of the wrong shape.
    """

    segments: int = 6
    length: float = 1.0
    mass: float = 0.1
    joint_mass_fraction: float = 0.5
    chamber_offset: float = 0.03
    half_height: Numbers = 0.05
    k_spring: Numbers = 13.0
    k_torsion: Numbers = 10.0
    k_yaw: Numbers = 0.5
    k_twist: Numbers = 0.5
    cross0: Numbers = 0.0
    k_apex: Numbers = 0.0
    kelvin_voigt_time: float = 0.05
    drag: float = 0.0
    actuator_lag: float = 0.1
    stroke: tuple[float, float] = (-0.1, 0.45)
    rate_limit: float = float("inf")
    outward_apexes: bool = True
    end_faces: bool = True
    flat: bool = False

    @classmethod
    def planar(
        cls,
        *,
        segments: int = 6,
        length: float = 1.0,
        half_height: Numbers | None = None,
        density: float = 10.0,
        depth: float = 0.1,
        mass: float | None = None,
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
        sizes = {**dict.fromkeys(_PER_SEGMENT, n), **dict.fromkeys(_PER_JOINT, n - 1)}
        checked: dict[str, object] = {"segments": n, "stroke": _stroke(self.stroke)}
        for name, within in _RANGES.items():
            value = getattr(self, name)
            if name in sizes:
                checked[name] = arguments.array(name, value, (sizes[name],), fill=True, **within)
            else:
                checked[name] = arguments.number(name, value, infinite=name == "rate_limit", **within)
        checked |= {name: arguments.flag(name, getattr(self, name)) for name in _FLAGS}
        for name, checked_value in checked.items():
            object.__setattr__(self, name, checked_value)
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
        mass = np.full(self.segments + 1, self.joint_mass_fraction * self.mass / self.segments)
        mass[[0, -1]] /= 2.0
        return mass

    @property
    def apex_mass(self) -> FloatArray:
        """Mass of each apex in the order of the conventions, shape (N, 6) [kg]."""
        share = np.array([1.0, 1.0, float(self.outward_apexes)] * 2)
        return np.tile(
            (1.0 - self.joint_mass_fraction) * self.mass / self.segments * share / share.sum(), (self.segments, 1)
        )


def _stroke(given: tuple[float, float]) -> tuple[float, float]:
    found = arguments.floats("stroke", given)
    if found.shape != (2,) or not (-arguments.LARGEST <= found[0] <= 0.0 <= found[1] < 1.0):
        raise ValueError(
            f"stroke: got {arguments.shown(given)}, must be finite and (c_min, c_max) with c_min <= 0 <= c_max < 1"
        )
    return float(found[0]), float(found[1])
