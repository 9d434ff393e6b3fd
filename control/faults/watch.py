"""Detection of faults of a worm at run time.

A `Watch` summarises the measurements, the commands and the reference of each wave in a `Wave`. The rules in
`control.faults.rules` detect faults from these summaries.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from math import inf, nan
from typing import NamedTuple

import numpy as np

from control.estimation.chamber_gains import ChamberGains
from control.estimation.estimate import Estimate, wrapped
from control.estimation.kalman import Uncertainty
from control.estimation.reduced import INDEX
from control.faults.rules import Fault, Wave, faults
from control.gaits.steering import GaitParameters
from control.planning.feed_forward import FeedForward
from control.sensing.sensors import Measurement
from control.tracking.detour import Body
from control.tracking.paths import offset
from control.tracking.preview import ANY, Ability, bounds, speed_at
from control.tracking.references import Reference
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.named import EXCEPTIONS

AT_LIMIT = 0.97
"""A wave counts as the fastest possible if its amplitude and frequency are at least this fraction of the maximum."""
HARMONICS = 3
"""Number of harmonics of the wave's frequency that are fitted to strains and commands. The residual is the noise."""
MIN_GAIN_SAMPLES = 16
"""Minimum number of strain samples for an estimate of the gains. If a wave has fewer, the samples of several waves are
combined."""
MOVES = 0.02
"""Minimum amplitude of a chamber's command for an estimate of its gain."""
MAX_DIRECTION_DEVIATION = 0.3
"""Forward and backward can be distinguished if an estimated heading has a standard deviation below this value [rad]."""
YIELDS = Uncertainty().slope_yield
"""Ratio of the crab angle [rad] to the slope across the heading, (KF2) in `control.estimation.kalman`."""
_LOG = logging.getLogger(__name__)


class _Way(NamedTuple):
    """Fields of `Wave` about the path near the worm; the defaults hold without a path."""

    turn: float = 0.0
    sharpest: float = inf
    aside: float | None = None
    ahead: float | None = None
    trespass: float = -inf


