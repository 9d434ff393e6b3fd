"""Files of learned segment laws (JSON), made from finite elements or from measurements, with their checks."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from worm3d.physics.segment_laws.network import ENERGY_SIZES, RADIUS_SIZES, network, weights_of
from worm3d.values import regular_file
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.values.spelling import did_you_mean

FILE_KIND, FILE_VERSION = "worm3d segment law", 1
"""Values of the keys "kind" and "version" of a file that this version of worm3d reads."""

INPUT_UNITS = {"pressure": "Pa", "cable": "N"}
"""Unit of each input of a segment by name: gauge pressure, or tension of a cable along the axis."""

SCALES = ("x_mid", "x_half", "y_mid", "y_half", "energy_J", "radius_mid_m", "radius_m")
"""Keys of the object "scales"."""

BENDING_TERMS = 6
"""Number of coefficients of the bending stiffness: 1, x, y, x^2, x y, y^2."""

LONGEST_SEGMENT = 10.0
"""Largest length in a file [m]. A larger number is probably not in metres. No worm robot has segments half as long."""

MOST_LAW_BYTES = 4_000_000
"""Largest size of a file. Files with an ensemble of twenty laws have a tenth of this size."""

REST_RADIUS_MISS = 0.02
"""Largest difference of the radius of the network at rest from "rest_radius_m", as a fraction of the latter. Fitted
laws miss by 0.001 or less. A larger difference means that the networks and sizes belong to different segments."""

DOMAIN_GRID = 21
"""Number of lengths and of contractions at which the radius is checked. Twice this number finds the same laws."""

SHIPPED_LAWS = Path(__file__).with_name("shipped")
"""Folder of the laws that come with worm3d."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LawFile(ReadOnly):
    """Content of the file of a learned segment law."""

    rest_length: float
    """Rest length l0 of the segment [m]."""
    chamber_offset: float
    """Distance b of the chambers from the axis [m]."""
    plate_radius: float
    """Radius of the end plates [m]."""
    stiffness: float
    """Stiffness k of the spring to which the energy reduces without a network [N]."""
    scales: Mapping[str, float]
    """Scales of the networks' inputs and outputs by name."""
    energy: FloatArray
    """Weights of the network N_U, shape (67,)."""
    radius: FloatArray
    """Weights of the network N_R, shape (25,)."""
    bending: FloatArray
    """Coefficients of the bending stiffness m, shape (6,) [N m/rad]."""
    shortest: FloatArray
    """Least length of a chamber in the domain, at equal steps of the contraction, shape (K,) [m]. The file of a domain
    that is a rectangle gives one value."""
    longest: FloatArray
    """Greatest length of a chamber, as `shortest`."""
    most_contraction: float
    """Greatest contraction in the domain. The least contraction is 0."""
    input_name: str
    """Input of the segment, "pressure" or "cable"."""
    contraction: FloatArray
    """Free contractions of the table p(a), shape (P,)."""
    value: FloatArray
    """Inputs of the table p(a), shape (P,) [Pa or N]."""
    passive: float
    """Contraction without an input: 0, or the last one of the table if the input lengthens the segment."""
    ensemble: tuple[Mapping[str, FloatArray], ...]
    """`energy`, `radius` and `bending` of each further law of the ensemble, by name."""

    def member(self, number: int) -> LawFile:
        """Return the law of this number: 0 for this law, 1 for the first further law of the ensemble.

        Raises
        ------
        ValueError
            The ensemble has no such law.
        """
        if number > len(self.ensemble):
            has = f"the file has {len(self.ensemble)} further laws" if self.ensemble else "the file has no further laws"
            raise ValueError(f"member: got {number}, must be from 0 to {len(self.ensemble)}: {has}")
        changes: dict[str, Any] = {} if number == 0 else dict(self.ensemble[number - 1])
        return replace(self, **changes)

    def stiffened(self, chambers: float, bending: float) -> LawFile:
        """Return the laws with these factors of the energy of chambers and of the bending stiffness."""
        scales = {**self.scales, "energy_J": chambers * self.scales["energy_J"]}
        ensemble = tuple({**each, "bending": bending * each["bending"]} for each in self.ensemble)
        stiffness, own = chambers * self.stiffness, bending * self.bending
        return replace(self, stiffness=stiffness, scales=scales, bending=own, ensemble=ensemble)

    def radius_at(self, length: FloatArray, contraction: FloatArray) -> FloatArray:
        """Return the outer radius at lengths [m] and contractions, in their common shape [m]."""
        s = self.scales
        x = (np.asarray(length) / self.rest_length - s["x_mid"]) / s["x_half"]
        y = (np.asarray(contraction) - s["y_mid"]) / s["y_half"]
        found: FloatArray = s["radius_mid_m"] + s["radius_m"] * network(self.radius, RADIUS_SIZES, [x, y])
        return found

    @property
    def rest_radius(self) -> float:
        """Outer radius at rest according to the network [m]."""
        return float(self.radius_at(np.array(self.rest_length), np.array(0.0)))


