"""Description of a soft segment: profile of the wall, rubber, fibres and load, read from TOML.

    [profile]
    kind = "barrel"           # or "cylinder", "points"
    length_m = 0.12           # distance between the end plates at rest
    plate_radius_m = 0.02
    middle_radius_m = 0.05
    [wall]
    thickness_m = 0.0015
    [rubber]
    kind = "Yeoh"             # or "neo-Hookean", "Ogden"
    c1_Pa = 50e3
    [[fibres]]                # any number of families, or none
    stiffness_N = 2.0
    per_m = 400.0
    [load]
    pressure_Pa = [0.0, 4500.0]   # or cable_N

The profile is the middle surface of the wall. A profile is symmetric about the middle of the segment. The wall is
clamped to two rigid end plates along its edges, which are perpendicular to the wall.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from types import MappingProxyType
from typing import Any, TypeVar

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from worm3d.fem.material import RUBBERS, Fibres, Rubber
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import unknown

T = TypeVar("T")

INPUTS = ("pressure_Pa", "cable_N")
"""Loads by the key of their range: gauge pressure inside, or tension of a cable along the axis."""


class Profile:
    """Meridian of the middle surface, from the middle of the segment (s = 0) to the end plate (s = 1)."""

    length_m: float
    """Distance between the end plates at rest [m]."""

    def meridian(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and unit tangents, each as an array of shape (2, M) with the rows radius and z [m].

        Parameters
        ----------
        s : ndarray, shape (M,)
            Position along the meridian in [0, 1], in proportion to the length of the arc. z is 0 in the middle of the
            segment, and half of the length at the plate.
        """
        raise NotImplementedError