class Watch:
    """Fault detection for one worm. `faults` contains the faults detected so far."""

    def __init__(self, worm: Worm, reference: Reference, feed_forward: FeedForward) -> None:
        self._segments, self._body, self._length = worm.segments, Body.of(worm), worm.length
        self.reference, self._feed_forward = reference, feed_forward
        self.faults: list[Fault] = []
        self._waves: list[Wave] = []
        self._strains: list[tuple[float, FloatArray, FloatArray]] = []
        self._places: list[tuple[float, float, float]] = []
        self._told: tuple[float, FloatArray] | None = None
        self._known_gains: ChamberGains | None = None
        self._usual_gain: FloatArray | None = None
        self._begin: tuple[float, float] | None = None
        self._near: float | None = None
        self._numb = True
        self._pushes, self._jumps, self._felt = 0, 0, False

    def look(self, t: float, seen: Measurement, estimated: Callable[[float], Estimate | None]) -> None:
        """Process the measurement `seen` at time t [s], before the command for t is set by `tell`.

        `estimated` returns the estimated state at a given time. If a wave has ended, its rules are evaluated.
        """
        if seen.com is not None:
            self._places.append((float(seen.com[0]), float(seen.com[1]), seen.com_time))
        if self._told is None:
            return
        phase, contraction = self._told
        self._numb = self._numb and "strain" in seen and seen.strain is None
        if seen.strain is not None:
            self._felt = True
            self._strains.append((phase, seen.strain, contraction))
        if self._begin is None:
            self._begin = t, phase
        if phase >= self._begin[1] + 2.0 * np.pi:
            self._end_wave(self._wave(self._begin[0], t, estimated(t)))
            self._begin, self._numb = (t, phase), True
            if self._known_gains is not None:
                known = self._known_gains.gain
                usual = known if self._usual_gain is None else self._usual_gain
                self._usual_gain = usual + 0.2 * (known - usual)

    def tell(
        self, phase: float, command: Command, parameters: GaitParameters | None, gains: ChamberGains | None = None
    ) -> None:
        """Set the command that applies from now on. `parameters` is None if the command is not a wave of the map."""
        self._told, self._parameters, self._known_gains = (phase, command.contraction), parameters, gains

    def _end_wave(self, wave: Wave) -> None:
        self._waves.append(wave)
        self._places.clear()
        del self._waves[:-40]
        self.report(faults(self._waves))

    def report(self, found: Iterable[Fault]) -> None:
        """Add faults to `faults` and log them, but only the first fault of each kind."""
        for fault in found:
            if all(fault.kind != known.kind for known in self.faults):
                _LOG.info("at %.2f s: %s", fault.time, fault.what)
                self.faults.append(fault)

    def _wave(self, begin: float, end: float, estimate: Estimate | None) -> Wave:
        gain, gain_error, bend = self._gains()
        place, place_time, place_error = self._place()
        at_limit, made, expected = self._ability()
        able, times = self._feed_forward, np.linspace(begin, end, 9)
        try:
            at = np.full(len(times), self._near or 0.0)
            both = (Ability(reach, self._length, able.wave) for reach in (ANY.reach, able.reach))
            asked = np.zeros((2, len(times))) + [speed_at(self.reference, times, at, each) for each in both]
            back = able.backward and bool(asked.sum() < 0.0)
            if able.backward:
                asked = np.maximum(-asked if back else asked, 0.0)
            if self._parameters is not None and self._parameters.amplitude == 0.0:
                asked = np.minimum(asked, 0.0)  # the worm rests because it is commanded to: not too slow
            way = self._way(place, max(float(asked[0, -1]), 0.0), estimate)
        except EXCEPTIONS:  # the reference may be a user's own code; without it, the other rules still work
            _LOG.warning("at %.3f s the reference could not be evaluated, its rules are skipped", end, exc_info=True)
            asked, way, back = np.full_like(times, nan), _Way(), False
        pushes = jumps = 0
        crab = turning = heading_error = away = descent = 0.0
        ahead = way.ahead
        if estimate is not None:
            pushes, jumps = estimate.pushed, estimate.jumped
            crab, turning = _crab(estimate), float(estimate.state.turn_rate)
            heading_error = float(estimate.deviations[2])
            descent = _descent(estimate, back=back)
            if heading_error < MAX_DIRECTION_DEVIATION:
                ahead = estimate.heading if ahead is None else ahead
                away = abs(float(wrapped(np.array(estimate.heading - ahead))))
        explained = not self._felt or any(fault.kind.startswith("chamber") for fault in self.faults)
        pushed, jumped = pushes > self._pushes and not explained, jumps > self._jumps
        self._pushes, self._jumps, self._felt = pushes, jumps, False
        return Wave(
            end=end,
            usual_gain=self._usual_gain,
            numb=self._numb,
            back=back,
            least_asked=float(asked.min()),
            most_asked=float(asked.max()),
            reach=able.fastest,
            pushed=pushed,
            length=self._length,
            jumped=jumped,
            gain=gain,
            gain_error=gain_error,
            bend=bend,
            place=place,
            place_time=place_time,
            place_error=place_error,
            at_limit=at_limit,
            made=made,
            expected=expected,
            turn=way.turn,
            sharpest=way.sharpest,
            aside=way.aside,
            ahead=ahead,
            trespass=way.trespass,
            away=away,
            heading_error=heading_error,
            turning=turning,
            crab=crab,
            descent=descent,
        )

    def _ability(self) -> tuple[bool, float, float]:
        """Return the fields of `Wave` that the map gives for the commanded wave: `at_limit`, `made` and `expected`.

        The speed `made` is infinite if the parameters of the wave are unknown.
        """
        if self._parameters is None:
            return False, inf, 1.0
        top, size, pace = self._feed_forward.ranges, abs(self._parameters.amplitude), self._parameters.frequency
        if size == 0.0:
            return False, 0.0, 1.0
        most = top.amplitude[1]
        made, makes = (float(self._feed_forward.found.speed(each, pace, 0.0)) for each in (size, most))
        at_limit = size >= AT_LIMIT * most and pace >= AT_LIMIT * top.frequency[1]
        expected = min(made / size * most / makes, 1.0)
        return at_limit, self._length * made, expected

    def _gains(self) -> tuple[FloatArray, FloatArray, float]:
        """Return the fields of `Wave` about the chambers: `gain`, `gain_error` and `bend`, by a least-squares fit."""
        nothing = np.full((self._segments, 2), nan)
        unknown = nothing, nothing, nan
        if len(self._strains) < MIN_GAIN_SAMPLES:
            return unknown
        phase, strain, told = (np.array(column) for column in zip(*self._strains, strict=True))
        self._strains.clear()
        strain, told = strain.reshape(len(phase), -1), told.reshape(len(phase), -1)
        missing = np.isnan(strain)
        dead = 2 * missing.sum(axis=0) > len(phase)
        rows = ~missing[:, ~dead].any(axis=1)
        if dead.all() or rows.sum() < MIN_GAIN_SAMPLES:
            return unknown
        orders = np.arange(1, HARMONICS + 1) * phase[rows, None]
        columns = np.hstack([np.ones((rows.sum(), 1)), np.cos(orders), np.sin(orders)])
        both = np.nan_to_num(np.hstack([strain[rows], told[rows]]))
        found, *_ = np.linalg.lstsq(columns, both, rcond=None)
        left_over = both - columns @ found
        chambers = strain.shape[1]
        amplitude = np.hypot(found[1], found[1 + HARMONICS])
        asked = np.where((amplitude[chambers:] < MOVES) | dead, nan, amplitude[chambers:])
        variance = (left_over[:, :chambers] ** 2).sum(axis=0) / max(len(both) - len(found), 1)
        mean = np.where(dead, nan, found[0, :chambers]).reshape(-1, 2)
        tilt = np.abs(mean[:, 0] - mean[:, 1])
        bend = float(np.nanmax(tilt)) if np.isfinite(tilt).any() else nan
        error = np.sqrt(2.0 * variance / len(both)) / asked
        gain = amplitude[:chambers] / asked
        return gain.reshape(-1, 2), error.reshape(-1, 2), bend

    def _place(self) -> tuple[FloatArray | None, float, float]:
        """Return the fields `place`, `place_time` and `place_error` of `Wave`.

        The error is estimated from the scatter of the samples.
        """
        if not self._places:
            return None, nan, nan
        rows = np.array(sorted(self._places, key=lambda row: row[2]))
        twice = np.diff(rows[:, :2], n=2, axis=0)
        variance = float((twice**2).mean()) / 6.0 if len(twice) else 0.0  # of white noise: the motion is slow
        error = float(np.sqrt(2.0 * variance / len(rows)))
        return rows[:, :2].mean(axis=0), float(rows[:, 2].mean()), error

    def _way(self, place: FloatArray | None, speed: float, estimate: Estimate | None) -> _Way:
        """Return the fields of `Wave` about the path near the worm; the defaults if the reference has no path."""
        path = self.reference.path
        if path is None or place is None:
            return _Way()
        self._near = s = float(path.project(place, self._near))
        azimuth = float(path.heading(s))
        aside = float(offset(path, place, s))
        left, right, *_ = bounds(self.reference, np.array([s]))[:, 0]
        sure = estimate is not None and estimate.deviations[2] < MAX_DIRECTION_DEVIATION
        looks = np.array(estimate.heading if estimate is not None and sure else azimuth)
        inside = -float(self._body.clearance(self.reference.obstacles, place, looks))
        return _Way(
            turn=float(path.curvature(s)) * speed,
            sharpest=self._feed_forward.sharpest(speed),
            aside=abs(aside) / self._length,
            ahead=azimuth,
            trespass=max(aside - left, -aside - right, inside) / self._length,
        )


def _descent(estimate: Estimate, *, back: bool) -> float:
    """Return the estimated downward slope in the direction of motion, minus one standard error, and at least 0.

    A worm that goes `back` moves against its heading.
    """
    ahead = (-1.0 if back else 1.0) * np.array([np.cos(estimate.heading), np.sin(estimate.heading)])
    doubt = float(np.sqrt(ahead @ estimate.slope_covariance @ ahead))
    return max(-float(ahead @ estimate.slope) - doubt, 0.0)


def _crab(estimate: Estimate) -> float:
    """Return by how much the crab angle exceeds the angle that the ground's slope explains, minus one standard error.

    The result [rad] is 0 if the excess is below the standard error.
    """
    heading, state = np.array([-np.sin(estimate.heading), np.cos(estimate.heading)]), estimate.state
    across = float(heading @ estimate.slope)
    doubt = YIELDS * float(np.sqrt(heading @ estimate.slope_covariance @ heading)) + estimate.deviations[INDEX["crab"]]
    return max(abs(float(state.crab) + YIELDS * across) - float(doubt), 0.0)
