"""The supervisor: from measurements to commands.

At every step the estimator takes the measurement and the wave generator gives the command; once a control period the
wave's parameters are chosen, `control.ladder`, and the decision is written down.
"""

from __future__ import annotations

from time import perf_counter
from typing import Literal, Protocol

import numpy as np

from control.decision import Decision
from control.estimator import Estimate, Estimator
from control.generator import WaveGenerator
from control.identification import Identified
from control.ladder import Ladder, Planner
from control.measurement import Measurement
from control.mpc import GaitMPC
from control.reduced import ReducedModel
from control.references import Reference
from control.steering import GaitParameters, Mechanism, Schedule
from worm3d import Command, Worm

Deadline = Literal["iterations", "wall"]


class Estimates(Protocol):
    """What gives estimates, such as `control.estimator.Estimator`."""

    def reset(self) -> None:
        """Begin anew."""

    def update(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> Estimate:
        """Return the estimate of time t [s]; the parameters were asked for since the call before."""


class Supervisor:
    """A controller for `worm3d.simulate`.

    Parameters
    ----------
    worm : Worm
    reference : Reference
    model : ReducedModel
    estimator : Estimates
    mpc : Planner
    schedule : Schedule, optional
        For which the worm was identified.
    control_period : float
        Between decisions [s].
    deadline : str
        "iterations": a plan may take as many as it is given, and runs repeat bit for bit; "wall": one that took longer
        than the control period is not accepted.

    Attributes
    ----------
    decisions : list of Decision
        `seconds` of each is the time of all steps since the decision before, estimates and commands included.
    failures : int
        Decisions for which there should have been an accepted plan, and was none.

    Raises
    ------
    ValueError
        A control period that is not above 0, or another deadline.
    """

    def __init__(
        self,
        worm: Worm,
        reference: Reference,
        model: ReducedModel,
        estimator: Estimates,
        mpc: Planner,
        schedule: Schedule | None = None,
        control_period: float = 0.2,
        deadline: Deadline = "iterations",
    ) -> None:
        if not (np.isfinite(control_period) and control_period > 0.0):
            raise ValueError(f"control_period: got {control_period!r} s, must be finite and above 0")
        if deadline not in ("iterations", "wall"):
            raise ValueError(f"deadline: got {deadline!r}, must be 'iterations' or 'wall'")
        self.reference, self.estimator, self.control_period = reference, estimator, control_period
        self.generator = WaveGenerator(schedule or Schedule(), worm)
        self._ladder = Ladder(model, mpc, reference, control_period if deadline == "wall" else np.inf)
        self._frequency = mpc.feed_forward.frequency
        self.reset()

    @classmethod
    def of(
        cls,
        worm: Worm,
        reference: Reference,
        identified: Identified,
        mechanism: Mechanism = "hinge",
        control_period: float = 0.2,
        deadline: Deadline = "iterations",
    ) -> Supervisor:
        """Return the supervisor of a worm that was identified, with the defaults of all its parts."""
        model = ReducedModel.of(worm, identified, mechanism)
        estimator, mpc = Estimator(worm, model, identified.schedule), GaitMPC(worm, identified, model)
        return cls(worm, reference, model, estimator, mpc, identified.schedule, control_period, deadline)

    def reset(self) -> None:
        """Begin anew."""
        self.estimator.reset()
        self.generator.reset()
        self._ladder.reset()
        self.decisions: list[Decision] = []
        self.failures = 0
        self._target = GaitParameters(0.0, self._frequency)
        self._time: float | None = None
        self._due, self._spent = -np.inf, 0.0

    @property
    def period(self) -> float:
        """Of the wave at the preferred frequency [s], over which `worm3d.simulate` averages."""
        return 1.0 / self._frequency

    @property
    def overruns(self) -> int:
        """Control periods of which the computation took longer than they last."""
        return sum(decision.seconds > self.control_period for decision in self.decisions)

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on."""
        began = perf_counter()
        elapsed, self._time = 0.0 if self._time is None else t - self._time, t
        estimate = self.estimator.update(t, measurement, self._target, self.generator.phase)
        if t >= self._due - 1e-9:
            self._decide(t, estimate, began)
            began = perf_counter()
        command = self.generator.step(elapsed, self._target)
        self._spent += perf_counter() - began
        return command

    def _decide(self, t: float, estimate: Estimate, began: float) -> None:
        """Choose the wave's parameters and write the decision down; a new control period begins."""
        choice = self._ladder.choose(t, estimate, self._target, self.generator.waves)
        self._target, self._due = choice.parameters, t + self.control_period
        self.failures += choice.failed
        plan = choice.plan
        self.decisions.append(
            Decision(
                time=t,
                source=choice.source,
                parameters=choice.parameters,
                estimate=estimate,
                status=choice.status,
                iterations=plan.iterations if plan else 0,
                cost=plan.cost if plan else float("nan"),
                seconds=self._spent + perf_counter() - began,
                horizon=plan.horizon if plan and choice.source == "mpc" else None,
            )
        )
        self._spent = 0.0