@documented
@dataclass(frozen=True, kw_only=True)
class Barrel(Profile):
    """Arc of a circle between the plates. A middle radius below the radius of the plates makes a waist."""

    length_m: float = parameter(meaning="distance between the end plates at rest", unit="m", gt=0.0)
    plate_radius_m: float = parameter(meaning="radius of the wall at the end plates", unit="m", gt=0.0)
    middle_radius_m: float = parameter(meaning="radius of the wall in the middle of the segment", unit="m", gt=0.0)

    def __post_init__(self) -> None:
        check(self)
        if abs(self.middle_radius_m - self.plate_radius_m) >= self.length_m / 2.0:
            raise ValueError(
                f"middle_radius_m: got {self.middle_radius_m!r} m, must differ from plate_radius_m by less than half "
                f"of length_m, {self.length_m / 2.0:g} m; use kind 'points' for a rounder wall"
            )

    def meridian(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and unit tangents (`Profile.meridian`)."""
        half, height = self.length_m / 2.0, self.middle_radius_m - self.plate_radius_m
        if height == 0.0:
            return Cylinder(length_m=self.length_m, radius_m=self.plate_radius_m).meridian(s)
        arc = (half**2 + height**2) / (2.0 * height)  # signed radius of the arc
        turn = np.asarray(s) * math.asin(half / arc)
        sine, cosine = np.sin(turn), np.cos(turn)
        return np.stack([self.middle_radius_m - arc * (1.0 - cosine), arc * sine]), np.stack([-sine, cosine])


@documented
@dataclass(frozen=True, kw_only=True)
class Cylinder(Profile):
    """Straight tube."""

    length_m: float = parameter(meaning="distance between the end plates at rest", unit="m", gt=0.0)
    radius_m: float = parameter(meaning="radius of the wall", unit="m", gt=0.0)

    def __post_init__(self) -> None:
        check(self)

    def meridian(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and unit tangents (`Profile.meridian`)."""
        s = np.asarray(s, dtype=float)
        points = np.stack([np.full_like(s, self.radius_m), s * self.length_m / 2.0])
        return points, np.stack([np.zeros_like(s), np.ones_like(s)])


@dataclass(frozen=True, kw_only=True)
class Points(Profile):
    """Smooth curve through points, by a cubic spline that is horizontal in the middle of the segment.

    Attributes
    ----------
    z_m : tuple of float
        Distances from the middle of the segment, ascending from 0 to half of the length [m].
    radius_m : tuple of float
        Radius of the wall at each point [m].
    """

    z_m: tuple[float, ...]
    radius_m: tuple[float, ...]

    def __post_init__(self) -> None:
        z = arguments.array("z_m", self.z_m, ("M",), least=3, ge=0.0)
        radius = arguments.array("radius_m", self.radius_m, ("M",), least=3, gt=0.0)
        if len(z) != len(radius):
            raise ValueError(f"radius_m: got {len(radius)} radii, must be one for each value of z_m, {len(z)}")
        if z[0] != 0.0 or not (np.diff(z) > 0.0).all():
            raise ValueError(
                f"z_m: got {arguments.shown(z)}, must ascend from 0 (middle) to half of the length (plate)"
            )
        object.__setattr__(self, "z_m", tuple(z.tolist()))
        object.__setattr__(self, "radius_m", tuple(radius.tolist()))

    @property
    def length_m(self) -> float:  # type: ignore[override]
        """Distance between the end plates at rest [m]."""
        return 2.0 * self.z_m[-1]

    def meridian(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and unit tangents (`Profile.meridian`)."""
        curve = CubicSpline(self.z_m, self.radius_m, bc_type=((1, 0.0), (2, 0.0)))
        fine = np.linspace(0.0, self.z_m[-1], 4001)
        slope = np.hypot(1.0, curve(fine, 1))
        arc = np.concatenate([[0.0], np.cumsum((slope[1:] + slope[:-1]) / 2.0)])
        z = np.interp(np.asarray(s) * arc[-1], arc, fine)
        tangent = np.stack([curve(z, 1), np.ones_like(z)])
        return np.stack([curve(z), z]), tangent / np.hypot(*tangent)


PROFILES: Mapping[str, type[Profile]] = MappingProxyType({"barrel": Barrel, "cylinder": Cylinder, "points": Points})
"""Profiles by the name that a description uses."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """Input of the segment, and the ranges of the table.

    Attributes
    ----------
    input : str
        `pressure_Pa` or `cable_N`.
    values : tuple of float
        Least and greatest value of the input [Pa] or [N].
    length_m : tuple of float or None
        Least and greatest distance between the plates [m]. None: from a little below the free length at each input to a
        little above the rest length (`worm3d.fem.sweep`).
    """

    input: str = "pressure_Pa"
    values: tuple[float, float]
    length_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        arguments.choice("input", self.input, INPUTS)
        object.__setattr__(self, "values", _range(self.input, self.values, 0.0))
        if self.length_m is not None:
            object.__setattr__(self, "length_m", _range("length_m", self.length_m, 1e-12))


def _range(name: str, value: Any, least: float) -> tuple[float, float]:
    low, high = arguments.array(name, value, (2,), ge=least).tolist()
    if not low < high:
        raise ValueError(f"{name}: got [{low:g}, {high:g}], must be two ascending numbers, least and greatest")
    return low, high


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A soft segment.

    Attributes
    ----------
    profile : Profile
    thickness_m : float
        Thickness of the wall at rest [m].
    rubber : Rubber
    fibres : tuple of Fibres
    load : Load
    text : str
        TOML text of the description, empty if there is none.
    """

    profile: Profile
    thickness_m: float
    rubber: Rubber
    fibres: tuple[Fibres, ...] = ()
    load: Load
    text: str = ""

    def __post_init__(self) -> None:
        least = float(self.profile.meridian(np.linspace(0.0, 1.0, 101))[0][0].min())
        name, unit = "wall.thickness_m", "m"
        object.__setattr__(self, "thickness_m", arguments.number(name, self.thickness_m, unit, gt=0.0, lt=least))

    @property
    def rest_length(self) -> float:
        """Distance between the end plates at rest [m]."""
        return self.profile.length_m

    @property
    def plate_radius(self) -> float:
        """Radius of the end plates: outer radius of the wall at the plates [m]."""
        points, tangents = self.profile.meridian(np.ones(1))
        return float(points[0, 0] + self.thickness_m / 2.0 * tangents[1, 0])

    def wall(self, s: FloatArray, depth: FloatArray) -> FloatArray:
        """Return points of the wall at rest, shape (2, M) with the rows radius and z [m].

        Parameters
        ----------
        s : ndarray, shape (M,)
            Position along the meridian, from 0 (middle) to 1 (plate).
        depth : ndarray, shape (M,)
            Position through the wall, from -1 (inner surface) to 1 (outer surface).
        """
        points, tangents = self.profile.meridian(s)
        outward = np.stack([tangents[1], -tangents[0]])
        found: FloatArray = points + np.asarray(depth) * self.thickness_m / 2.0 * outward
        return found

    def density(self, C: Any, meridian: Any, hoop: Any, radius: Any) -> Any:
        """Return the strain energy density of the wall at rest, without the constraint of volume [J/m^3].

        Parameters
        ----------
        C : casadi.SX, shape (3, 3)
            Right Cauchy-Green tensor.
        meridian, hoop : casadi.SX, shape (3, 1)
            Unit vectors in the wall at rest, along the meridian and around the axis.
        radius : casadi.SX or float
            Radius of the point at rest [m].
        """
        narrowing = radius / float(self.profile.meridian(np.zeros(1))[0][0, 0])
        families = sum((each.area_energy(C, meridian, hoop, narrowing) for each in self.fibres), start=ca.SX(0.0))
        return self.rubber.density(C) + families / self.thickness_m


def parse(text: str) -> Segment:
    """Return the segment of a TOML text.

    Raises
    ------
    ValueError
        The text is no TOML, a key is unknown or missing, or a value is out of range. The message names section and key.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"broken TOML: {error}") from error
    _require_keys("", data, {"profile", "wall", "rubber", "load"}, {"fibres"})
    families = data.get("fibres", [])
    if not isinstance(families, list):
        raise ValueError("fibres: got a section, must be an array of tables; write [[fibres]]")
    _require_keys("wall", data["wall"], {"thickness_m"})
    return Segment(
        profile=_kind("profile", data["profile"], PROFILES),
        thickness_m=data["wall"]["thickness_m"],
        rubber=_kind("rubber", data["rubber"], RUBBERS),
        fibres=tuple(_made("fibres", each, Fibres) for each in families),
        load=_load(data["load"]),
        text=text,
    )


def _load(section: Any) -> Load:
    _require_keys("load", section, set(), {*INPUTS, "length_m"})
    given = [name for name in INPUTS if name in section]
    if len(given) != 1:
        raise ValueError(f"load: got {' and '.join(given) or 'no input'}, must have one of {' and '.join(INPUTS)}")
    values = {"input": given[0], "values": section[given[0]], "length_m": section.get("length_m")}
    load: Load = _within("load", Load, values)
    return load


def _kind(where: str, section: Any, kinds: Mapping[str, type[T]]) -> T:
    if not isinstance(section, dict) or "kind" not in section:
        raise ValueError(f"{where}.kind: missing, must be one of {', '.join(map(repr, kinds))}")
    name = _within(where, arguments.choice, {"name": "kind", "value": section["kind"], "allowed": tuple(kinds)})
    return _made(where, {key: value for key, value in section.items() if key != "kind"}, kinds[name])


def _made(where: str, section: Any, part: type[T]) -> T:
    known = {each.name: each for each in fields(part)}  # type: ignore[arg-type]
    required = {name for name, each in known.items() if each.default is MISSING}
    _require_keys(where, section, required, set(known) - required)
    made: T = _within(where, part, section)
    return made


def _within(where: str, make: Any, values: Mapping[str, Any]) -> Any:
    """Return make(**values). A ValueError gets the name of the section in front."""
    try:
        return make(**values)
    except ValueError as error:
        raise ValueError(f"{where}.{error}") from error


def _require_keys(where: str, section: Any, required: set[str], optional: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    at = f"{where}." if where else ""
    if not isinstance(section, dict):
        raise ValueError(f"{where}: got {arguments.shown(section)}, must be a section [{where}]")
    known = {*required, *optional, *(["kind"] if where in ("profile", "rubber") else [])}
    for name in section.keys() - known:
        raise ValueError(f"{at}{name}: {unknown('key', name, [(each, each) for each in sorted(known)])}")
    for name in sorted(required - section.keys()):
        raise ValueError(f"{at}{name}: missing; add it to the {f'section [{where}]' if where else 'description'}")
