"""The supervisor: model predictive control with all that is needed for commands to follow, whatever becomes of plans.

It is the loop of `control.loop`, with the choice of the wave's parameters by `control.planning.fallback`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np

from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from control.estimation.reduced import ReducedModel
from control.gaits.steering import Mechanism, Schedule
from control.identification.identified import Identified
from control.loop import Estimates, WaveController
from control.planning.fallback import Fallback, Planner
from control.planning.mpc import GaitMPC
from control.planning.plan import Choice
from control.sensing.channels import Channel
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values import arguments

Deadline = Literal["iterations", "wall"]


class Supervisor(WaveController):
    """A controller for `worm3d.simulate` that plans; `failures` counts the decisions without an accepted plan.

    Parameters
    ----------
    worm, reference, schedule, control_period, estimator
        See `control.loop.WaveController`.
    model : ReducedModel
    mpc : Planner
    deadline : str
        "iterations": a plan may take as many as it is given, and runs repeat bit for bit; "wall": one that took longer
        than the control period is not accepted.

    Raises
    ------
    ValueError
        A control period that is not above 0, or another deadline.
    """

    plans = True

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
        arguments.choice("deadline", deadline, get_args(Deadline))
        self._fallback = Fallback(model, mpc, reference, control_period if deadline == "wall" else np.inf)
        super().__init__(worm, reference, schedule or Schedule(), mpc.feed_forward, control_period, estimator)

    @classmethod
    def of(
        cls,
        worm: Worm,
        reference: Reference,
        identified: Identified,
        mechanism: Mechanism = "hinge",
        control_period: float = 0.2,
        sensors: Mapping[str, Channel] | None = None,
        deadline: Deadline = "iterations",
    ) -> Supervisor:
        """Return the supervisor of a worm that was identified; see `WaveController.of`."""
        model = ReducedModel.of(worm, identified, mechanism)
        estimator = Estimator.for_sensors(worm, model, identified.schedule, sensors or {})
        mpc = GaitMPC(worm, identified, model)
        return cls(worm, reference, model, estimator, mpc, identified.schedule, control_period, deadline)

    def reset(self) -> None:
        """Begin anew."""
        super().reset()
        self._fallback.reset()

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        assert estimate is not None
        return self._fallback.choose(t, estimate, self._target, self.generator.waves)
