"""Learned segment laws: the file that `worm3d law` writes, and its validation."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from planar.linkage.segment_law import RADIUS_LAYERS, network
from worm3d.values import arguments, regular_file
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

FILE_KIND, FILE_VERSION = "worm3d segment law", 1
"""Words that a file must contain as `kind` and `version`."""

LARGEST_FILE = 10_000_000
"""Largest size of a file [byte]; a file with an ensemble of twenty networks has 40,000 bytes."""

REST_RADIUS_ERROR = 0.05
"""Largest difference between the radius at rest in a file and the radius of the network, as a fraction of the radius.

Fits differ by 1 %. Wrong units, or weights in another order, differ by much more.
"""

SCALES = ("x_mid", "x_half", "y_mid", "y_half", "energy_J", "radius_mid_m", "radius_m")
"""Keys of the scales in a file, in the order of `planar.linkage.segment_law.SegmentLaw.scales`."""


@dataclass(frozen=True, eq=False)
class Learned(ReadOnly):
    """A segment law from a file (PL2). Instances are validated and cannot be changed.

    Raises
    ------
    ValueError
        If a value is missing, has the wrong shape or is out of range.
    """

    rest_length: float
    """l0 [m]."""
    rest_radius: float
    """Outer radius at rest [m]."""
    stiffness: float
    """k [N]."""
    scales: FloatArray
    """Scales in the order of `SCALES`, shape (7,)."""
    energy: FloatArray
    """Weights of N_U, shape (67,)."""
    radius: FloatArray
    """Weights of N_R, shape (25,)."""
    shortest: FloatArray
    """Least length in the domain at equal steps of the contraction, shape (K,) [m]."""
    longest: FloatArray
    """Greatest length in the domain, as `shortest`."""
    contractions: FloatArray
    """Least and greatest contraction in the domain, shape (2,); the least is 0."""

    def __post_init__(self) -> None:
        for name, unit in (("rest_length", "m"), ("rest_radius", "m"), ("stiffness", "N")):
            object.__setattr__(self, name, arguments.number(name, getattr(self, name), unit, gt=0.0))
        bounds = arguments.floats("domain.shortest_m", self.shortest).size
        sizes = {"scales": len(SCALES), "energy": 67, "radius": 25, "contractions": 2}
        for name, size in {**sizes, "shortest": bounds, "longest": bounds}.items():
            object.__setattr__(self, name, arguments.array(name, getattr(self, name), (size,)))
        super().__post_init__()
        for k in (1, 3):  # divisors
            arguments.number(f"scales.{SCALES[k]}", float(self.scales[k]), gt=0.0)
        (low, high), (least, most) = self.lengths, self.contractions
        if not 0.0 < low < self.rest_length < high:
            raise ValueError(
                f"domain.length_m: got {low:g} to {high:g} m, must be above 0, ascend, and contain the rest length of "
                f"{self.rest_length:g} m"
            )
        if not (least == 0.0 < most < 1.0):
            raise ValueError(f"domain.contraction: got {least:g} to {most:g}, must be from 0 to a number below 1")
        free = self.rest_length * (1.0 - np.linspace(least, most, bounds))
        if not ((self.shortest <= free).all() and (free <= self.longest).all()):
            raise ValueError("domain.shortest_m, domain.longest_m: must include the free length at each contraction")
        self._require_radius()

    def _require_radius(self) -> None:
        x, y = (1.0 - self.scales[0]) / self.scales[1], -self.scales[2] / self.scales[3]
        radius = self.scales[5] + self.scales[6] * network(self.radius, RADIUS_LAYERS, float(x), float(y), 0.0, 0.0)[0]
        if abs(radius - self.rest_radius) > REST_RADIUS_ERROR * self.rest_radius:
            raise ValueError(
                f"rest_radius_m: got {self.rest_radius:g} m, but the network has {radius:g} m at rest; check the units "
                "and the order of the weights, or fit the law again"
            )

    @property
    def lengths(self) -> tuple[float, float]:
        """Least and greatest length in the domain at any contraction [m]."""
        return float(self.shortest.min()), float(self.longest.max())

    def contains(self, length: FloatArray, contraction: FloatArray) -> bool:
        """Return whether all lengths [m] and contractions are in the domain, up to rounding."""
        rounding, at = 1e-9, np.linspace(0.0, self.contractions[1], len(self.shortest))
        low, high = (np.interp(contraction, at, bound) for bound in (self.shortest, self.longest))
        inside = (length >= low * (1.0 - rounding)) & (length <= high * (1.0 + rounding))
        reached = (contraction >= -rounding) & (contraction <= self.contractions[1] + rounding)
        return bool((inside & reached).all())

    @classmethod
    def read(cls, path: str | os.PathLike[str], member: int = 0) -> Learned:
        """Return the segment law in a file; with a `member` above 0, this law of the ensemble in the file.

        Raises
        ------
        ValueError
            If the file cannot be read, is not a valid segment law, or has no such member.
        """
        arguments.whole("member", member, ge=0)
        what = "segment: must be 'rhombus', 'hydrostat' or a file of a segment law; the file"
        text = regular_file.content(path, LARGEST_FILE, what)
        try:
            return cls(**_fields(json.loads(text), member))
        except (ValueError, RecursionError) as error:
            why = f"must be JSON: {error}" if isinstance(error, json.JSONDecodeError) else error
            raise ValueError(f"segment law {os.path.basename(path)!r}: {why}") from None


def _fields(found: Any, member: int) -> dict[str, Any]:
    """Return the arguments of `Learned` from the content of a file."""
    for key, expected in (("kind", FILE_KIND), ("version", FILE_VERSION)):
        if _at(found, key) != expected:
            raise ValueError(f"{key}: got {found[key]!r}, must be {expected!r}; write the file with 'worm3d law'")
    energy, radius = _at(found, "energy", "weights"), _at(found, "radius", "weights")
    if member:
        ensemble = found.get("ensemble", [])
        if member > len(ensemble):
            raise ValueError(f"member: got {member}, must be at most {len(ensemble)}, the size of the ensemble")
        energy, radius = _at(ensemble[member - 1], "energy"), _at(ensemble[member - 1], "radius")
    domain = _at(found, "domain")
    lengths = arguments.array("domain.length_m", _at(domain, "length_m"), (2,))
    return {
        "rest_length": _at(found, "rest_length_m"),
        "rest_radius": _at(found, "rest_radius_m"),
        "stiffness": _at(found, "stiffness_N"),
        "scales": [arguments.number(f"scales.{key}", _at(found, "scales", key)) for key in SCALES],
        "energy": energy,
        "radius": radius,
        "shortest": domain.get("shortest_m", lengths[:1]),
        "longest": domain.get("longest_m", lengths[1:]),
        "contractions": _at(found, "domain", "contraction"),
    }


def _at(found: Any, *keys: str) -> Any:
    for key in keys:
        if not isinstance(found, Mapping) or key not in found:
            raise ValueError(f"there is no key {'.'.join(keys)!r}; write the file with 'worm3d law'")
        found = found[key]
    return found
