"""The guide, which leads a worm around known obstacles, and changes the way when an obstacle comes into sight.

A reference whose path leads around obstacles is called a led reference here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from control.tracking.detour import Body, Detour
from control.tracking.obstacles import Obstacle
from control.tracking.paths import Path, offset
from control.tracking.references import Reference
from control.tracking.search import MARGINS, NoWayError, Search
from worm3d.values.arrays import FloatArray

MAX_WAY_DISTANCE, MAX_WAY_ANGLE = 0.03, 0.15
"""Distance from the way [body lengths] and angle to the way [rad] above which the search is repeated from the worm's
actual position, once the heading is known. A worm that is nearer returns to the way within one or two waves."""
STEEPEST_TURN = 0.67
"""Greatest angle between a new way and the path at the start of the way [rad]. A worm at a larger angle turns first."""


def led(reference: Reference, body: Body) -> Reference:
    """Return a reference whose path leads around the obstacles that are known from the start.

    Raises
    ------
    ValueError
        The obstacles leave no way.
    """
    path = reference.path
    if path is None or not reference.obstacles or isinstance(path, Detour):
        return reference
    known = tuple(each for each in reference.obstacles if not math.isfinite(each.sight))
    unknown = tuple(each for each in reference.obstacles if math.isfinite(each.sight))
    try:
        return _led(reference, path, known, unknown, body, np.zeros(2))
    except NoWayError as error:
        room = f"within the corridor ({reference.corridor:g} m)" if math.isfinite(reference.corridor) else "beside it"
        wide = 2.0 * (body.half_width + MARGINS[-1] * body.length)
        raise ValueError(
            f"obstacles[{reference.obstacles.index(error.obstacle)}]: got one past which no way leads, must leave one "
            f"{room}, {wide:.3g} m wide for this body, and room where the path begins and ends: move it, make it "
            "smaller, or widen the corridor"
        ) from error


def led_on(reference: Reference, body: Body, seen: Sequence[Obstacle], s: float) -> Reference:
    """Return a led reference that also avoids the obstacles `seen`, which have come into sight.

    The way is kept up to the arc length `s` [m] and changes after it.

    Raises
    ------
    NoWayError
        There is no way from there on.
    """
    way = reference.path
    assert isinstance(way, Detour)
    lap = max(s, 0.0) % way.length if way.closed else s  # just before the start nothing is settled
    here = int(np.clip(np.searchsorted(way.lengths, lap, side="right"), 2, len(way.aside) - 1))
    settled = np.append(2.0 * way.aside[0] - way.aside[1], way.aside[:here])
    unknown = tuple(each for each in way.unknown if each not in seen)
    return _led(reference, way.asked, (*reference.obstacles, *seen), unknown, body, settled)


def led_from(reference: Reference, body: Body, place: FloatArray, azimuth: float) -> Reference:
    """Return a led reference whose way begins at the worm.

    The worm is at `place`, shape (2,) [m], with the azimuth `azimuth` [rad].

    Raises
    ------
    NoWayError
        There is no way from there on.
    """
    way = reference.path
    assert isinstance(way, Detour)
    s, along = float(way.asked.project(place)), np.append(-way.along[1], way.along)
    here = int(np.clip(np.searchsorted(along, s, side="right"), 2, len(along) - 2))
    turned = math.remainder(azimuth - float(way.asked.heading(s)), math.tau)
    slope = math.tan(min(max(turned, -STEEPEST_TURN), STEEPEST_TURN))
    settled = float(offset(way.asked, place, s)) + slope * np.maximum(along[:here] - s, -body.length)
    return _led(reference, way.asked, reference.obstacles, way.unknown, body, settled)


def _led(
    reference: Reference,
    path: Path,
    known: tuple[Obstacle, ...],
    unknown: tuple[Obstacle, ...],
    body: Body,
    settled: FloatArray,
) -> Reference:
    way = Search(path, reference, known, body, settled).way()
    return replace(reference, path=replace(way, unknown=unknown), obstacles=known)


class Guide:
    """The guide of one worm. `reference` leads the worm around the obstacles that are known so far."""

    def __init__(self, reference: Reference, body: Body) -> None:
        self._begin, self._body = reference, body
        self.reset()

    def reset(self) -> None:
        """Reset to the initial state."""
        self.reference = self._begin
        self._near: float | None = None
        self._placed = False

    def look(self, place: FloatArray, azimuth: float, sure: bool) -> bool:
        """Look for obstacles from the present position, and return whether the way has changed.

        `place` is the position of the worm, shape (2,) [m], and `azimuth` its heading [rad]. `sure` is whether the
        heading is known well enough for a new way from the worm's position.

        Raises
        ------
        NoWayError
            There is no way past the obstacles in sight.
        """
        before, way = self.reference, self.reference.path
        if not isinstance(way, Detour):
            return False
        self._near = s = float(way.project(place, self._near))
        if sure and not self._placed:
            self._placed = True
            aside, turned = float(offset(way, place, s)), math.remainder(azimuth - float(way.heading(s)), math.tau)
            if abs(aside) > MAX_WAY_DISTANCE * self._body.length or abs(turned) > MAX_WAY_ANGLE:
                self._lead_from(place, azimuth)
        near = {each: float(self._body.clearance([each], place, np.array(azimuth))) for each in way.unknown}
        seen = [each for each, clear in near.items() if clear + self._body.half_width <= each.sight]
        if seen:
            self.reference = led_on(self.reference, self._body, seen, self._near)
        return self.reference is not before

    def _lead_from(self, place: FloatArray, azimuth: float) -> None:
        """Replace the way by a way that begins at the worm. If there is no such way, keep the present one."""
        try:
            self.reference = led_from(self.reference, self._body, place, azimuth)
        except NoWayError:
            return
        assert self.reference.path is not None
        self._near = float(self.reference.path.project(place))
