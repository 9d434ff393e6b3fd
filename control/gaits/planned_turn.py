"""Turning waves with little slip: each wave is planned so that segments on the ground stay where they are.

In periodic waves that steer, the body between two standing segments changes its shape, which makes these segments
slide. Kandhari, Wang, Chiel and Daltorio (Turning in worm-like robots: the geometry of slip elimination suggests
nonperiodic waves, Soft Robotics 6, 2019, 560-577) plan each wave separately instead: neighbouring segments exchange
their lengths so that the body ahead of the pair and the body behind the pair keep their places. Their segments are
trapezoids that trade sides two at a time. Here joints have hinges, several segments swing at a time, and the wave is
planned as a whole.

Lengths are in body lengths. The worm stands contracted and straight, joint j at x_j = (j - N/2) l_c. A wave runs from
head to tail, and `swinging` = n of the segments are extended and off the ground. The wave moves the whole body by s
along the mean of the headings before and after, and turns the body about its middle by the angle phi. After the share p
of this motion, a place x of the body is at

    X(p, x) = R(p phi) (x, 0) + p s (cos(p phi/2), sin(p phi/2)),  with the heading p phi               (N1)

At the time tau since the start of the wave, in steps of period/N, segment i has the share of extension

    f_i = h(tau - o_i) - h(tau - o_i - n),   o_i = N - 1 - i,  h half a cosine wave from 0 to 1          (N2)

and the head and the tail have the shares p = mean over k = 0 ... n - 1 of h(tau - k), and of h(tau - N - k). In a
straight wave the lengths are l_c + f_i (l_e - l_c), the bends 0 and s = n (l_e - l_c). In a turn lengths l_i and bends
b_j have to join tail and head:

    X_tail + sum_i l_i e(a_i) = X_head,   a_i = heading of the tail + sum_{j <= i} b_j,   a_N = heading of the head

Of all solutions, the plan is the nearest to the straight wave; only segments in the air may deviate:

    minimise sum_i ((l_i - l_c - f_i (l_e - l_c)) N)^2/f_i + sum_j b_j^2/g_j,   g_j = max(f_{j-1}, f_j)  (N3)

(the tail's and the head's end may turn as their segments do). Segments that stand have f = 0: they neither bend nor
change their length, and so keep their places. s is the longest step without a length above l_e. The next wave begins
when this wave reaches the tail, N steps after its start, with standing segments between the two waves.

A wave without a turn is an `ExtensionWave`. The plan is exact for a worm without mass and springs. The table compares
the default worm at amplitude 0.3 and extension -1/3 with the `Steered` wave that turns about as fast (hinge 0.06 to
0.12 rad):

    period   turn planned   turn a wave    slip per metre    the same of the steered wave
    5 s      20 deg         13 deg         0.22              13 deg, 0.43
    5 s      25 deg         16 deg         0.24              16 deg, 0.44
    2.5 s    20 deg         15 deg         0.27              15 deg, 0.44
    1.25 s   20 deg         11 deg         0.35              11 deg, 0.44

The plan thus halves the slip of slow waves. Fast waves gain less: chambers are soft in bending, and the body swings on
behind the commands. Three swinging segments step further, 0.19 body lengths a wave, but leave two segments to stand on,
and such a worm tips from 25 degrees a wave on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from control.gaits.gait import Body, ExtendingGait, Gait, half_cosine, longer
from worm3d import Commands
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

INSTANTS_PER_STEP = 16
"""Number of planned instants per step. Commands are interpolated linearly between them. The error of the positions of
standing segments is then 1e-4 of a segment's length, and 4e-4 with half as many instants."""
LARGEST_CHANGE = 0.6
"""Largest change of a bend in a Newton step [rad]."""
JOINED = 1e-9
"""Tail and head count as joined up to this gap [body lengths]."""
SHORTENING_CANDIDATES = (*(2.0**-k for k in range(20, 1, -1)), *(k / 10 for k in range(5, 10)))
"""Candidates for the relative shortening of a turning step against a straight step. The first one that is possible is
refined."""


class Reach(NamedTuple):
    """Dimensions of a wave.

    These are the numbers of all segments and of swinging segments, and the lengths of a segment [body lengths].
    """

    segments: int
    swinging: int
    contracted: float
    extended: float