def text_of(path: str | PathLike[str]) -> str:
    """Return the text of a file, or of the file of this name that comes with worm3d.

    Raises
    ------
    ValueError
        There is no such file, or the file cannot be read, is empty or is no text.
    """
    file = Path(path)
    shipped = SHIPPED_LAWS / file.name
    if not file.exists() and file.name == str(path) and shipped.exists():
        file = shipped
    try:
        text = regular_file.content(file, MOST_LAW_BYTES, "segment law").decode()
    except UnicodeDecodeError:
        raise ValueError(f"segment law {file.name!r}: is no text, must be JSON as 'worm3d law' writes it") from None
    if not text.strip():
        raise ValueError(f"segment law {file.name!r}: the file is empty; make it with 'worm3d law'")
    return text


def parsed(text: str, name: str) -> LawFile:
    """Return the content of the text of a file. `name` is the name of the file in error messages.

    Raises
    ------
    ValueError
        The text is not JSON, of another kind or version, or a value is missing or not allowed.
    """
    try:
        return _law(_Reader(json.loads(text)))
    except json.JSONDecodeError as error:
        raise ValueError(f"segment law {name!r}: is no JSON, {error}; make it with 'worm3d law'") from None
    except _WrongError as error:
        raise ValueError(f"segment law {name!r}: {error}") from None


class _WrongError(Exception):
    """A missing or wrong value; the message says where."""


class _Reader:
    """Checked access to the values of a JSON object."""

    def __init__(self, data: Any, at: str = "") -> None:
        if not isinstance(data, dict):
            raise _WrongError(f"{at or 'the file'}: got {type(data).__name__}, must be an object with keys")
        self._data, self._at = data, at

    def get(self, key: str) -> Any:
        if key not in self._data:
            meant = did_you_mean(key, [(each, each) for each in self._data])
            hint = f"; the file has {meant!r}" if meant else ""
            raise _WrongError(f"{self._at}{key}: is missing{hint}")
        return self._data[key]

    def holds(self, key: str) -> bool:
        return self._data.get(key) is not None

    def inner(self, key: str) -> _Reader:
        return _Reader(self.get(key), f"{self._at}{key}.")

    def number(self, key: str, low: float, high: float, advice: str = "") -> float:
        value = self.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low < value < high:
            raise _WrongError(f"{self._at}{key}: got {value!r}, must be between {low:g} and {high:g}{advice}")
        return float(value)

    def numbers(self, key: str, count: int | None = None, why: str = "") -> FloatArray:
        value = self.get(key)
        if not isinstance(value, list) or not all(type(each) in (int, float) for each in value):
            raise _WrongError(f"{self._at}{key}: must be a list of numbers")
        if count is not None and len(value) != count:
            raise _WrongError(f"{self._at}{key}: got {len(value)} numbers, must be {count}{why}")
        found = np.array(value, dtype=float)
        if not np.isfinite(found).all():
            k = int(np.argmin(np.isfinite(found)))
            raise _WrongError(f"{self._at}{key}: number {k} is {found[k]}, must be finite; the fit has failed")
        return found


def _law(r: _Reader) -> LawFile:
    _require(r, "kind", FILE_KIND, "; this is a file of something else")
    _require(r, "version", FILE_VERSION, "; make the file again with this version of worm3d")
    rest = r.number("rest_length_m", 0.0, LONGEST_SEGMENT, " m: lengths are in metres")
    name, contraction, value = _table(r.inner("input"))
    (shortest, longest), most = _domain(r.inner("domain"), rest)
    scales = r.inner("scales")
    law = LawFile(
        rest_length=rest,
        chamber_offset=r.number("chamber_offset_m", 0.0, LONGEST_SEGMENT, " m: lengths are in metres"),
        plate_radius=r.number("plate_radius_m", 0.0, LONGEST_SEGMENT, " m: lengths are in metres"),
        stiffness=r.number("stiffness_N", 0.0, np.inf),
        scales={key: scales.number(key, *_range(key)) for key in SCALES},
        energy=_weights(r.inner("energy"), ENERGY_SIZES),
        radius=_weights(r.inner("radius"), RADIUS_SIZES),
        bending=r.numbers("bending_Nm", BENDING_TERMS, ": 1, x, y, x^2, x y, y^2"),
        shortest=shortest,
        longest=longest,
        most_contraction=most,
        input_name=name,
        contraction=contraction,
        value=value,
        ensemble=(),
        passive=min(float(contraction[-1]), most) if r.inner("input").holds("counted_down_from") else 0.0,
    )
    law = replace(law, ensemble=tuple(_members(r, law)))
    _require_round(law, r.number("rest_radius_m", 0.0, LONGEST_SEGMENT, " m: lengths are in metres"))
    return law


def _require(r: _Reader, key: str, wanted: Any, advice: str) -> None:
    if (found := r.get(key)) != wanted:
        raise _WrongError(f"{key}: got {found!r}, must be {wanted!r}{advice}")


