"""The larva's chain of neurons as a gait: `EiChain`.

`control.gaits.neural.network` defines the equations. The segment at one end of the body gets the constant `drive`,
above the threshold, as its input h: this segment bursts repeatedly without other input, and each burst runs along the
body. Drive at the tail causes direct waves, as in a larva that crawls forward, and drive at the head causes retrograde
waves. There is no other difference. The input of all populations of the left side is increased by `asymmetry` times
TURNING, and the input of the right side is reduced by the same amount.

The pace is an input as well. A faster pace shortens the time constants: tau_I is adjusted until the waves have the
period T, and tau_E changes less, with the exponent p:

    tau_E = tau_2 (T/2 s)^p  for T >= FASTEST,  in proportion to T below                                      (EI4)

Delays from segment to segment follow tau_E: p = 1 keeps the phases at every pace, a small p keeps the delays.

Feeling: F = -strain/(FELT amplitude), clipped to [0, 1], is the share of the contraction that a chamber shows. With
`feedback` = phi > 0 a segment's burst lasts until its chambers have contracted, the neighbour waits for this
contraction, and the next burst waits for the chambers' return: the actuators and the load then limit the speed of the
wave.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from control.gaits.feedback import FeedbackGait, Felt
from control.gaits.gait import Body, Direction, direction_of_waves
from control.gaits.neural.network import Network
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

SELF_WEIGHT, CROSS_WEIGHT, SIGMOID_WIDTH = 1.5, 1.0, 0.2
"""Weights of E on itself and on the other side, and width of the sigmoid, in units of the threshold. Since SELF_WEIGHT
is above 1, a burst outlasts its trigger. Since CROSS_WEIGHT is about as large as the threshold, one side can trigger
the other side if the other side has failed to burst."""
FELT = 0.5
"""Share of the commanded contraction that counts as a full contraction. Friction may prevent the rest."""
TURNING = 0.4
"""Input of each side at asymmetry 1, in units of the threshold. It is below 1, so that it cannot trigger a burst
without other input."""
TAU_E = (0.08181, 0.07674, 0.07443, 0.06863, 0.08121, 0.1008, 0.09251)
"""Time constants tau_2 of the segments A7 to A1 [s]. They and the other defaults were fitted to the recordings 3a and
3c of `scenes/data/larva_denticle_bands.csv` without shrinkage. The recordings determine the size, the exponent and a
part of the profile (`control.gaits.neural.shared`), but not each single constant."""
FASTEST = 1.5
"""Period below which all time constants are shortened in proportion [s]. It is the fastest pace of third-instar larvae,
and the exponent is unknown for faster waves."""


@documented
@dataclass(frozen=True, kw_only=True)
class EiChain(FeedbackGait, name="ei_chain"):
    """Waves of a chain of excitatory and inhibitory neurons, trained on larvae."""

    period: float = parameter(2.0, meaning="pace: time between two waves if nothing is felt", unit="s", gt=0, le=1e3)
    direction: Direction = direction_of_waves("direct")
    asymmetry: float = parameter(
        0.0,
        meaning="input added to the left side and taken from the right side",
        ge=-1,
        le=1,
        allowed="a number in [-1, 1]",
    )
    feedback: float = parameter(
        0.0, meaning="share of the felt contraction, by strain, in a segment's activity; 0: not felt", ge=0, le=1
    )
    coupling: float = parameter(2.0, meaning="weight of a neighbour, in thresholds", gt=1)
    drive: float = parameter(2.0, meaning="input of the end that begins the waves, in thresholds", gt=1)
    inhibition: float = parameter(5.399, meaning="weight of inhibition on excitation, in thresholds", gt=0)
    tau_e: FloatArray = parameter(
        TAU_E,
        meaning="tau_2, time constants of excitation of equally long parts of the body, from tail to head",
        unit="s",
        gt=0,
        each="sample",
        allowed="above 0, a list of numbers from tail to head",
    )
    pace_exponent: float = parameter(0.5812, meaning="exponent p of the delays as a function of the period", ge=0, le=2)
    lengthens = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tau_e.ndim > 1:
            raise ValueError(f"tau_e: got shape {self.tau_e.shape}, must be a list of numbers from tail to head")

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the sensed channels: strain, if any."""
        return ("strain",) if self.feedback and self.amplitude else ()

    def network(self, segments: int) -> Network:
        """Return the network of a body whose waves have the period of the gait.

        ValueError if there are no such waves.
        """
        places, known = (np.arange(segments) + 0.5) / segments, np.atleast_1d(self.tau_e)
        tau_e = np.interp(places, (np.arange(len(known)) + 0.5) / len(known), known)
        slower = max(self.period, FASTEST)
        tau_e *= (slower / 2.0) ** self.pace_exponent * (self.period / slower)
        return pace(tuple(tau_e.tolist()), self.coupling, self.drive, self.inhibition, self.source, self.period)

    def drives(self, segments: int) -> FloatArray:
        """Return the input h of each population E, shape (segments, 2)."""
        drives = np.zeros((segments, 2))
        drives[self.source] = self.drive
        return drives + TURNING * self.asymmetry * np.array([1.0, -1.0])

    @property
    def source(self) -> int:
        """Index of the segment that begins the waves."""
        return 0 if self.direction == "direct" else -1

    def start(self, body: Body) -> Chain:
        """Return the initial memory for one run of a body."""
        return Chain(self, body.segments)