class Plan(NamedTuple):
    """A wave at instants tau = 0, 1/INSTANTS_PER_STEP, ... N + n: M of them."""

    lengthened: FloatArray
    """Extension of each segment beyond the contracted length, shape (M, N) [body lengths]."""
    bends: FloatArray
    """Angle of each joint, shape (M, N - 1) [rad]."""
    step: float
    """Distance s that the wave moves the worm [body lengths]."""

    def at(self, tau: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the extensions of segments, and the angles of joints, at K instants; 0 outside the wave."""
        place = np.clip(tau * INSTANTS_PER_STEP, 0.0, len(self.bends) - 1.0)
        k = np.minimum(place.astype(int), len(self.bends) - 2)
        share = (place - k)[:, None]
        lengthened, bends = ((1.0 - share) * part[k] + share * part[k + 1] for part in self[:2])
        return lengthened, bends


@documented
@dataclass(frozen=True, kw_only=True)
class PlannedTurn(ExtendingGait, name="planned_turn"):
    """Waves that turn the worm and let standing segments keep their places, (N1) to (N3).

    Each wave turns the worm by `turn` until the `total` is reached; then the worm goes straight on.

    Raises
    ------
    ValueError
        The worm has no segment to stand on, or cannot turn so far within the reach of its segments.
    """

    amplitude: float = parameter(0.3, meaning="contraction of a standing segment", gt=0)
    period: float = parameter(5.0, meaning="time between two waves", unit="s", gt=0)
    turn: float = parameter(0.0, meaning="turn of a wave, positive to the left", unit="rad")
    total: float = parameter(
        np.inf,
        meaning="turn after which the worm goes straight on",
        unit="rad",
        gt=0,
        infinite=True,
        left_out="it turns on and on",
    )
    swinging: int = parameter(2, meaning="number of segments that are extended at a time", ge=1)
    extension: float = longer(-1 / 3)
    turning = (*Gait.turning, "turn", "total")

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s] in a straight wave, (K, segments), in [extension, 1]."""
        extended = np.zeros((len(times), segments))
        for wave, tau in _waves(times / self.period * segments, segments):
            extended += _extended(np.where(wave >= 0, tau, 0.0), segments, self.swinging)
        return self.activation_of(extended)

    def require_body(self, segments: int) -> None:
        """Raise ValueError if the gait does not fit a body with this number of segments."""
        plan(self._reach(segments, (-np.inf, np.inf)), self.turn)

    def commands(self, times: FloatArray, worm: Body) -> Commands:
        """Return the commands to `worm` at K times [s]: lengths and bends as planned."""
        n, reach = worm.segments, self._reach(worm.segments, worm.stroke)
        lengths, bends = np.full((len(times), n), reach.contracted), np.zeros((len(times), n - 1))
        for wave, tau in _waves(times / self.period * n, n):
            turns = self._turn_of(wave)
            for turn in np.unique(turns[wave >= 0]):
                rows = (wave >= 0) & (turns == turn)
                longer, bent = plan(reach, float(turn)).at(tau[rows])
                lengths[rows] += longer
                bends[rows] += bent
        given = self.applied((1.0 - n * lengths) / self.amplitude, worm)
        return given._replace(hinge=given.hinge + bends)

    def _turn_of(self, waves: FloatArray) -> FloatArray:
        """Return the turns of waves with given numbers, counted from 0, shape (K,) [rad]."""
        size = abs(self.turn)
        return np.copysign(np.clip(self.total - size * waves, 0.0, size), self.turn)

    def _reach(self, segments: int, stroke: tuple[float, float]) -> Reach:
        if segments < self.swinging + 2:
            raise ValueError(
                f"swinging: got {self.swinging}, must be at most {segments - 2} in a worm of {segments} segments: one "
                "more lands, and one stands"
            )
        least, greatest = max(self.amplitude * self.extension, stroke[0]), min(self.amplitude, stroke[1])
        return Reach(segments, self.swinging, (1.0 - greatest) / segments, (1.0 - least) / segments)


def _waves(tau: FloatArray, segments: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return, for the latest and the previous wave at K instants [steps], the number from 0 on and the elapsed time."""
    number = np.floor(tau / segments)
    return [(number - back, tau - (number - back) * segments) for back in (0, 1)]


def _extended(tau: FloatArray, segments: int, swinging: int) -> FloatArray:
    """Return the share of extension of each segment at K instants of a wave, (N2), shape (K, N)."""
    since = tau[:, None] - np.arange(segments)[::-1]
    return np.asarray(half_cosine(since) - half_cosine(since - swinging))


@lru_cache(maxsize=64)
def plan(reach: Reach, turn: float) -> Plan:
    """Return the wave with the longest step that turns a worm by an angle [rad].

    Raises
    ------
    ValueError
        The angle is out of reach.
    """
    straight = reach.swinging * (reach.extended - reach.contracted)
    shorter = 0.0 if turn == 0.0 else _shortening(reach, turn, straight)
    found = None if shorter is None else _joined(reach, turn, (1.0 - shorter) * straight, INSTANTS_PER_STEP)
    if found is None:
        raise ValueError(
            f"turn: got {turn:.4g} rad ({np.degrees(turn):.4g} degrees), must be less: {reach.swinging} swinging "
            f"segments of {reach.contracted:.4g} to {reach.extended:.4g} body lengths cannot turn the worm so far in a "
            "wave"
        )
    return found


def _shortening(reach: Reach, turn: float, straight: float) -> float | None:
    """Return the smallest relative shortening of a turning step that makes the turn possible.

    None if there is none.
    """
    # Short steps are tried last: a chain that is strongly compressed buckles into a different shape.
    fitting = (k for k, share in enumerate(SHORTENING_CANDIDATES) if _fits(reach, turn, (1.0 - share) * straight))
    first = next(fitting, None)
    if first is None:
        return None
    low, high = (0.0, *SHORTENING_CANDIDATES)[first : first + 2]
    for _ in range(12):
        middle = (low + high) / 2.0
        low, high = (low, middle) if _fits(reach, turn, (1.0 - middle) * straight) else (middle, high)
    return high


def _fits(reach: Reach, turn: float, step: float) -> bool:
    """Return whether a wave of a given turn and step is within reach."""
    found = _joined(reach, turn, step, 4)  # instants in a step; these are enough to find the length of the step
    return found is not None and found.lengthened.max() <= reach.extended - reach.contracted + JOINED


def _joined(reach: Reach, turn: float, step: float, samples: int) -> Plan | None:
    """Return the wave of a given turn and step, (N3); None if tail and head cannot be joined."""
    n, k = reach.segments, np.arange(reach.swinging)
    tau = np.arange(1, (n + reach.swinging) * samples) / samples  # at both ends all segments stand
    free = _extended(tau, n, reach.swinging)
    wide = np.pad(free, ((0, 0), (1, 1)))
    give = np.hstack([free / n**2, np.maximum(wide[:, 1:], wide[:, :-1])])
    straight = np.hstack([reach.contracted + free * (reach.extended - reach.contracted), np.zeros((len(tau), n + 1))])
    tail, head = (
        _end(half_cosine(tau[:, None] - begin - k).mean(axis=1), side, reach, turn, step)
        for begin, side in ((n, -1.0), (0, 1.0))
    )
    shape = straight
    for _ in range(12):  # 6 are enough for turns of 20 degrees
        gap, slope = _gap(shape, tail, head)
        back, weighted = straight - shape, slope * give[:, None]
        missing = gap + np.einsum("kij,kj->ki", slope, back)
        force = np.linalg.solve(weighted @ slope.transpose(0, 2, 1), -missing[..., None])
        change = back + np.einsum("kij,ki->kj", weighted, force[..., 0])
        largest = np.abs(change[:, n:]).max(axis=1, initial=LARGEST_CHANGE)
        shape = shape + change * (LARGEST_CHANGE / largest)[:, None]
    if np.abs(_gap(shape, tail, head)[0]).max() > JOINED:
        return None
    still = np.pad(shape, ((1, 1), (0, 0)), constant_values=0.0)
    still[[0, -1], :n] = reach.contracted
    return Plan(still[:, :n] - reach.contracted, still[:, n + 1 : -1], step)


def _end(share: FloatArray, side: float, reach: Reach, turn: float, step: float) -> FloatArray:
    """Return the pose x, y, heading of the tail (side -1) or the head (1) at shares p, (N1), shape (K, 3)."""
    x, angle = side * reach.segments * reach.contracted / 2.0, share * turn
    ahead, across = x * np.cos(angle), x * np.sin(angle)
    return np.column_stack(
        [ahead + share * step * np.cos(angle / 2.0), across + share * step * np.sin(angle / 2.0), angle]
    )


def _gap(shape: FloatArray, tail: FloatArray, head: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gap between the head and a chain from the tail, (K, 3), and its derivatives, (K, 3, 2 N + 1).

    The shape of the chain (K, 2 N + 1) consists of N lengths and N + 1 bends.
    """
    n = shape.shape[1] // 2
    heading = tail[:, 2:] + np.cumsum(shape[:, n:], axis=1)
    cosine, sine = np.cos(heading[:, :n]), np.sin(heading[:, :n])
    forward, left = shape[:, :n] * cosine, shape[:, :n] * sine
    gap = np.column_stack([forward.sum(axis=1), left.sum(axis=1), heading[:, n]])
    gap[:, :2] += tail[:, :2]
    slope = np.zeros((len(shape), 3, 2 * n + 1))
    slope[:, 0, :n], slope[:, 1, :n] = cosine, sine
    slope[:, 0, n:-1] = -np.cumsum(left[:, ::-1], axis=1)[:, ::-1]  # a bend turns all segments ahead
    slope[:, 1, n:-1] = np.cumsum(forward[:, ::-1], axis=1)[:, ::-1]
    slope[:, 2, n:] = 1.0
    return gap - head, slope
