"""Gait of a stable heteroclinic cycle: the segments are active one after the other, timed by noise and feedback.

The cycle, (SH1) and (SH2), is defined in `control.gaits.shc.cycle`. It consists of nodes that become active one after
the other; a_i is the state of node i, and beta_i its value while the node is active. The i-th segment in the direction
of the wave belongs to node i mod `nodes`. A segment is active while its node or one of the next `breadth` - 1 nodes is
active. Its activation is the sum of a/beta of these nodes, but at most 1. The time scale of the cycle is chosen so that
the mean duration of a cycle without feedback is `period`.

*Feedback* makes the cycle continue as soon as the active segments have contracted or bear a load. A segment triggers
the feedback if the mean shortening of its chambers reaches the fraction `strain_threshold` of the amplitude, or if its
contact load reaches `load_threshold`. While a node i is active, its triggering segments give the next node j an input.
The input is proportional to the mean of their gains over the segments of node i:

    u_j = gain alpha_i beta_j a_i/beta_i                                                                    (SH6)

With this input, the next node becomes active within about ln(nu/gain) nu/alpha, instead of the time (SH3) without
feedback. If the noise is small, the cycle can wait for feedback for a long time: on average it continues without
feedback after the time (SH5) of `control.gaits.shc.cycle`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from control.gaits.feedback import FeedbackGait, Felt
from control.gaits.gait import Body, Direction, direction_of_waves
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.values.parameters import documented, parameter

if TYPE_CHECKING:
    from control.gaits.shc.cycle import Cycle


@documented
@dataclass(frozen=True, kw_only=True, eq=False)
class SHC(FeedbackGait, name="shc"):
    """Stable heteroclinic cycle of the segments (Horchler, Daltorio, Chiel, Quinn 2015), with feedback, (SH6)."""

    period: float = parameter(
        2.0, meaning="mean time between successive contractions of a segment, without feedback", unit="s", gt=0
    )
    direction: Direction = direction_of_waves()
    nodes: int = parameter(
        0,
        meaning="number of nodes, 3 or more; 0: one node per segment. The body has segments/nodes waves",
        ge=0,
    )
    breadth: int = parameter(1, meaning="number of neighbouring nodes whose segments contract at a time", ge=1)
    alpha: float = parameter(
        2.0, meaning="rate alpha of each node; the time scale follows from the period", ge=0, each="segment"
    )
    beta: float = parameter(1.0, meaning="value beta of each node's state while active", gt=0, each="segment")
    nu: float = parameter(
        1.5,
        meaning="saddle value nu of each node: rate of approach to the node divided by rate of leaving",
        gt=1,
        each="segment",
    )
    saddle_noise: float = parameter(
        1e-8, meaning="intensity of the noise of the states; the time scale follows from the period", ge=0
    )
    strain_gain: float = parameter(0.0, meaning="gain of the feedback by strain; 0: no feedback", ge=0)
    strain_threshold: float = parameter(
        0.7, meaning="shortening that triggers the feedback, as a fraction of the amplitude", gt=0
    )
    load_gain: float = parameter(0.0, meaning="gain of the feedback by contact load; 0: no feedback", ge=0)
    load_threshold: float = parameter(1.0, meaning="contact load that triggers the feedback", unit="N", gt=0)
    seed: int = parameter(0, meaning="seed of the noise, independent of the seed of the scene", ge=0)
    lengthens = False

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the sensor channels whose feedback has a nonzero gain."""
        gains = {"strain": self.strain_gain, "contact_load": self.load_gain}
        return tuple(name for name, gain in gains.items() if gain)

    def cycle(self, segments: int) -> Cycle:
        """Return the cycle for a body with this number of segments, with the time in seconds and the gait's period.

        Raises
        ------
        ValueError
            There are fewer than three nodes or more nodes than segments, an array has an incorrect length, or the noise
            is too strong.
        """
        from control.gaits.shc.cycle import Cycle

        nodes = self.nodes or segments
        if not 3 <= nodes <= segments:
            raise ValueError(f"nodes: got {nodes}, must be at least 3 and at most the worm's {segments} segments")
        if self.breadth >= nodes:
            raise ValueError(f"breadth: got {self.breadth}, must be below the {nodes} nodes of the cycle")
        along = self.order(segments)[:nodes]
        own = {}
        for name in ("alpha", "beta", "nu"):
            arguments.require_count(name, getattr(self, name), segments)
            own[name] = np.broadcast_to(getattr(self, name), segments)[along]
        try:
            return Cycle(nodes, **own, noise=self.saddle_noise).lasting(self.period)
        except ValueError as error:
            raise ValueError(str(error).replace("noise:", "saddle_noise:", 1)) from error

    def order(self, segments: int) -> IntArray:
        """Return the segments in the direction of the wave, shape (segments,)."""
        return np.arange(segments)[:: 1 if self.direction == "direct" else -1]

    def start(self, body: Body) -> Turns:
        """Return the initial memory, with node 0 active."""
        return Turns(self, body.segments)


class Turns:
    """Memory of an `SHC`: the present state of the cycle, and the node of each segment."""

    def __init__(self, gait: SHC, segments: int) -> None:
        from control.gaits.shc.cycle import Walk

        self._gait, self._walk = gait, Walk(gait.cycle(segments), gait.seed)
        self._node = gait.order(segments) % self._walk.cycle.nodes  # the order is self-inverse
        self._begun: float | None = None
        self._taken, self._before = 0, self._walk.states.copy()

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the activation of the segments, shape (N,). Times must not decrease."""
        self._begun = t if self._begun is None else self._begun
        walk = self._walk
        walk.push[:] = self._push(felt)
        place = (t - self._begun) / walk.dt
        if (steps := int(np.ceil(place - 1e-9)) - self._taken) > 0:
            path = np.vstack([walk.states, walk.advance(steps)])
            self._before, self._taken = path[-2], self._taken + steps
        part = min(max(place - self._taken + 1.0, 0.0), 1.0)
        share = ((1.0 - part) * self._before + part * walk.states) / walk.cycle.beta
        reached = np.sum([np.roll(share, -k) for k in range(self._gait.breadth)], axis=0)
        return np.asarray(np.clip(reached, 0.0, 1.0)[self._node])

    def _push(self, felt: Felt) -> FloatArray:
        """Return the input of each node by (SH6), shape (n,)."""
        gait, cycle = self._gait, self._walk.cycle
        gain = np.zeros(len(self._node))
        if "strain" in felt:
            short = -felt["strain"].mean(axis=1) >= gait.strain_threshold * gait.amplitude
            gain += gait.strain_gain * short
        if "contact_load" in felt:
            gain += gait.load_gain * (felt["contact_load"].sum(axis=1) >= gait.load_threshold)
        done = np.bincount(self._node, gain, cycle.nodes) / np.bincount(self._node, minlength=cycle.nodes)
        return np.asarray(np.roll(done * cycle.alpha * self._walk.states / cycle.beta, 1) * cycle.beta)
