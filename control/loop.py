"""The loop that all controllers of this package share, from measurements to the commands of a wave.

At every step, the gate removes impossible samples from the measurement, and the estimator (if there is one) processes
the remaining samples. The wave generator then gives a command, and the inner loop corrects the command of each chamber.
Once per control period, new parameters of the wave are chosen and the decision is recorded. If the choice raises an
exception, the present parameters stay in force; after several exceptions in a row, the worm rests. The watch looks for
faults. A segment with a chamber that does not follow its commands is held still.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import inf, nan
from time import perf_counter
from typing import ClassVar, Literal, NamedTuple, Protocol, Self, get_args

from control.estimation.chamber_gains import ChamberGains
from control.estimation.estimate import HEADING, Estimate
from control.estimation.estimator import Estimator
from control.estimation.reduced import ReducedModel
from control.faults.chambers import Chambers
from control.faults.descent import Descent
from control.faults.rules import Fault
from control.faults.sides import Sides
from control.faults.watch import Watch
from control.gaits.held import WAVE, HeldSteering, held_schedule
from control.gaits.steering import GaitParameters, WaveGenerator
from control.identification.strain_model import StrainModel
from control.inner_loop import InnerLoop
from control.planning.feed_forward import FeedForward
from control.planning.mpc import Plan
from control.sensing.gate import SPAN, Gate
from control.sensing.sensors import STRAIN, Measurement
from control.task import ControlTask
from control.tracking.detour import Body
from control.tracking.guide import Guide, led
from control.tracking.references import Reference
from control.tracking.search import NoWayError
from worm3d import Command
from worm3d.values.arrays import FloatArray
from worm3d.values.named import EXCEPTIONS

Source = Literal["mpc", "shifted plan", "gait", "stop", "pi_los", "open_loop", "own", "climb"]
SOURCES: tuple[Source, ...] = get_args(Source)

MOST_KEPT = 5
"""Maximum number of consecutive decisions that reuse the last plan, or the last parameters, for lack of a better
choice."""
MAX_HEADING_DEVIATION = 0.08
"""Standard deviation of the heading below which the heading counts as known [rad]. When the limit was doubled, the worm
started before it knew its heading, and left the path."""
LONGEST_START = 3.0
"""Number of waves after which the worm is steered even if its heading is still unknown."""
STILL = 1e-6
"""Frequency that is commanded to stop the motion of a wave [Hz]."""
BLOCKED = "no way is left past an obstacle that has come into sight: the worm stops before it"
NO_DECISION = "nothing is known to go by"
_LOG = logging.getLogger(__name__)


class Choice(NamedTuple):
    """Gait parameters that a controller chose, and the reason."""

    source: Source
    parameters: GaitParameters
    status: str
    """Status of the plan as a sentence, or the reason why there is no plan."""
    plan: Plan | None = None
    """Plan that was computed for this decision, whether it was accepted or not."""
    failed: bool = False
    """Whether this is a substitute for a better choice that failed, such as a plan that was not accepted."""


@dataclass(frozen=True, eq=False)
class Decision:
    """Record of one choice of the gait parameters, and of what the controller knew at that time."""

    time: float
    """The parameters hold from this time on [s]."""
    source: Source
    """Source of the parameters: an accepted plan ("mpc"), the continuation of an earlier plan ("shifted plan"), the
    feed-forward or the parameters already in force ("gait"), rest ("stop"), a baseline ("pi_los", "open_loop"), a
    user's controller ("own"), or the climbing gait in a pipe ("climb")."""
    parameters: GaitParameters
    estimate: Estimate | None
    """Estimate at this time; None for a controller without estimator."""
    status: str = ""
    """Status of the solver as a sentence, or the reason why there is no plan or why the plan was not used. Empty for
    controllers without a solver."""
    failed: bool = False
    """Whether this was a substitute for a better choice that failed."""
    iterations: int = 0
    cost: float = nan
    """Cost of the plan. NaN if no plan was computed."""
    seconds: float = 0.0
    """Wall time of the decision, including the estimator [s]."""
    horizon: FloatArray | None = None
    """Predicted path of the centre of mass [m], shape (H + 1, 2)."""
    chamber_gain: FloatArray | None = None
    """Estimated gain of each chamber relative to a healthy chamber, shape (N, 2) for N segments. None without an
    estimator."""
    chamber_phase: FloatArray | None = None
    """Phase lead of each chamber relative to a healthy chamber [rad], shape (N, 2). None without an estimator."""