def _range(key: str) -> tuple[float, float]:
    """Return the range of a scale. Middles may have any sign; scales of inputs divide, and must be above 0."""
    return (0.0 if key.endswith("half") else -np.inf), np.inf


def _table(r: _Reader) -> tuple[str, FloatArray, FloatArray]:
    """Return the name of the input, and the table p(a)."""
    name = r.get("name")
    if name not in INPUT_UNITS:
        raise _WrongError(f"input.name: got {name!r}, must be one of {', '.join(map(repr, INPUT_UNITS))}")
    if (unit := r.get("unit")) != INPUT_UNITS[name]:
        raise _WrongError(f"input.unit: got {unit!r}, must be {INPUT_UNITS[name]!r} for {name}; convert the table")
    contraction = r.numbers("contraction")
    value = r.numbers("value", len(contraction), ", as many as contractions")
    if len(contraction) < 2 or contraction[0] != 0.0:
        raise _WrongError("input.contraction: must have at least 2 numbers and begin with 0, the free length")
    for key, column in (("contraction", contraction), ("value", value)):
        if not (np.diff(column) > 0.0).all():
            k = int(np.argmax(np.diff(column) <= 0.0)) + 1
            raise _WrongError(
                f"input.{key}: number {k} is {column[k]:g} after {column[k - 1]:g}, must ascend; leave out states in "
                "which the segment is crumpled or snaps"
            )
    return name, contraction, value


def _domain(r: _Reader, rest: float) -> tuple[tuple[FloatArray, FloatArray], float]:
    """Return the bounds of the length at equal steps of the contraction, and the greatest contraction."""
    low, high = r.numbers("length_m", 2)
    least, most = r.numbers("contraction", 2)
    if not 0.0 < low <= rest <= high < LONGEST_SEGMENT:
        raise _WrongError(
            f"domain.length_m: got {low:g} to {high:g}, must be in metres and include the rest length {rest:g}"
        )
    if least != 0.0 or not 0.0 < most < 1.0:
        raise _WrongError(f"domain.contraction: got {least:g} to {most:g}, must be from 0 to a number below 1")
    if not r.holds("shortest_m") and not r.holds("longest_m"):  # a rectangle, as in files of earlier versions
        return (np.array([low]), np.array([high])), float(most)
    shortest = r.numbers("shortest_m")
    longest = r.numbers("longest_m", len(shortest), ", as many as in shortest_m")
    free = rest * (1.0 - np.linspace(0.0, most, len(shortest)))
    right = {"shortest_m": (shortest > 0.0) & (shortest <= free), "longest_m": free <= longest}
    for key, inside in right.items():
        if len(shortest) < 2 or not inside.all():
            raise _WrongError(
                f"domain.{key}: must have at least 2 numbers, at equal steps of the contraction, and include the free "
                "lengths; make the file again with 'worm3d law'"
            )
    return (shortest, longest), float(most)


def _members(r: _Reader, law: LawFile) -> Iterator[Mapping[str, FloatArray]]:
    """Yield the further laws of the ensemble. Those without a bending stiffness of their own have that of the law."""
    given = r.get("ensemble") if r.holds("ensemble") else []
    if not isinstance(given, list):
        raise _WrongError(f"ensemble: got {type(given).__name__}, must be a list of laws")
    for k, each in enumerate(given):
        own = _Reader(each, f"ensemble[{k}].")
        yield {
            "energy": own.numbers("energy", len(law.energy)),
            "radius": own.numbers("radius", len(law.radius)),
            "bending": own.numbers("bending_Nm", BENDING_TERMS) if own.holds("bending_Nm") else law.bending,
        }


def _weights(r: _Reader, sizes: Sequence[int]) -> FloatArray:
    if list(r.get("sizes")) != list(sizes):
        raise _WrongError(f"{r._at}sizes: got {r.get('sizes')}, must be {list(sizes)}")
    return r.numbers("weights", weights_of(sizes), f" for the sizes {list(sizes)}")


def _require_round(law: LawFile, rest_radius: float) -> None:
    """Raise an error for a radius that does not fit the sizes of the segment."""
    if abs(law.rest_radius - rest_radius) > REST_RADIUS_MISS * rest_radius:
        raise _WrongError(
            f"rest_radius_m: got {rest_radius:.4g}, must be the radius of the network at rest, {law.rest_radius:.4g}"
        )
    ends = float(law.shortest.min()), float(law.longest.max())
    grid = np.linspace(*ends, DOMAIN_GRID)[:, None], np.linspace(0.0, law.most_contraction, DOMAIN_GRID)
    least = float(law.radius_at(*grid).min())
    if not least > law.chamber_offset:
        raise _WrongError(
            f"radius: falls to {least:.4g} m in the domain, must stay above chamber_offset_m "
            f"({law.chamber_offset:.4g} m); make the domain smaller or the offset less"
        )
