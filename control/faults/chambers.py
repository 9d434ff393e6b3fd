"""Detection and compensation of chambers that do not follow their commands. Both take less than a wave.

If a chamber is stuck while the chamber on the other side of the segment (its twin) contracts, the body bends in every
wave. The worm turns, goes sideways, and often tips over within one and a half waves (for 5 of the 12 chambers of the
default worm at 0.08 m/s). If both chambers are held still, the segment is straight again and the other segments carry
it. The worm is then a little slower at the same wave, and the estimator attributes the difference to slip.

*Detection.* `control.estimation.chamber_gains`, (CG1), predicts each strain with a model that includes weak and slow
chambers. Let m be the measured strain minus the predicted strain, e the part of the predicted strain that the chamber's
own command causes, and f the part that the same command would cause in a healthy chamber. They are smoothed:

    E' = (m - E)/tau,   M' = (m + e - f - M)/tau,   F' = (f - F)/tau,   D = E_left - E_right                  (CH1)

D does not depend on loads and walls, which affect both sides. A chamber is considered faulty if all these conditions
hold for `MIN_FAULT_DURATION`: |D| exceeds a limit, |E| is at least twice the |E| of the twin, |M| is more than half of
|F|, and the neighbouring segments do not have a similar D of the same sign. On paths, in a pipe, in sharp turns and
across slopes, |D| of the default worm stays below 0.06. Pushes bend several segments alike: |D| is up to 0.18 in one
segment, and at least 0.4 times as large in the neighbouring segments. A chamber without pressure has a |D| of 0.13 to
0.25. The neighbouring segments then have at most 0.2 times this |D|, mostly with the opposite sign.

*Compensation.* Both chambers of the segment are held. The faulty chamber is held at the contraction that it had when
the fault was detected. The twin slowly follows the contraction measured in the faulty chamber. The segment is held
still even if only the strain sensor is faulty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.estimation.chamber_gains import ChamberGains
from control.faults.rules import CHAMBER_ADVICE, Fault
from control.sensing.sensors import SIDE_NAMES
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

MISSED = 0.55
"""Share of a healthy chamber's strain that must be missing before a chamber counts as faulty."""
MISS_TIME_CONSTANT = 0.03
"""Time constant tau of E, M and F [s]."""
LIMIT = 0.05
"""Value of |D| above which a chamber counts as faulty, if the strains have no noise."""
NOISE_MARGIN = 4.0
"""Margin that is added to the limit, in standard deviations of D caused by the noise of the strains."""
SPREAD = 0.3
"""Largest accepted D in the neighbouring segments, as a share of D in this segment. With a larger share of the same
sign, the body has been bent from outside."""
ONE_SIDED = 2.0
"""Ratio of a chamber's |E| to its twin's |E| above which only this chamber counts as faulty."""
MIN_FAULT_DURATION = 0.02
"""A fault is reported once all conditions have held for this time [s]."""
FOLLOWS = 1.0
"""The twin follows the measured contraction of the faulty chamber with this time constant [s]."""


@dataclass
class Held:
    """A segment that is held still because one of its chambers is faulty."""

    side: int
    """Side of the faulty chamber; 0 is left."""
    held: float
    """Held contraction of this chamber."""
    twin: float
    """Held contraction of the other chamber."""


