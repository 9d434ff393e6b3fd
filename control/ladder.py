"""The fallback ladder: which wave to ask for, whatever becomes of the plans on the way.

The first of these that there is:

1. an accepted plan ("mpc"): finite, no worse than the plan before and the plain wave, and in time;
2. the last accepted plan as it goes on ("shifted plan"), at most five times in a row;
3. the plain wave, the feed-forward of the identified map ("gait"), and nothing else until the heading is known: it
   turns as the path does, or goes straight;
4. the parameters in force ("gait"), at most five times in a row;
5. rest ("stop"), as also where the reference asks for (almost) no speed.

After three failures in a row the search forgets its last plan. The reference's clock never stops.
"""

from __future__ import annotations

import logging
from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np

from control.decision import Source
from control.estimator import Estimate
from control.feedforward import FeedForward
from control.plan import Plan
from control.preview import turn_rate
from control.reduced import ReducedInput, ReducedModel, ReducedState
from control.references import Reference
from control.steering import GaitParameters

MOST_SHIFTED = 5
"""Times in a row that a plan is used without a new one."""
MOST_HELD = 5
"""Times in a row that parameters are kept for want of anything better."""
FORGET = 3
"""Failures in a row after which the search begins anew."""
KNOWN = 0.08
"""Standard deviation below which the heading counts as known [rad]: whoever steers by a worse one leaves its path."""
LONGEST_START = 3.0
"""Waves after which it is steered with whatever is known."""

UNKNOWN = "the heading is not known yet: straight on, or as the path turns"
STANDS = "the reference asks for less speed than the worm can crawl at: it rests"
LATE = "the plan came too late"
LOST = "nothing is known to go by"

_HEADING = ReducedState._fields.index("heading")
_LOG = logging.getLogger(__name__)


class Planner(Protocol):
    """What plans, such as `control.mpc.GaitMPC`."""

    @property
    def feed_forward(self) -> FeedForward:
        """The identified map the other way round."""

    def reset(self) -> None:
        """Begin anew."""

    def forget(self) -> None:
        """Drop the last plan."""

    def plan(self, t: float, estimate: Estimate, reference: Reference) -> Plan:
        """Return the plan from time t [s] on."""

    def plain(self, t: float, slip: float, reference: Reference) -> ReducedInput:
        """Return the plain wave."""


class Choice(NamedTuple):
    """What was chosen."""

    source: Source
    parameters: GaitParameters
    status: str
    """Of the plan, or why there is none."""
    plan: Plan | None = None
    """That was made now, whether it was accepted or not."""
    failed: bool = False
    """Whether there should have been an accepted plan."""


class Ladder:
    """The choice, with the memory that it needs.

    Parameters
    ----------
    model : ReducedModel
    planner : Planner
    reference : Reference
    longest : float
        Time that a plan may take [s]; infinite where runs are to repeat bit for bit.
    """

    def __init__(self, model: ReducedModel, planner: Planner, reference: Reference, longest: float = np.inf) -> None:
        self._model, self.planner, self._reference, self._longest = model, planner, reference, longest
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.planner.reset()
        self._accepted: Plan | None = None
        self._failures = self._held = 0
        self._steers = False

    def choose(self, t: float, estimate: Estimate, in_force: GaitParameters, waves: float) -> Choice:
        """Return what to ask for from time t [s] on.

        Parameters
        ----------
        t : float
        estimate : Estimate
        in_force : GaitParameters
            Asked for until now.
        waves : float
            Since the beginning.
        """
        if float(self._reference.speed(t)) < self.planner.feed_forward.slowest:
            return Choice("stop", _rest(in_force), STANDS)
        blind = self._blind(t, estimate, waves)
        if blind is not None:
            return Choice("gait", blind, UNKNOWN)
        plan, complaint = self._plan(t, estimate)
        if plan is None or complaint:
            return self._without(t, estimate, in_force, complaint, plan)
        assert plan.parameters is not None
        self._accepted, self._failures, self._held = plan, 0, 0
        return Choice("mpc", plan.parameters, plan.status.value, plan)

    def _blind(self, t: float, estimate: Estimate, waves: float) -> GaitParameters | None:
        """Return the wave that turns as the path does, until the heading is known or has had time enough for that."""
        variance = float(estimate.covariance[_HEADING, _HEADING])
        self._steers = self._steers or variance <= KNOWN**2 or waves >= LONGEST_START
        if self._steers:
            return None
        speed, turn = float(self._reference.speed(t)), turn_of_path(self._reference, t, estimate)
        return self._finite(self.planner.feed_forward(speed, turn))

    def _plan(self, t: float, estimate: Estimate) -> tuple[Plan | None, str]:
        """Return a plan, if one is made, and why it is not accepted."""
        try:
            plan = self.planner.plan(t, estimate, self._reference)
        except (ArithmeticError, RuntimeError, ValueError) as error:
            _LOG.warning("no plan at %.3f s: %s", t, error)
            return None, f"{type(error).__name__}: {error}"
        if not plan.status.ok:
            return plan, plan.status.value
        return plan, LATE if plan.seconds > self._longest else ""

    def _without(
        self, t: float, estimate: Estimate, in_force: GaitParameters, complaint: str, plan: Plan | None
    ) -> Choice:
        """Return the next best."""
        self._failures += 1
        if self._failures % FORGET == 0:
            self.planner.forget()
        if self._accepted is not None and self._failures <= MOST_SHIFTED:
            shifted = self._model.parameters(ReducedInput(*self._accepted.at(t)))
            return Choice("shifted plan", shifted, complaint, plan, failed=True)
        slip = float(estimate.state.slip)
        plain = self._finite(self.planner.plain(t, slip if isfinite(slip) else 0.0, self._reference))
        if plain is not None:
            return Choice("gait", plain, complaint, plan, failed=True)
        self._held += 1
        if self._held <= MOST_HELD:
            return Choice("gait", in_force, complaint, plan, failed=True)
        return Choice("stop", _rest(in_force), LOST, plan, failed=True)

    def _finite(self, wave: ReducedInput) -> GaitParameters | None:
        """Return the parameters of a wave, if the reference of which it comes is finite."""
        return self._model.parameters(wave) if all(isfinite(part) for part in wave) else None


def turn_of_path(reference: Reference, t: float, estimate: Estimate) -> float:
    """Return the turn rate of the path where the worm is [rad/s]; 0 without a path."""
    if reference.path is None or not np.isfinite(estimate.position).all():
        return 0.0
    return turn_rate(reference, t, float(reference.path.project(estimate.position)))


def _rest(in_force: GaitParameters) -> GaitParameters:
    return GaitParameters(0.0, in_force.frequency)
