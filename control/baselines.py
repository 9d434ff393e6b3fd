"""Baselines for a comparison with the MPC, with the same interface and the same identified map.

`OpenLoop` is feed-forward only: it uses the wave that has the reference's speed and turn rate according to the map.
`PiLineOfSight` adds feedback from the same estimator that the MPC uses. With the estimated speed V and heading h, the
heading psi and curvature kappa of the path, and the offset e to the left of the path (L2),

    V_cmd = V_ref + K_p (V_ref - V) + K_i int (V_ref - V) dt                                                   (B1)
    h_ref = psi - arctan(e / reach),  + backwards              line of sight                                   (B2)
    w_cmd = kappa V_ref + K_h (h_ref - h)                      (h_ref' instead of kappa V_ref without a path)  (B3)

The map then gives the amplitude, frequency and steering for V_cmd and w_cmd. The integral is bounded, and it is frozen
while V_cmd cannot be reached. (B2) is Fossen's guidance law (Handbook of Marine Craft Hydrodynamics and Motion Control,
2nd edition, 12.4).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Self

from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from control.estimation.reduced import ReducedModel
from control.gaits.steering import GaitParameters
from control.loop import Choice, Estimates, Source, WaveController, observed
from control.task import ControlTask
from control.tracking.paths import offset
from control.tracking.preview import turn_of_path, turn_rate
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked


class _Baseline(WaveController):
    """A controller that needs only the identified map. Parameters as for `control.loop.WaveController`."""

    source: Source

    def __init__(self, task: ControlTask, estimator: Estimates | None = None) -> None:
        self.identified, self.mechanism = task.map, task.mechanism
        super().__init__(task, estimator=estimator)

    def _wave(self, speed: float, turn_rate: float) -> GaitParameters:
        """Return the wave for a speed [m/s] and a turn rate [rad/s].

        Below the slowest speed of the map the worm stands.
        """
        amplitude, frequency, steering = map(float, self.feed_forward(speed, turn_rate))
        if not self.feed_forward.goes(speed):
            amplitude, steering = 0.0, 0.0
        return GaitParameters(amplitude, frequency).steered(self.mechanism, steering)

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        return Choice(self.source, self._parameters(t, estimate), "")

    @abstractmethod
    def _parameters(self, t: float, estimate: Estimate | None) -> GaitParameters: ...


class OpenLoop(_Baseline):
    """Feed-forward without feedback. Effects that the map does not contain are not corrected."""

    source: Source = "open_loop"

    def reset(self) -> None:
        """Return to the initial state."""
        super().reset()
        self._progress = 0.0

    def _parameters(self, t: float, estimate: Estimate | None) -> GaitParameters:
        speed = float(self.reference.speed(t))
        wave = self._wave(speed, turn_rate(self.reference, t, self._progress))
        self._progress += self.control_period * speed
        return wave


@documented
@dataclass(frozen=True)
class Gains(Checked):
    """Gains of (B1) to (B3).

    The gains were tuned on the default worm at 0.08 m/s with the default sensor noise, in runs of one minute. First,
    seven pairs of reach (0.1 to 0.2) and K_h (0.8 to 1.8) were compared on a line, a circle and an S-curve with the
    seeds 10 and 11. Their mean rms offsets were 0.0023 body lengths (the chosen pair) to 0.0029. Then four pairs of K_p
    (0.3, 0.6) and K_i (0.15, 0.3) were compared, and the pair with the smallest error of the speed was chosen. The
    reference speeds were steps and a sine, and one run was in a pipe.
    """

    speed: float = parameter(0.6, "K_p, gain of the speed", ge=0)
    speed_integral: float = parameter(0.3, "K_i, gain of the integral of the speed error", "1/s", ge=0)
    heading: float = parameter(1.2, "K_h, gain of the heading", "1/s", ge=0)
    reach: float = parameter(0.15, "look-ahead distance of (B2)", "body lengths", gt=0)


class PiLineOfSight(_Baseline):
    """PI control of the speed and line-of-sight steering, (B1) to (B3)."""

    source: Source = "pi_los"

    def __init__(self, task: ControlTask, estimator: Estimates | None = None, gains: Gains | None = None) -> None:
        self.gains = gains or Gains()
        super().__init__(task, observed(task)[1] if estimator is None else estimator)

    @classmethod
    def of(
        cls,
        task: ControlTask,
        *,
        model: type[ReducedModel] = ReducedModel,
        estimator: type[Estimator] = Estimator,
        gains: Gains | None = None,
    ) -> Self:
        """Return the controller for a task. Model, estimator and gains are the supplied ones by default."""
        return cls(task, observed(task, model, estimator)[1], gains)

    def reset(self) -> None:
        """Return to the initial state."""
        super().reset()
        self._trim = 0.0
        self._near: float | None = None

    def _parameters(self, t: float, estimate: Estimate | None) -> GaitParameters:
        assert estimate is not None
        return self._wave(self._speed(t, estimate), self._turn(t, estimate))

    def _speed(self, t: float, estimate: Estimate) -> float:
        """Return V_cmd, (B1)."""
        gains, wanted = self.gains, float(self.reference.speed(t))
        miss = wanted - estimate.speed
        asked = wanted + gains.speed * miss + self._trim
        if self._reaches(asked):
            most = 0.5 * abs(wanted)
            more = self._trim + gains.speed_integral * miss * self.control_period
            self._trim = min(max(more, -most), most)
        return asked

    def _reaches(self, speed: float) -> bool:
        amplitude, *others = self.feed_forward(speed, 0.0)
        made = self.worm.length * float(self.task.found.speed(abs(amplitude), *others))
        return abs(made - abs(speed)) <= 0.01 * abs(speed)

    def _turn(self, t: float, estimate: Estimate) -> float:
        """Return w_cmd, (B2) and (B3).

        As in the MPC, this is the turn rate of the path as long as the heading is unknown.
        """
        reference = self.reference
        if not self._heading_is_known(estimate):
            return turn_of_path(reference, t, estimate.position)
        if reference.path is not None:
            self._near = s = float(reference.path.project(estimate.position, self._near))
            aside = float(offset(reference.path, estimate.position, s))
            sight = math.atan(aside / (self.gains.reach * self.worm.length))
            wanted = float(reference.path.heading(s)) - math.copysign(sight, float(reference.speed(t)) * sight)
        elif reference.heading is not None:
            s, wanted = 0.0, float(reference.heading(t))
        else:
            return 0.0
        # The remainder lies in [-pi, pi]; opposite angles have opposite remainders.
        return turn_rate(reference, t, s) + self.gains.heading * math.remainder(wanted - estimate.heading, math.tau)