class Chain:
    """State of an `EiChain` during a run."""

    def __init__(self, gait: EiChain, segments: int) -> None:
        network = gait.network(segments)
        self._share, self._per_strain = (gait.feedback, -1.0 / (FELT * gait.amplitude)) if gait.senses else (0.0, 0.0)
        self._constants, self._drives, self._dt = network.packed(), gait.drives(segments), network.step
        self._rates, self._before = network.start(), network.start()
        self._begin, self._steps = np.nan, 0

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] on an internal grid, and return E by linear interpolation, shape (N, 2)."""
        from control.gaits.neural.kernel import advance

        if np.isnan(self._begin):
            self._begin = t
        strain = felt.get("strain")
        contracted = np.zeros_like(self._drives) if strain is None else np.clip(self._per_strain * strain, 0.0, 1.0)
        ahead = (t - self._begin) / self._dt
        if (missing := int(np.ceil(ahead)) - self._steps) > 0:
            held = (self._constants, self._drives, self._share, np.ascontiguousarray(contracted), self._dt)
            advance(self._rates, *held, missing - 1)
            self._before = self._rates.copy()
            advance(self._rates, *held, 1)
            self._steps += missing
        part = ahead - (self._steps - 1)
        return np.asarray(self._before[0] + part * (self._rates[0] - self._before[0]))


@lru_cache(maxsize=256)
def pace(
    tau_e: tuple[float, ...], coupling: float, drive: float, inhibition: float, source: int, period: float
) -> Network:
    """Return a network with equal sides whose waves have the given period [s] without turning and without feeling.

    Raises
    ------
    ValueError
        The network makes no waves, or no waves of this period.
    """
    if min(tau_e) < period / 1000.0:
        raise ValueError(
            f"tau_e: got {min(tau_e):g} s at a period of {period:g} s, must be at least a 1000th of the period, since "
            "the time steps are proportional to tau_e"
        )
    drives = np.zeros((len(tau_e), 2))
    drives[source] = drive
    tau_i = 0.35 * period
    for _ in range(20):
        made = chain(np.array(tau_e), tau_i, coupling, inhibition)
        found = period_of(made, drives, source)
        if not np.isfinite(found):
            break
        if abs(found / period - 1.0) < 1e-5:
            return made
        tau_i *= period / found
    raise ValueError(
        f"period: got {period:g} s, must be a period at which waves run along all segments; this coupling, "
        "inhibition and drive make no waves, or tau_e is too large for the period"
    )


def chain(tau_e: FloatArray, tau_i: float, coupling: float, inhibition: float) -> Network:
    """Return a network with equal sides. `tau_e` contains the time constants of E from tail to head, shape (N,) [s]."""
    ones = np.ones((len(tau_e), 2))
    headward, tailward = coupling * ones, coupling * ones
    headward[0], tailward[-1] = 0.0, 0.0
    return Network(
        tau_e=tau_e[:, None] * ones,
        tau_i=tau_i * ones,
        itself=SELF_WEIGHT * ones,
        across=CROSS_WEIGHT * ones,
        headward=headward,
        tailward=tailward,
        inhibition=inhibition * ones,
        threshold=ones,
        width=SIGMOID_WIDTH * ones,
    )


def period_of(network: Network, drives: FloatArray, source: int) -> float:
    """Return the time between the last two bursts at the source [s]. NaN if there are no bursts."""
    from control.gaits.neural.kernel import onsets

    rates, dt = network.start(), network.step
    times = onsets(rates, network.packed(), drives, dt, int(14.0 * network.tau_i.mean() / dt))[0][source, 0]
    times = times[np.isfinite(times)]
    return float(times[-1] - times[-2]) if len(times) > 2 else np.nan
