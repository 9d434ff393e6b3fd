"""The watch over a worm: a summary of measurements, commands and the reference in each wave, for the rules to judge."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from math import inf, nan
from typing import NamedTuple

import numpy as np

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
"""Share of the greatest amplitude and frequency from which a wave is as fast as possible."""
HARMONICS = 3
"""Number of harmonics of the wave that are fitted to strains and commands; the residual is noise."""
MIN_GAIN_SAMPLES = 16
"""Least number of strains for an estimate of the gains; with fewer strains, several waves are combined."""
MOVES = 0.02
"""Amplitude of a command below which the chamber is not judged."""
MAX_DIRECTION_DEVIATION = 0.3
"""Standard deviation of a heading below which forward and backward can be distinguished [rad]."""
MOMENTS = 9
"""Number of instants in a wave at which the wanted speed is looked up."""
USUAL = 0.2
"""Share of a new wave in the usual gains; the gains of the first wave are the initial value."""
YIELDS = Uncertainty().slope_yield
"""Ratio of the crab angle to the slope across the heading, (KF2) [rad]."""
REMEMBERED = 40
"""Number of kept waves."""
_LOG = logging.getLogger(__name__)


class _Way(NamedTuple):
    """Properties of the reference at the position of a worm."""

    turn: float = 0.0
    """Turn rate of the path [rad/s]."""
    sharpest: float = inf
    """Greatest turn rate of the map [rad/s]."""
    aside: float | None = None
    """Distance from the path [body lengths]."""
    azimuth: float | None = None
    """Azimuth of the path [rad]."""
    trespass: float = -inf
    """Distance of the body into an obstacle, or of the middle of the body outside the corridor [body lengths]."""


class Watch:
    """The watch over one worm; `faults` holds the faults found so far."""

    def __init__(self, worm: Worm, reference: Reference, feed_forward: FeedForward) -> None:
        self._segments, self._body, self._length = worm.segments, Body.of(worm), worm.length
        self.reference, self._feed_forward = reference, feed_forward
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self.faults: list[Fault] = []
        self._waves: list[Wave] = []
        self._strains: list[tuple[float, FloatArray, FloatArray]] = []
        self._places: list[tuple[float, float, float]] = []
        self._told: tuple[float, FloatArray] | None = None
        self._known_gain: Callable[[], FloatArray] | None = None
        self._usual_gain: FloatArray | None = None
        self._begin: tuple[float, float] | None = None
        self._near: float | None = None
        self._numb = True
        self._pushes, self._jumps, self._felt = 0, 0, False

    def look(self, t: float, seen: Measurement, known: Callable[[float], Estimate | None]) -> None:
        """Add the measurement at time t [s], caused by the commands up to t; `known` gives the estimate of t."""
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
            self._end_wave(self._wave(self._begin[0], t, known(t)))
            self._begin, self._numb = (t, phase), True
            if self._known_gain is not None:
                known_gain = self._known_gain()
                usual = known_gain if self._usual_gain is None else self._usual_gain
                self._usual_gain = usual + USUAL * (known_gain - usual)

    def tell(
        self,
        phase: float,
        command: Command,
        parameters: GaitParameters | None,
        gain: Callable[[], FloatArray] | None = None,
    ) -> None:
        """Set the command from now on; without parameters the command is no wave of the map.

        `gain` returns the present estimate of the gain of each chamber, shape (N, 2).
        """
        self._told, self._parameters, self._known_gain = (phase, command.contraction), parameters, gain

    def _end_wave(self, wave: Wave) -> None:
        self._waves.append(wave)
        self._places.clear()
        del self._waves[:-REMEMBERED]
        self.report(faults(self._waves))

    def report(self, found: Iterable[Fault]) -> None:
        """Add faults; each kind is kept once."""
        for fault in found:
            if all(fault.kind != known.kind for known in self.faults):
                _LOG.info("at %.2f s: %s", fault.time, fault.what)
                self.faults.append(fault)

    def _wave(self, begin: float, end: float, estimate: Estimate | None) -> Wave:
        gain, error, bend = self._gains()
        place, instant, doubt = self._place()
        try:
            at = np.full(MOMENTS, self._near or 0.0)
            able, times = self._feed_forward, np.linspace(begin, end, MOMENTS)
            both = (Ability(reach, self._length, able.wave) for reach in (ANY.reach, able.reach))
            asked = np.zeros((2, MOMENTS)) + [speed_at(self.reference, times, at, each) for each in both]
            back = self._feed_forward.backward and bool(asked.sum() < 0.0)
            if self._feed_forward.backward:
                asked = np.maximum(-asked if back else asked, 0.0)
            if self._parameters is not None and self._parameters.amplitude == 0.0:
                asked = np.minimum(asked, 0.0)  # the worm rests on command, not for lack of speed
            way = self._way(place, max(float(asked[0, -1]), 0.0), estimate)
        except EXCEPTIONS:  # users may write references; the fallback handles their errors
            _LOG.warning("at %.3f s nothing is known of the reference", end, exc_info=True)
            asked, way, back = np.full(MOMENTS, nan), _Way(), False
        at_limit, made, expected = self._ability()
        pushes, jumps, crab = (0, 0, 0.0) if estimate is None else (estimate.pushed, estimate.jumped, _crab(estimate))
        explained = not self._felt or any(fault.kind.startswith("chamber") for fault in self.faults)
        pushed, jumped = pushes > self._pushes and not explained, jumps > self._jumps
        self._pushes, self._jumps, self._felt = pushes, jumps, False
        ahead, away = way.azimuth, 0.0
        if estimate is not None and estimate.deviations[2] < MAX_DIRECTION_DEVIATION:
            ahead = estimate.heading if ahead is None else ahead
            away = abs(float(wrapped(np.array(estimate.heading - ahead))))
        return Wave(
            end=end,
            gain=gain,
            gain_error=error,
            usual_gain=self._usual_gain,
            numb=self._numb,
            bend=bend,
            place=place,
            place_time=instant,
            place_error=doubt,
            ahead=ahead,
            at_limit=at_limit,
            heading_error=0.0 if estimate is None else float(estimate.deviations[2]),
            back=back,
            made=made,
            expected=expected,
            least_asked=float(asked.min()),
            most_asked=float(asked.max()),
            reach=self._feed_forward.fastest,
            turn=way.turn,
            sharpest=way.sharpest,
            aside=way.aside,
            trespass=way.trespass,
            away=away,
            pushed=pushed,
            turning=0.0 if estimate is None else float(estimate.state.turn_rate),
            length=self._length,
            jumped=jumped,
            crab=crab,
        )

    def _ability(self) -> tuple[bool, float, float]:
        """Return whether the wave is as fast as possible, the speed of the wave on the map, and `Wave.expected`.

        The speed is infinite if the wave is unknown.
        """
        if self._parameters is None:
            return False, inf, 1.0
        top, size, pace = self._feed_forward.ranges, abs(self._parameters.amplitude), self._parameters.frequency
        if size == 0.0:
            return False, 0.0, 1.0
        most = top.amplitude[1]
        made, makes = (float(self._feed_forward.found.speed(each, pace, 0.0)) for each in (size, most))
        at_limit = size >= AT_LIMIT * most and pace >= AT_LIMIT * top.frequency[1]
        return at_limit, self._length * made, min(made / size * most / makes, 1.0)

    def _gains(self) -> tuple[FloatArray, FloatArray, float]:
        """Return the gains of the chambers, their standard errors, and the bend, by least squares over the wave."""
        unknown = np.full((self._segments, 2), nan)
        if len(self._strains) < MIN_GAIN_SAMPLES:
            return unknown, unknown, nan
        phase, strain, told = (np.array(column) for column in zip(*self._strains, strict=True))
        self._strains.clear()
        strain, told = strain.reshape(len(phase), -1), told.reshape(len(phase), -1)
        missing = np.isnan(strain)
        dead = 2 * missing.sum(axis=0) > len(phase)
        rows = ~missing[:, ~dead].any(axis=1)
        if dead.all() or rows.sum() < MIN_GAIN_SAMPLES:
            return unknown, unknown, nan
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
        return (amplitude[:chambers] / asked).reshape(-1, 2), error.reshape(-1, 2), bend

    def _place(self) -> tuple[FloatArray | None, float, float]:
        """Return the mean position in a wave, the mean instant, and the standard error by the samples' scatter."""
        if not self._places:
            return None, nan, nan
        rows = np.array(sorted(self._places, key=lambda row: row[2]))
        twice = np.diff(rows[:, :2], n=2, axis=0)
        variance = float((twice**2).mean()) / 6.0 if len(twice) else 0.0  # of white noise; waves change slowly
        return rows[:, :2].mean(axis=0), float(rows[:, 2].mean()), float(np.sqrt(2.0 * variance / len(rows)))

    def _way(self, place: FloatArray | None, speed: float, estimate: Estimate | None) -> _Way:
        path = self.reference.path
        if path is None or place is None:
            return _Way()
        self._near = s = float(path.project(place, self._near))
        turn, azimuth = float(path.curvature(s)) * speed, float(path.heading(s))
        aside = float(offset(path, place, s))
        left, right, *_ = bounds(self.reference, np.array([s]))[:, 0]
        looks = (
            estimate.heading if estimate is not None and estimate.deviations[2] < MAX_DIRECTION_DEVIATION else azimuth
        )
        inside = -float(self._body.clearance(self.reference.obstacles, place, np.array(looks)))
        trespass = max(aside - left, -aside - right, inside) / self._length
        sharpest = self._feed_forward.sharpest(speed)
        return _Way(turn, sharpest, abs(aside) / self._length, azimuth, trespass)


def _crab(estimate: Estimate) -> float:
    """Return the significant excess of the crab angle over the angle that the ground's slope explains [rad]."""
    heading, state = np.array([-np.sin(estimate.heading), np.cos(estimate.heading)]), estimate.state
    across = float(heading @ estimate.slope)
    doubt = YIELDS * float(np.sqrt(heading @ estimate.slope_covariance @ heading)) + estimate.deviations[INDEX["crab"]]
    return max(abs(float(state.crab) + YIELDS * across) - float(doubt), 0.0)
