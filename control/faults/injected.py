"""Faults that are injected on purpose, to test how a controller reacts.

A fault starts at `begin` and lasts for `duration`. It changes the measurements that the controller gets, the effect of
the commands, or the plans. `Faulty` adds faults to any controller of `worm3d.simulate`. The controller is not informed
of them. To add a kind of fault, derive a dataclass from `Injected` with the name used in scenes, for example
`class Mine(Injected, name="mine")`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal
from zlib import crc32

import numpy as np

from control.sensing.sensors import HOW_TO_ADD, QUANTITIES, SIDE_NAMES, Measurement, Sample
from worm3d import Command, Controller, Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked, Spelled, did_you_mean

if TYPE_CHECKING:
    from control.planning.mpc import Plan

INJECTED: dict[str, type[Injected]] = {}
"""Class of each fault, by the name used in scenes."""

ALL = -1
"""Number that stands for all segments or all components."""


@dataclass(frozen=True, kw_only=True)
class Injected(Checked):
    """A fault that lasts for some time. Subclasses are registered in `INJECTED` under their `name`."""

    name: ClassVar[str] = ""
    of_plans: ClassVar[bool] = False
    """Whether this fault affects plans. If so, it needs a controller that plans."""

    begin: float = parameter(0.0, "when it begins", "s", ge=0)
    duration: float = parameter(
        np.inf, "duration of the fault", "s", gt=0, infinite=True, left_out="to the end of the run"
    )

    def __init_subclass__(cls, name: str = "") -> None:
        if name:
            cls.name, INJECTED[name] = name, cls

    def acts(self, t: float) -> bool:
        """Return whether the fault is active at time t [s]."""
        return self.begin <= t < self.begin + self.duration

    def require(self, worm: Worm) -> None:
        """Raise ValueError if a worm cannot have this fault."""

    def measured(self, measurement: Measurement, before: Measurement | None) -> Measurement:
        """Return the measurement with the fault. `before` is the last measurement before the fault began."""
        return measurement

    def commanded(self, command: Command) -> Command:
        """Return the command as changed by the fault."""
        return command

    def planned(self, draw: Callable[[], float], make: Callable[[], Plan]) -> Plan:
        """Return the plan that `make` computes, as changed by the fault. `draw` returns random numbers from 0 to 1."""
        return make()


@documented
@dataclass(frozen=True, kw_only=True)
class FaultyChamber(Injected, name="chamber"):
    """A chamber whose contraction is a constant plus a share of the commanded contraction."""

    segment: int = parameter(0, "which segment, 0 is the tail", ge=0)
    side: Literal["left", "right"] = parameter("left", "which of its chambers")
    contraction: float = parameter(0.0, "constant contraction", ge=-1, lt=1)
    share: float = parameter(0.0, "share of the command that is added to the constant contraction", ge=0, le=1)

    def require(self, worm: Worm) -> None:
        """Raise ValueError if the worm has no such chamber."""
        _require_segment(self.segment, worm)

    def commanded(self, command: Command) -> Command:
        """Return the command with the faulty contraction of this chamber."""
        contraction, at = command.contraction.copy(), (self.segment, SIDE_NAMES.index(self.side))
        contraction[at] = self.contraction + self.share * contraction[at]
        return replace(command, contraction=contraction)


@documented
@dataclass(frozen=True, kw_only=True)
class UnequalChambers(Injected, name="unequal"):
    """Each command is multiplied by a factor of its own, drawn at random between two bounds."""

    least: float = parameter(0.6, "least factor", ge=0, le=2)
    greatest: float = parameter(1.1, "greatest factor", ge=0, le=2)
    seed: int = parameter(0, "seed of the factors", ge=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.greatest < self.least:
            raise ValueError(f"greatest: got {self.greatest!r}, must be at least {self.least!r}, the least factor")

    def commanded(self, command: Command) -> Command:
        """Return the command with each contraction multiplied by the factor of its chamber."""
        random = np.random.default_rng([self.seed, crc32(b"unequal")])
        factors = random.uniform(self.least, self.greatest, command.contraction.shape)
        return replace(command, contraction=factors * command.contraction)


@documented
@dataclass(frozen=True, kw_only=True)
class FaultySensor(Injected, name="sensor"):
    """A faulty sensor: its samples are missing, repeated, shifted, drifting, or left and right are swapped."""

    channel: str = parameter(
        "com", f"which sensor: {', '.join(QUANTITIES)}, or a channel of your own by its name in its module"
    )
    mode: Literal["lost", "frozen", "off", "drifting", "swapped"] = parameter(
        "lost",
        "lost: no samples; frozen: the last sample again, like a new one; off: an error is added; drifting: a "
        "growing error is added; swapped: left and right are exchanged",
    )
    error: float = parameter(
        0.0, "added error, in the SI unit of the channel; in mode drifting, the error added per second"
    )
    component: int = parameter(ALL, "the only faulty component, such as 1 for the y of com; -1: all components", ge=ALL)
    segment: int = parameter(ALL, "the only faulty segment; -1: all segments", ge=ALL)
    side: Literal["both", "left", "right"] = parameter("both", "faulty side of this segment")

    def require(self, worm: Worm) -> None:
        """Raise ValueError if there is no such channel, or the channel has no such component, segments or sides."""
        if self.channel not in QUANTITIES:
            meant = did_you_mean(self.channel, [(name, name) for name in QUANTITIES])
            known = f"did you mean {meant!r}?" if meant else HOW_TO_ADD
            raise ValueError(f"channel: got {self.channel!r}, must be one of {', '.join(QUANTITIES)}; {known}")
        shape = QUANTITIES[self.channel].shape(worm)
        if self.segment != ALL:
            _require_segment(self.segment, worm)
            if len(shape) < 2:
                raise ValueError(
                    f"segment: got {self.segment!r}, must be left out: {self.channel} is of the whole worm"
                )
        if self.mode == "swapped" and shape[1:] != (2,):
            raise ValueError(f"mode: got {self.mode!r}, must be another one: {self.channel} has no sides")
        if self.component != ALL and not (len(shape) == 1 and self.component < shape[0]):
            few = f"must be below {shape[0]}" if len(shape) == 1 else "must be left out"
            raise ValueError(f"component: got {self.component!r}, {few}: {self.channel} has the shape {shape}")

    def measured(self, measurement: Measurement, before: Measurement | None) -> Measurement:
        """Return the measurement with the faulty samples of this sensor."""
        sample = measurement.get(self.channel)
        if sample is None or sample.value is None:
            return measurement
        kept: Any = sample.value if before is None else before[self.channel].value
        value = self._spoilt(np.array(sample.value, dtype=float), np.asarray(kept, dtype=float), sample.time)
        return measurement.changed(**{self.channel: Sample(value, sample.time)})

    def _spoilt(self, value: FloatArray, before: FloatArray, instant: float) -> FloatArray | None:
        if self.mode == "lost" and self.segment == ALL and self.component == ALL:
            return None
        bad = before if self.mode == "frozen" else value
        if self.mode == "lost":
            bad = np.full_like(value, np.nan)
        elif self.mode == "swapped":
            bad = value[..., ::-1]
        elif self.mode != "frozen":
            bad = value + self.error * (1.0 if self.mode == "off" else max(instant - self.begin, 0.0))
        both = slice(None) if self.side == "both" else SIDE_NAMES.index(self.side)
        own: Any = ... if self.component == ALL else self.component
        own = own if self.segment == ALL else (self.segment, both)
        spoilt = value.copy()
        spoilt[own] = bad[own]
        return spoilt


@documented
@dataclass(frozen=True, kw_only=True)
class FaultyPlanner(Injected, name="planner"):
    """The planner finds no plan or raises an exception, with a given probability."""

    of_plans: ClassVar[bool] = True

    mode: Literal["fails", "raises"] = parameter("fails", "fails: no plan is found; raises: an exception")
    probability: float = parameter(1.0, "probability that a plan is spoilt", gt=0, le=1)

    def planned(self, draw: Callable[[], float], make: Callable[[], Plan]) -> Plan:
        """Return the plan, or a plan with a status of failure, or raise RuntimeError."""
        if draw() >= self.probability:
            return make()
        if self.mode == "raises":
            raise RuntimeError("the planner is out of order")
        from control.planning.gauss_newton import PlanStatus  # imports the solver

        return replace(make(), status=PlanStatus.NOT_SOLVED)


class Faulty(Spelled):
    """A controller with injected faults.

    Parameters
    ----------
    controller : Controller
        Any controller that `worm3d.simulate` accepts. Faults of plans need a controller with an attribute `planner`.
    faults : sequence of Injected
    seed : int
        Seed of random faults.
    planning : object, optional
        Object that has the `planner`. By default the controller.

    Raises
    ------
    ValueError
        This controller cannot have one of the faults. (`Injected.require` checks whether the worm can have a fault.)
    """

    def __init__(self, controller: Controller, faults: Sequence[Injected], seed: int = 0, planning: Any = None) -> None:
        self.controller, self.faults = controller, tuple(faults)
        owner, of_plans = controller if planning is None else planning, [each for each in faults if each.of_plans]
        if of_plans:
            if not hasattr(owner, "planner"):
                name = of_plans[0].name or type(of_plans[0]).__name__
                raise ValueError(f"{name}: got this fault, but {type(owner).__name__} plans nothing")
            owner.planner = _Planner(owner.planner, of_plans, seed)
        self.reset()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["controller"], name)

    def reset(self) -> None:
        """Return to the initial state."""
        self.controller.reset()
        self._before: list[Measurement | None] = [None] * len(self.faults)

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on, as changed by the faults."""
        acting = [fault.acts(t) for fault in self.faults]
        for k, fault in enumerate(self.faults):
            if acting[k]:
                measurement = fault.measured(measurement, self._before[k])
            else:
                self._before[k] = _latest(self._before[k], measurement)
        command = self.controller.step(t, measurement)
        for k, fault in enumerate(self.faults):
            if acting[k]:
                command = fault.commanded(command)
        return command


class _Planner:
    """A planner whose plans are changed by faults."""

    def __init__(self, planner: Any, faults: Sequence[Injected], seed: int) -> None:
        self._planner, self._faults, self._seed = planner, faults, seed

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["_planner"], name)

    def reset(self) -> None:
        """Return to the initial state."""
        self._planner.reset()
        self._random = np.random.default_rng([self._seed, crc32(b"planner")])

    def plan(self, t: float, *given: Any) -> Plan:
        """Return the plan from time t [s] on, as changed by the faults."""
        make: Callable[[], Plan] = lambda: self._planner.plan(t, *given)  # noqa: E731
        fault = next((fault for fault in self._faults if fault.acts(t)), None)
        return make() if fault is None else fault.planned(self._random.random, make)


def _latest(before: Measurement | None, measurement: Measurement) -> Measurement:
    """Return `measurement` with the earlier sample in each channel that has no new sample."""
    if before is None:
        return measurement
    return measurement.changed(**{name: before[name] for name, s in measurement.items() if s.value is None})


def _require_segment(segment: int, worm: Worm) -> None:
    if segment >= worm.segments:
        raise ValueError(
            f"segment: got {segment!r}, must be below {worm.segments}, the number of segments; 0 is the tail"
        )
