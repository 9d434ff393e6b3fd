"""Gait of a stable heteroclinic cycle, in which segments are active in turn. Noise and feedback set the pace.

The cycle is defined in `control.gaits.shc.cycle`, (SH1) and (SH2). The i-th segment in the direction of the wave is at
node i mod nodes. The segment is active while this node or one of the next `breadth` - 1 nodes is active; the activation
is the sum of a/beta over these nodes, at most 1. The unit of time of the cycle is chosen for a mean duration of
`period` without feedback.

*Feedback* makes the cycle continue as soon as the active segments have contracted or bear enough load. Each node whose
segments have shortened, on average over their chambers, by the share `strain_threshold` of the amplitude, or bear
`load_threshold` on average, gives the next node j an input as long as it is active,

    u_j = gain alpha_i beta_j a_i/beta_i,                                                                   (SH6)

so that a_j reaches its saddle within about ln(nu/gain) nu/alpha instead of (SH3). With little noise the cycle waits
long for feedback: the mean time of (SH5) is the longest mean wait before the cycle continues without feedback.
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
        2.0, meaning="mean time between two contractions of a segment, without feedback", unit="s", gt=0
    )
    direction: Direction = direction_of_waves()
    nodes: int = parameter(
        0,
        meaning="nodes of the cycle, 3 or more; there are segments/nodes waves on the body; 0: a node a segment",
        ge=0,
    )
    breadth: int = parameter(1, meaning="neighbouring nodes that are contracted at a time", ge=1)
    alpha: float = parameter(
        2.0, meaning="rate alpha of each node, in the cycle's own unit of time", ge=0, each="segment"
    )
    beta: float = parameter(1.0, meaning="size beta of each node's state", gt=0, each="segment")
    nu: float = parameter(
        1.5, meaning="saddle value nu of each node: how much faster states decay to it than leave", gt=1, each="segment"
    )
    saddle_noise: float = parameter(
        1e-8, meaning="size of the noise, of a state in the square root of the cycle's own unit of time", ge=0
    )
    strain_gain: float = parameter(0.0, meaning="gain of the feedback by strain; 0: none", ge=0)
    strain_threshold: float = parameter(
        0.7, meaning="shortening at which a segment has done its part, as a share of the amplitude", gt=0
    )
    load_gain: float = parameter(0.0, meaning="gain of the feedback by contact load; 0: none", ge=0)
    load_threshold: float = parameter(1.0, meaning="contact load at which a segment has done its part", unit="N", gt=0)
    seed: int = parameter(0, meaning="seed of the noise; the seed of a scene does not change it", ge=0)
    lengthens = False

    @property
    def senses(self) -> tuple[str, ...]:
        """Channels whose feedback has a gain above 0."""
        gains = {"strain": self.strain_gain, "contact_load": self.load_gain}
        return tuple(name for name, gain in gains.items() if gain)

    def cycle(self, segments: int) -> Cycle:
        """Return the cycle of a body with the given number of segments, in seconds; the period is the gait's.

        Raises
        ------
        ValueError
            Fewer than three nodes or more than segments, arrays that do not fit, or too much noise.
        """
        from control.gaits.shc.cycle import Cycle

        nodes = self.nodes or segments
        if not 3 <= nodes <= segments:
            raise ValueError(f"nodes: got {nodes}, must be 3 or more, and not more than the worm's {segments} segments")
        if self.breadth >= nodes:
            raise ValueError(f"breadth: got {self.breadth}, must be below the {nodes} nodes of the cycle")
        along = self.order(segments)[:nodes]
        own = {}
        for name in ("alpha", "beta", "nu"):
            arguments.require_count(name, getattr(self, name), segments)
            own[name] = np.broadcast_to(getattr(self, name), segments)[along]
        return Cycle(nodes, **own, noise=self.saddle_noise).lasting(self.period)

    def order(self, segments: int) -> IntArray:
        """Return the segments in the direction of the wave, shape (segments,)."""
        return np.arange(segments)[:: 1 if self.direction == "direct" else -1]

    def start(self, body: Body) -> Turns:
        """Return a fresh memory: node 0 is active."""
        return Turns(self, body.segments)


class Turns:
    """Memory of an `SHC`: the walk of the cycle, and the node of each segment."""

    def __init__(self, gait: SHC, segments: int) -> None:
        from control.gaits.shc.cycle import Walk

        self._gait, self._walk = gait, Walk(gait.cycle(segments), gait.seed)
        self._node = gait.order(segments) % self._walk.cycle.nodes  # the order is self-inverse
        self._begun: float | None = None
        self._taken, self._before = 0, self._walk.states.copy()

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the activation of the segments, shape (N,). Times must increase."""
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
