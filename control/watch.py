"""The watch: what a controller measures, wave by wave, and the faults that show in it (`control.faults`)."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from control.estimation.estimate import Estimate
from control.faults import AT_LIMIT, Fault, Wave, faults
from control.gaits.steering import GaitParameters
from control.identification.feedforward import FeedForward
from control.sensing.sensors import Measurement
from control.tracking.paths import offset
from control.tracking.references import Reference
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

HARMONICS = 3
"""Number of harmonics of the wave that are fitted to strains and commands: what is left over is noise."""

SAMPLES = 16
"""Strains without which gains are not known: those of more waves are taken together."""

MOVES = 0.02
"""Amplitude of a command below which nothing can be said of its chamber."""

KNOWN = 0.3
"""Standard deviation of a heading by which forward can be told from backward [rad]."""

MOMENTS = 9
"""Instants of a wave at which the speed that is asked for is looked up."""

REMEMBERED = 40
"""Waves that are kept."""

_LOG = logging.getLogger(__name__)


class Watch:
    """The watch over one worm.

    Parameters
    ----------
    worm : Worm
    reference : Reference
    feed_forward : FeedForward
        What the worm can do.

    Attributes
    ----------
    faults : list of Fault
        Found so far.
    """

    def __init__(self, worm: Worm, reference: Reference, feed_forward: FeedForward) -> None:
        self._segments, self._length = worm.segments, worm.length
        self._reference, self._feed_forward = reference, feed_forward
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.faults: list[Fault] = []
        self._waves: list[Wave] = []
        self._strains: list[tuple[float, FloatArray, FloatArray]] = []
        self._places: list[tuple[float, float, float]] = []
        self._told: tuple[float, FloatArray] | None = None
        self._begin: tuple[float, float] | None = None
        self._near: float | None = None

    def look(self, t: float, seen: Measurement, known: Callable[[], Estimate | None]) -> None:
        """Take in what was measured at time t [s], of the commands up to then; `known` gives the estimate."""
        if seen.com is not None:
            self._places.append((float(seen.com[0]), float(seen.com[1]), seen.com_time))
        if self._told is None:
            return
        phase, contraction = self._told
        if seen.strain is not None:
            self._strains.append((phase, seen.strain, contraction))
        if self._begin is None:
            self._begin = t, phase
        if phase >= self._begin[1] + 2.0 * np.pi:
            self._end_wave(t, known())
            self._begin = t, phase

    def tell(self, phase: float, command: Command, parameters: GaitParameters) -> None:
        """Take in what is commanded from now on."""
        self._told, self._parameters = (phase, command.contraction), parameters

    def _end_wave(self, t: float, estimate: Estimate | None) -> None:
        assert self._begin is not None
        self._waves.append(self._wave(self._begin[0], t, estimate))
        self._places.clear()
        del self._waves[:-REMEMBERED]
        known = {fault.kind for fault in self.faults}
        for fault in faults(self._waves):
            if fault.kind not in known:
                _LOG.info("at %.2f s: %s", fault.time, fault.what)
                self.faults.append(fault)

    def _wave(self, begin: float, end: float, estimate: Estimate | None) -> Wave:
        gain, error, bend = self._gains()
        place, instant, doubt = self._place()
        try:
            asked = np.zeros(MOMENTS) + self._reference.speed(np.linspace(begin, end, MOMENTS))
            turn, sharpest, aside = self._way(place, float(asked[-1]))
        except Exception:  # anybody may write references; the ladder deals with these
            _LOG.warning("at %.3f s nothing is known of the reference", end, exc_info=True)
            asked, turn, sharpest, aside = np.full(MOMENTS, np.nan), 0.0, np.inf, None
        top = self._feed_forward.ranges
        known = estimate is not None and estimate.deviations[2] < KNOWN
        return Wave(
            end=end,
            gain=gain,
            gain_error=error,
            bend=bend,
            place=place,
            place_time=instant,
            place_error=doubt,
            heading=estimate.heading if estimate is not None and known else None,
            at_limit=self._parameters.amplitude >= AT_LIMIT * top.amplitude[1]
            and self._parameters.frequency >= AT_LIMIT * top.frequency[1],
            least_asked=float(asked.min()),
            most_asked=float(asked.max()),
            reach=self._feed_forward.fastest,
            turn=turn,
            sharpest=sharpest,
            aside=aside,
        )

    def _gains(self) -> tuple[FloatArray, FloatArray, float]:
        """Return the gains of the chambers, their standard errors, and the bend, by least squares over the wave."""
        unknown = np.full((self._segments, 2), np.nan)
        if len(self._strains) < SAMPLES:
            return unknown, unknown, float("nan")
        phase, strain, told = (np.array(column) for column in zip(*self._strains, strict=True))
        self._strains.clear()
        strain, told = strain.reshape(len(phase), -1), told.reshape(len(phase), -1)
        missing = np.isnan(strain)
        dead = 2 * missing.sum(axis=0) > len(phase)
        rows = ~missing[:, ~dead].any(axis=1)
        if dead.all() or rows.sum() < SAMPLES:
            return unknown, unknown, float("nan")
        orders = np.arange(1, HARMONICS + 1) * phase[rows, None]
        columns = np.hstack([np.ones((rows.sum(), 1)), np.cos(orders), np.sin(orders)])
        both = np.nan_to_num(np.hstack([strain[rows], told[rows]]))
        found, *_ = np.linalg.lstsq(columns, both, rcond=None)
        left_over = both - columns @ found
        chambers = strain.shape[1]
        amplitude = np.hypot(found[1], found[1 + HARMONICS])
        asked = np.where((amplitude[chambers:] < MOVES) | dead, np.nan, amplitude[chambers:])
        variance = (left_over[:, :chambers] ** 2).sum(axis=0) / max(len(both) - len(found), 1)
        mean = np.where(dead, np.nan, found[0, :chambers]).reshape(-1, 2)
        tilt = np.abs(mean[:, 0] - mean[:, 1])
        bend = float(np.nanmax(tilt)) if np.isfinite(tilt).any() else float("nan")
        error = np.sqrt(2.0 * variance / len(both)) / asked
        return (amplitude[:chambers] / asked).reshape(-1, 2), error.reshape(-1, 2), bend

    def _place(self) -> tuple[FloatArray | None, float, float]:
        """Return the mean place of a wave, its mean instant, and its standard error by how samples scatter."""
        if not self._places:
            return None, float("nan"), float("nan")
        rows = np.array(sorted(self._places, key=lambda row: row[2]))
        twice = np.diff(rows[:, :2], n=2, axis=0)
        variance = float((twice**2).mean()) / 6.0 if len(twice) else 0.0  # of white noise; waves change slowly
        return rows[:, :2].mean(axis=0), float(rows[:, 2].mean()), float(np.sqrt(2.0 * variance / len(rows)))

    def _way(self, place: FloatArray | None, speed: float) -> tuple[float, float, float | None]:
        """Return the path's turn rate at a place, the greatest one of the map, and the distance [body lengths]."""
        path = self._reference.path
        if path is None or place is None:
            return 0.0, float("inf"), None
        self._near = s = float(path.project(place, self._near))
        turn = float(path.curvature(s)) * speed
        return turn, self._feed_forward.sharpest(speed), abs(float(offset(path, place, s))) / self._length
