"""Markers on the body of a measured robot.

The header of a measurement says where on the body each marker is. Positions are on the line of joints, the polygon
through the joints from tail to head.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from scenes.language.errors import SceneError
from worm3d.values.arrays import FloatArray

_LINE = re.compile(r"marker\s+(?P<name>.+)")
_PLACE = re.compile(r"(?P<kind>joint|body)\s+(?P<number>\d+(\.\d*)?([eE][-+]?\d+)?)")


class Place(NamedTuple):
    """A position on the line of joints, as the header gives it."""

    kind: str
    """`joint` for a position at a joint, or `body` for a position given as a fraction of the body."""
    number: float
    """Number of the joint, 0 at the tail; or fraction of the segments that lie behind the marker, 0 at the tail and 1
    at the head."""


def places(header: Mapping[str, str]) -> dict[str, Place]:
    """Return the positions of markers from header lines such as `marker head: joint 6` or `marker m: body 0.5`.

    Raises
    ------
    SceneError
        If a line about a marker is invalid.
    """
    return {
        match["name"]: _place(match["name"], text) for name, text in header.items() if (match := _LINE.fullmatch(name))
    }


def _place(name: str, text: str) -> Place:
    if not (match := _PLACE.fullmatch(text)):
        raise SceneError(f"marker {name}: got '{text}', must be 'joint NUMBER' or 'body SHARE', such as 'body 0.5'")
    place = Place(match["kind"], float(match["number"]))
    if place.kind == "joint" and not place.number.is_integer():
        raise SceneError(f"marker {name}: got '{text}', the number of a joint must be an integer, 0 for the tail")
    if place.kind == "body" and place.number > 1.0:
        raise SceneError(f"marker {name}: got '{text}', the share of the body must be from 0 (tail) to 1 (head)")
    return place


def require_same(said: Mapping[str, Place], columns: set[str]) -> None:
    """Raise an error if a marker with columns has no line in the header, or a marker in the header has no columns.

    `said` are the positions from the header, and `columns` the names of the markers with columns.
    """
    for name in sorted(columns - said.keys()):
        raise SceneError(
            f"marker {name}: got no position on the body, must have a line such as '# marker {name}: joint 0' "
            f"or '# marker {name}: body 0.5'"
        )
    for name in sorted(said.keys() - columns):
        raise SceneError(f"marker {name}: has no columns, must have marker_{name}_x_m and others, or no line")


def positions(joints: FloatArray, place: Place) -> FloatArray:
    """Return the position of a marker at each instant, shape (T, D) [m].

    `joints` are the positions of the N + 1 joints in D dimensions, shape (T, N+1, D) [m].

    Raises
    ------
    SceneError
        If the worm has no joint of this number.
    """
    last = joints.shape[1] - 1
    if place.kind == "joint" and place.number > last:
        raise SceneError(f"marker on joint {place.number:g}: the simulated worm has joints 0 to {last}")
    along = place.number if place.kind == "joint" else place.number * last
    k = min(int(along), last - 1)
    found: FloatArray = joints[:, k] + (along - k) * (joints[:, k + 1] - joints[:, k])
    return found
