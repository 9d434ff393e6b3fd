"""Steering of a worm with one segment held still, because a chamber of this segment has failed.

The bending wave (S2) of `control.gaits.steering` turns an intact worm without moving it sideways. If one segment is
held still, its feet are missing, and turning also moves the worm sideways. The default worm with segment 3 held still
turns by 10 degrees per wave instead of 24, and moves by 2 % of its length to the side opposite to the turn. With
separate amplitudes and phases of the hinges,

    hinge_j = hinge (a_j cos(psi + 2 pi f lead) + b_j sin(psi + 2 pi f lead))                                (HS1)

the worm turns by 13 degrees and stays in place. One run for each of the coefficients a_j and b_j gives the turn t and
the sideways displacement d caused by this coefficient. Among the patterns without sideways displacement, the pattern
with the largest turn for its size is

    (a, b) = t - d (t . d) / (d . d), scaled to a greatest hinge of 1
    (HS2)

The bias is not used. The table lists, for the default worm, the turn to the left in degrees and the displacement to the
left in percent of the body length, per wave. (The amplitude is 0.25, the frequency 1 Hz, and the steering half of the
greatest steering by both mechanisms. The intact worm has 11.9, -0.2.)

    segment held      0           1           2           3           4           5
    by (S2)       10.4, -0.3   6.0,  0.0  11.0,  0.8   4.3, -0.7  10.6,  1.0  10.6, -0.4
    by (HS1)       7.9, -0.1   8.9, -0.3   8.2,  0.1   5.8,  0.1   8.0,  0.1   9.7, -0.2
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from control.gaits.gait import Body
from control.gaits.steering import Correction, GaitParameters, Schedule
from worm3d import Commands
from worm3d.values.arrays import FloatArray

WAVE = GaitParameters(0.25, 1.0, hinge=0.07)
"""The turn of a pattern is measured with this wave, near the middle of the map. The amplitude is at most the stroke."""


@dataclass(frozen=True)
class HeldSteering:
    """Steering of a worm while one of its segments is held still."""

    hinges: tuple[tuple[float, ...], tuple[float, ...]]
    """Coefficients a and b of (HS1), shape (2, N - 1)."""
    turn: float
    """Turn to the left with the wave `WAVE` [rad per wave]."""

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> HeldSteering:
        """Return the steering from the fields of a JSON object."""
        a, b = map(tuple, content["hinges"])
        return cls((a, b), content["turn"])


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldSchedule(Schedule):
    """Schedule of a worm with one segment held still at its length at rest, which steers by (HS1).

    `hinges` are the coefficients a and b for forward waves, and `backward` those for backward waves, shape (2, N - 1).
    """

    segment: int
    hinges: FloatArray
    backward: FloatArray

    def commands_at(
        self, phase: FloatArray, parameters: FloatArray, body: Body, correction: Correction | None = None
    ) -> Commands:
        """Return the commands at K phases psi (K,) [rad]; see `Schedule.commands_at`."""
        given = super().commands_at(phase, parameters * [1.0, 1.0, 0.0, 0.0], body, correction)
        contraction = given.contraction.copy()
        contraction[:, self.segment] = 0.0
        amplitude, frequency, _, hinge = parameters.T
        ahead = phase + 2.0 * np.pi * self.lead * frequency
        parts = np.column_stack([np.cos(ahead), np.sin(ahead)])
        bend = np.where(amplitude[:, None] < 0.0, parts @ self.backward, parts @ self.hinges)
        return Commands(contraction, hinge[:, None] * bend, given.force)


def held_schedule(schedule: Schedule, segment: int, steering: Sequence[HeldSteering | None]) -> Schedule:
    """Return the schedule of a worm that continues to crawl while a segment is held still.

    `steering` has N entries: entry i is the steering while segment i is held still, or None if it is unknown. If the
    entry of the held segment is None, the given schedule is returned.
    """
    known = steering[segment]
    if known is None:
        return schedule
    other, hinges = steering[-1 - segment] or known, np.array(known.hinges)
    backward = -np.array(other.hinges)[:, ::-1]  # (S3): the segment is counted from the other end
    return HeldSchedule(**asdict(schedule), segment=segment, hinges=hinges, backward=backward)


def purely_turning(turn: FloatArray, aside: FloatArray) -> FloatArray:
    """Return the pattern (HS2), shape (2, N - 1).

    `turn` and `aside` are the turns and sideways displacements caused by a and b, shape (2, N - 1) each.
    """
    moves = float((aside * aside).sum())
    pattern = turn if moves == 0.0 else turn - aside * (turn * aside).sum() / moves
    greatest = np.hypot(*pattern).max()
    return np.asarray(pattern / greatest if greatest > 0.0 else pattern)