class Estimates(Protocol):
    """A source of estimates, such as `control.estimation.estimator.Estimator`."""

    def reset(self) -> None:
        """Return to the initial state."""

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        """Process the measurement of time t [s]. The parameters were in force since the previous call."""

    def estimate(self, t: float) -> Estimate | None:
        """Return the estimate at the time t [s] of the last measurement, or None if there is no estimate.

        This method is called once per decision, not at every step.
        """


class Driver(ABC):
    """Base class of all controllers in scenes, which records decisions, checks measurements and looks for faults.

    Parameters
    ----------
    task : ControlTask
    feed_forward : FeedForward
        Reachable speeds and turn rates of the worm, and its preferred frequency.
    estimator : Estimates, optional

    Attributes
    ----------
    decisions : list of Decision
        Decisions so far. The `seconds` of a decision include all steps since the previous decision.
    failures : int
        Number of decisions without an accepted plan or with an exception.
    """

    plans: ClassVar[bool] = False
    """Whether the driver computes plans, which can fail."""
    senses: ClassVar[tuple[str, ...]] = ()
    """Names of required sensor channels that a robot does not have by default."""

    def __init__(self, task: ControlTask, feed_forward: FeedForward, estimator: Estimates | None = None) -> None:
        self.task, self.worm, self.reference, self.control_period = task, task.worm, task.reference, task.period
        self.feed_forward, self.estimator = feed_forward, estimator
        self.gate = Gate(task.worm, getattr(estimator, "span", SPAN))
        self.guide = Guide(task.reference, Body.of(task.worm))

    def reset(self) -> None:
        """Return to the initial state."""
        if self.estimator is not None:
            self.estimator.reset()
        self.gate.reset()
        self.guide.reset()
        self.reference = self.guide.reference
        self.watch = Watch(self.worm, self.reference, self.feed_forward)
        self.decisions: list[Decision] = []
        self.failures = 0
        self._time: float | None = None
        self._due, self._spent = -inf, 0.0

    def lead(self, reference: Reference) -> None:
        """Follow another reference from now on. ValueError if the obstacles leave no way."""
        body = Body.of(self.worm)
        self.guide = Guide(led(reference, body), body)
        self.reference = self.watch.reference = self.guide.reference

    @property
    def period(self) -> float:
        """Period of the wave at the preferred frequency [s]. `worm3d.simulate` averages over this period."""
        return self.feed_forward.wave

    @property
    @abstractmethod
    def waves(self) -> float:
        """Commanded phase since the beginning [waves]."""

    @property
    def faults(self) -> list[Fault]:
        """Detected faults that prevent the worm from following the reference."""
        return self.watch.faults

    @property
    def overruns(self) -> int:
        """Number of control periods whose computation took longer than the period."""
        return sum(decision.seconds > self.control_period for decision in self.decisions)

    @abstractmethod
    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on. TypeError if `measurement` is not a `Measurement`."""

    def _elapsed(self, t: float) -> float:
        """Return the time since the previous step [s], or 0 at the first step."""
        elapsed, self._time = 0.0 if self._time is None else t - self._time, t
        return elapsed

    def _estimate(self, t: float) -> Estimate | None:
        return None if self.estimator is None else self.estimator.estimate(t)


class WaveController(Driver):
    """A controller for `worm3d.simulate` that chooses the parameters of a wave once per control period.

    Parameters
    ----------
    task : ControlTask
    feed_forward : FeedForward, optional
        By default computed from the task's map.
    estimator : Estimates, optional
        None for a controller without feedback.

    Attributes
    ----------
    held_steering : tuple of HeldSteering or None
        Entry i is the steering to use while segment i is held still, or None. The tuple is empty if these are unknown.
    chamber_gains : ChamberGains
        Estimated amplitude and delay of each chamber's response to its commands.
    inner_loop : InnerLoop or None
        Law that corrects the commands with these gains. None without an estimator, or if the map has no model of the
        strains for this number of segments.
    """

    held_steering: tuple[HeldSteering | None, ...] = ()

    def __init__(
        self, task: ControlTask, feed_forward: FeedForward | None = None, estimator: Estimates | None = None
    ) -> None:
        able = feed_forward or FeedForward(task.found, task.worm.length, task.map.backward)
        super().__init__(task, able, estimator)
        self.generator = WaveGenerator(task.map.schedule, task.worm)
        noise = task.sensors.get("strain", STRAIN).noise
        healthy, segments = task.map.strain, task.worm.segments
        known = healthy is not None and healthy.segments == segments
        strains = healthy if healthy is not None and known else StrainModel.plain(segments)
        self.chamber_gains = ChamberGains(strains, noise, getattr(estimator, "span", SPAN))
        self.inner_loop = InnerLoop() if known and estimator is not None else None
        self.descent = Descent(task.worm, task.reference, task.map.grip)
        self.reset()

    @classmethod
    def of(cls, task: ControlTask) -> Self:
        """Return the controller for a task, with default parts."""
        return cls(task)

    def reset(self) -> None:
        """Return to the initial state."""
        super().reset()
        self.generator.schedule = self.task.map.schedule
        self.generator.reset()
        self.chamber_gains.reset()
        self.chambers, self.sides = Chambers(self.worm), Sides(self.worm.segments)
        self.descent.reset()
        self.descent.reference = self.reference
        self._kept_count, self._blocked = 0, False
        self._heading_known, self._began = False, 0.0
        self._target = GaitParameters(0.0, self.feed_forward.frequency)

    def lead(self, reference: Reference) -> None:
        """Follow another reference from now on, also if no way was left for the former one."""
        super().lead(reference)
        self.descent.reference, self._blocked = self.reference, False

    @property
    def waves(self) -> float:
        """Commanded phase since the beginning [waves]."""
        return self.generator.waves

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on. TypeError if `measurement` is not a `Measurement`."""
        began = perf_counter()
        elapsed = self._elapsed(t)
        seen = self.gate(t, measurement, moving=self._target.amplitude != 0.0)
        if self.estimator is not None:
            self.estimator.take(t, seen, self._target, self.generator.phase)
            self.chamber_gains.take(t, self.generator.phase, seen.strain, seen.strain_time)
            found = self.chambers.take(t, seen.strain, self.chamber_gains)
            self.watch.report(found)
            if not self.chambers.held:
                self.watch.report(self.sides.take(t, self.generator.phase, seen.strain, self.chamber_gains))
            if found:
                self._steer_as_held()
        self.watch.look(t, seen, self._estimate)
        if t >= self._due - 1e-9:
            if self.inner_loop is not None:
                told = None if self.sides.swapped else self.inner_loop.correction(self.chamber_gains)
                self.generator.correction = told
            self._decide(t, self._estimate(t), began)
            began = perf_counter()
        command = self.chambers.amended(t, self.generator.step(elapsed, self._target))
        self.chamber_gains.tell(t, command)
        self.watch.tell(self.generator.phase, command, self._target, self.chamber_gains)
        self._spent += perf_counter() - began
        return command

    def _steer_as_held(self) -> None:
        """Use the steering for the segment that is held still, if there is one such segment with known steering.

        Otherwise the whole worm steers.
        """
        self.generator.schedule, steered = self.task.map.schedule, self.feed_forward.found
        if len(self.chambers.held) > 1 or steered.mechanism == "bias":
            return
        for segment in self.chambers.held:
            steering = self.held_steering[segment] if segment < len(self.held_steering) else None
            if steering is not None:
                self.generator.schedule = held_schedule(self.task.map.schedule, segment, self.held_steering)
                amplitude = min(WAVE.amplitude, steered.ranges.amplitude[1])
                whole = float(steered.turn(amplitude, WAVE.frequency, WAVE.steering(steered.mechanism)))
                turns = getattr(self.estimator, "turns", None)  # an estimator of the user's own may lack it
                if turns is not None:
                    turns(steering.turn / whole)

    def _decide(self, t: float, estimate: Estimate | None, began: float) -> None:
        choice = self._chosen(t, estimate)
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
                failed=choice.failed,
                iterations=plan.iterations if plan else 0,
                cost=plan.cost if plan else nan,
                seconds=self._spent + perf_counter() - began,
                horizon=plan.horizon if plan and choice.source == "mpc" else None,
                chamber_gain=None if self.estimator is None else self.chamber_gains.gain,
                chamber_phase=None if self.estimator is None else self.chamber_gains.phase,
            )
        )
        self._spent = 0.0

    def _chosen(self, t: float, estimate: Estimate | None) -> Choice:
        """Return the next choice.

        If the way is blocked or too steep, this is a stop. After an exception, the parameters in force are reused
        several times, and then the worm rests.
        """
        try:
            if self._is_blocked(t, estimate):
                return Choice("stop", still(self._target), BLOCKED)
            steep = self.descent.fault(t, estimate)
            if steep is not None and estimate is not None:
                self.watch.report([steep])
                if not self.descent.tries(t, estimate.position):
                    return Choice("stop", rest(self._target), steep.what)
                forget = getattr(self.estimator, "forget_ground", None)
                if forget is not None:
                    forget()
            choice, self._kept_count = self._choose(t, estimate), 0
        except EXCEPTIONS as error:
            _LOG.warning("no decision at %.3f s", t, exc_info=error)
            self._kept_count += 1
            if self._kept_count <= MOST_KEPT:
                return Choice("gait", self._target, complaint_of(error), failed=True)
            return Choice("stop", rest(self._target), f"{NO_DECISION}: {complaint_of(error)}", failed=True)
        return choice

    def _heading_is_known(self, estimate: Estimate) -> bool:
        """Return whether the heading can be used from now on.

        The heading can be used when known, or after the first `LONGEST_START` waves.
        """
        self._heading_known |= _sure(estimate) or self.generator.waves - self._began >= LONGEST_START
        return self._heading_known

    def _is_blocked(self, t: float, estimate: Estimate | None) -> bool:
        """Look for obstacles that have come into sight, and return whether they leave no way to the worm."""
        if self._blocked or estimate is None or not estimate.is_placed(self.worm.length):
            return self._blocked
        try:
            if self.guide.look(estimate.position, estimate.heading, _sure(estimate)):
                self.reference = self.watch.reference = self.descent.reference = self.guide.reference
        except NoWayError as error:
            self._blocked = True
            advice = "lead it along another path, widen the corridor, or let it know of the obstacle sooner"
            self.watch.report([Fault(t, "blocked", f"{BLOCKED}; {error}", advice)])
        return self._blocked

    @abstractmethod
    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        """Return the parameters from time t [s] on, with their source."""


def _sure(estimate: Estimate) -> bool:
    return bool(estimate.deviations[HEADING] < MAX_HEADING_DEVIATION)


def observed(
    task: ControlTask, model: type[ReducedModel] = ReducedModel, estimator: type[Estimator] = Estimator
) -> tuple[ReducedModel, Estimator]:
    """Return the reduced model of the task's worm, and an estimator that uses this model and the task's sensors."""
    reduced = model.of(task.worm, task.map, task.mechanism)
    return reduced, estimator.for_sensors(task.worm, reduced, task.map.schedule, task.sensors)


def complaint_of(error: BaseException) -> str:
    """Return the type and message of an exception as one line of at most 200 characters."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]  # characters


def rest(in_force: GaitParameters) -> GaitParameters:
    """Return the parameters of a worm at rest, with amplitude 0."""
    return GaitParameters(0.0, in_force.frequency)


def still(in_force: GaitParameters) -> GaitParameters:
    """Return the wave in force, but standing still.

    The worm keeps its shape. If the worm relaxed, the centre of mass would shift by a hundredth of the body length.
    """
    return replace(in_force, frequency=STILL) if in_force.amplitude != 0.0 else in_force
