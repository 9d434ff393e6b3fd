"""The guide of a worm among obstacles: it finds the way anew where an obstacle comes into sight."""

from __future__ import annotations

import numpy as np

from control.tracking.detour import Body, Detour, NoWayError, led_from, led_on
from control.tracking.paths import offset
from control.tracking.references import Reference
from worm3d.values.arrays import FloatArray

APART, TURNED = 0.03, 0.15
"""Distance from the way [body lengths] and angle to it [rad] from which on a worm that has just come to know where it
is gets a way of its own: steered back to the other one it would be followed less exactly than usual."""


class Guide:
    """The reference of one worm, `reference`, led around the obstacles that are known so far."""

    def __init__(self, reference: Reference, body: Body) -> None:
        self._begin, self._body = reference, body
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.reference = self._begin
        self._near: float | None = None
        self._placed = False

    def look(self, place: FloatArray, azimuth: float, sure: bool) -> bool:
        """Look around from a place (2,) [m] and an azimuth [rad], and return whether the way has changed.

        `sure` says whether the azimuth is known well enough to lead the worm by it.

        Raises
        ------
        NoWayError
            There is no way past what has come into sight.
        """
        before, way = self.reference, self.reference.path
        if not isinstance(way, Detour):
            return False
        self._near = s = float(way.project(place, self._near))
        if sure and not self._placed:
            self._placed = True
            aside, turned = float(offset(way, place, s)), azimuth - float(way.heading(s))
            if abs(aside) > APART * self._body.length or abs(np.arctan2(np.sin(turned), np.cos(turned))) > TURNED:
                self._lead_from(place, azimuth)
        near = {each: float(self._body.clearance([each], place, np.array(azimuth))) for each in way.unknown}
        seen = [each for each, clear in near.items() if clear + self._body.half_width <= each.sight]
        if seen:
            self.reference = led_on(self.reference, self._body, seen, self._near)
        return self.reference is not before

    def _lead_from(self, place: FloatArray, azimuth: float) -> None:
        """Lead on from where the worm is; where no way begins there, it is steered back to the one that there is."""
        try:
            self.reference = led_from(self.reference, self._body, place, azimuth)
        except NoWayError:
            return
        assert self.reference.path is not None
        self._near = float(self.reference.path.project(place))