class Chambers:
    """Check of the chambers of one worm. The keys of `held` are the indices of the segments that are held still."""

    def __init__(self, worm: Worm) -> None:
        self._shape, self._stroke = (worm.segments, 2), worm.stroke
        self.held: dict[int, Held] = {}
        self._told: FloatArray | None = None
        self._time = np.nan
        self._miss, self._short, self._healthy, self._strain = np.zeros((4, *self._shape))
        self._last: list[FloatArray] = []
        self._variance = 0.0
        self._since = np.full(self._shape, np.inf)

    def take(self, t: float, strain: FloatArray | None, gains: ChamberGains) -> list[Fault]:
        """Process the strains measured at time t [s], and return the newly detected faults.

        `strain` has the shape (N, 2), with NaN where unknown. `gains` has already processed the same strains.
        """
        if self._told is None:
            return []
        passed, self._time = t - self._time, t
        if strain is None:
            return []
        share = 1.0 - np.exp(-passed / MISS_TIME_CONSTANT)
        known = np.isfinite(gains.miss)  # False if there is no strain, or no command before the strain
        miss = np.where(known, gains.miss, 0.0)
        self._miss += share * (miss - self._miss)
        self._short += share * (miss + gains.expected - gains.healthy - self._short)
        self._healthy += share * (gains.healthy - self._healthy)
        self._strain += share * np.where(known, strain - self._strain, 0.0)
        found = []
        for segment, side in np.argwhere(self._disobeying(t, self._doubt(strain, share))).tolist():
            if segment not in self.held:
                now = float(np.clip(-self._strain[segment, side], *self._stroke))
                self.held[segment] = Held(side, now, now)
                found.append(self._fault(t, segment, side))
        for segment, held in self.held.items():
            measured = -strain[segment, held.side]
            if np.isfinite(measured):
                held.twin += (1.0 - np.exp(-passed / FOLLOWS)) * (measured - held.twin)
        return found

    def _fault(self, t: float, segment: int, side: int) -> Fault:
        name, now = f"the {SIDE_NAMES[side]} chamber of segment {segment}", -self._strain[segment, side]
        what = f"{name} does not obey: it is shortened by {now:.2f} in place of {now + self._short[segment, side]:.2f}"
        advice = f"{CHAMBER_ADVICE}; the segment is held still, the others carry it"
        return Fault(t, f"chamber {segment} {SIDE_NAMES[side]}", what, advice)

    def amended(self, t: float, command: Command) -> Command:
        """Return the command from time t [s] on, changed so that the faulty segments are held still."""
        if self.held:
            contraction = command.contraction.copy()
            for segment, held in self.held.items():
                contraction[segment, held.side] = held.held
                contraction[segment, 1 - held.side] = np.clip(held.twin, *self._stroke)
            command = replace(command, contraction=contraction)
        if self._told is None:
            self._time = t
        self._told = command.contraction
        return command

    def _doubt(self, strain: FloatArray, share: float) -> float:
        """Return the standard deviation of D, computed from the scatter of the strains from sample to sample."""
        self._last = [*self._last[-2:], strain]
        if len(self._last) == 3:
            first, second, third = self._last
            twice = (first - 2.0 * second + third) ** 2
            known = twice[np.isfinite(twice)]
            if known.size:
                scatter = float(known.mean()) / 6.0  # the variance of white noise
                self._variance += 0.05 * (scatter - self._variance)
        return float(np.sqrt(2.0 * self._variance * share / (2.0 - share)))

    def _disobeying(self, t: float, doubt: float) -> NDArray[np.bool_]:
        """Return a mask of the chambers that have been faulty for a while, shape (N, 2)."""
        size, apart = np.abs(self._miss), self._miss[:, 0] - self._miss[:, 1]
        wide = np.abs(apart) > LIMIT + NOISE_MARGIN * doubt
        if not wide.any():  # nearly always
            self._since.fill(np.inf)
            return np.zeros(self._shape, dtype=bool)
        beside = np.sign(apart) * np.vstack([np.append(apart[1:], 0.0), np.append(0.0, apart[:-1])])
        alone = wide & (beside < SPREAD * np.abs(apart)).all(axis=0)
        bad = (
            alone[:, None] & (size > ONE_SIDED * size[:, ::-1]) & (np.abs(self._short) > MISSED * np.abs(self._healthy))
        )
        self._since = np.where(bad, np.minimum(self._since, t), np.inf)
        return np.asarray(t - self._since >= MIN_FAULT_DURATION)
