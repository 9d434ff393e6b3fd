"""Goals of an optimisation: measures of a run that are to be large or small, and limits of other measures.

A candidate that breaks a limit is worse than each candidate that breaks none. Among the former, the candidate with the
smaller sum of relative violations is better (Deb, Comput. Methods Appl. Mech. Eng. 186:311, 2000).
"""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from numbers import Real
from threading import Thread
from types import MappingProxyType

from control.parts import MEASURE
from scenes.language.errors import SceneError
from worm3d.measures import MEASURES, Measure, NoValueError
from worm3d.measures.waves import waves_of
from worm3d.recorded.finished import FinishedRun
from worm3d.values import named
from worm3d.values.spelling import did_you_mean

BROKEN = 1e6
"""Cost of a candidate that breaks a limit, before its violation is added. No goal has such a large value."""
FAILED = 1e9
"""Cost of a candidate whose run did not end, or has no value of the goal."""


@dataclass(frozen=True)
class Limit:
    """Limit of a measure, such as roll_max_deg <= 20."""

    measure: str
    greatest: bool
    """Whether the bound is the greatest allowed value; otherwise the least one."""
    bound: float

    def violation(self, result: FinishedRun) -> float:
        """Return by how much a run breaks the limit, over the bound; infinite without a value."""
        value, _ = MEASURES[self.measure](result)
        if not isinstance(value, float):
            return math.inf
        excess = value - self.bound if self.greatest else self.bound - value
        return max(0.0, excess) / (abs(self.bound) or 1.0)

    def __str__(self) -> str:
        return f"{self.measure} {'<=' if self.greatest else '>='} {self.bound:g}"


@dataclass(frozen=True)
class Goal:
    """Measure of a run that an optimisation makes as large, or as small, as possible."""

    name: str
    meaning: str
    measure: Measure
    smallest: bool = False
    """Whether small values are good."""
    turns: bool = False
    """Whether left and right chambers may differ."""
    is_rate: bool = False
    """Whether the value is per time, so that a slower gait has less."""
    robust: bool = False
    """Whether the worst of several grounds counts, each relative to the gait of the scene."""
    limits: tuple[Limit, ...] = ()

    def value(self, result: FinishedRun) -> float:
        """Return the value of the goal in a run, or NaN."""
        return self.value_or_why(result)[0]

    def value_or_why(self, result: FinishedRun) -> tuple[float, str]:
        """Return the value of the goal in a run and "", or NaN and a reason."""
        value, why = self.measure(result)
        return (float(value), why) if isinstance(value, float | int) else (math.nan, why)

    def gain(self, value: float, reference: float) -> float:
        """Return how much better a value is than a reference, as a ratio above 1 for a better value."""
        return reference / value if self.smallest else value / reference

    def violation(self, result: FinishedRun) -> float:
        """Return the sum of the relative violations of the limits."""
        return sum(each.violation(result) for each in self.limits)


def _climbed(result: FinishedRun) -> float:
    waves = waves_of(result)
    heights = waves.at_edges(result.com[:, 2])
    return float((heights[-1] - heights[0]) / (waves.edges[-1] - waves.edges[0])) / result.worm.length


def _turned(result: FinishedRun) -> float:
    value, reason = MEASURES["degrees_per_wave_deg"](result)
    if not isinstance(value, float):
        raise NoValueError(reason)
    return abs(value)


TIME_LIMIT = 10.0
"""Longest time that a user's own measure may take [s]. Measures of the program take some milliseconds."""


@dataclass(frozen=True)
class Guarded(Measure):
    """A user's own measure. Errors, values that are not finite numbers, and endless loops give a reason, no value."""

    own: Measure = field(default_factory=Measure)

    def of(self, result: FinishedRun) -> float:
        """Return the value of a run, or raise NoValueError.

        The measure runs in its own thread. If the time is over, the thread gets an exception, which ends an endless
        loop in Python.
        """
        found = Future[object]()

        def go() -> None:
            try:
                found.set_result(self.own.of(result))
            except BaseException as error:
                found.set_exception(error)

        thread = Thread(target=go, daemon=True)
        thread.start()
        try:
            value = found.result(TIME_LIMIT)
        except NoValueError:
            raise
        except named.EXCEPTIONS as error:
            if found.done():
                raise NoValueError(f"{self.name} raised {named.told(error)}") from error
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit))
            raise NoValueError(f"{self.name} took longer than {TIME_LIMIT:g} s") from error
        if not isinstance(value, Real) or not math.isfinite(value):
            raise NoValueError(f"{self.name} returned {value!r:.60}, must return a finite number")
        return float(value)


LEAST_SPEED = 0.05
"""Least speed of the goal "cost" without a limit of the speed [body lengths/s]."""
MOST_ROLL = 20.0
"""Greatest roll of a candidate [deg], half of the roll from which worms tip over."""
ROLL = Limit("roll_max_deg", True, MOST_ROLL)

GOALS: Mapping[str, Goal] = MappingProxyType(
    {
        goal.name: goal
        for goal in (
            Goal(
                "robust",
                "speed on the worst of three grounds",
                MEASURES["speed_bl_s"],
                is_rate=True,
                robust=True,
                limits=(ROLL,),
            ),
            Goal("speed", "speed towards the initial heading", MEASURES["speed_bl_s"], is_rate=True, limits=(ROLL,)),
            Goal(
                "cost",
                "cost of transport at a minimum speed",
                MEASURES["cost_of_transport"],
                smallest=True,
                limits=(ROLL, Limit("speed_bl_s", False, LEAST_SPEED)),
            ),
            Goal("turn", "turn in a wave", Measure("turn_deg", "turn in a wave", _turned), turns=True, limits=(ROLL,)),
            Goal(
                "climb",
                "height gained per time",
                Measure("climb_bl_s", "height gained per time", _climbed),
                is_rate=True,
                limits=(ROLL,),
            ),
        )
    }
)
"""Goals by name."""


def goal_of(name: str, limits: Sequence[str] = ()) -> Goal:
    """Return a goal by name, or a user's own measure `module:NAME` that is to be large, with further limits.

    A limit of a measure replaces the limit that the goal has for the same measure.

    Raises
    ------
    SceneError
        There is no such goal or measure, or a limit is not of the form `measure<=number`.
    """
    if ":" in name:
        try:
            own = named.own(name, MEASURE)
        except ValueError as error:
            raise SceneError(f"--goal: {error}") from error
        measure = own if isinstance(own, Measure) else next(m for m in MEASURES.values() if m.function is own)
        goal = Goal(name, measure.meaning, Guarded(name, measure.meaning, own=measure), limits=(ROLL,))
    elif name in GOALS:
        goal = GOALS[name]
    else:
        meant = did_you_mean(name, [(each, each) for each in GOALS])
        hint = f"; did you mean '{meant}'?" if meant else ""
        raise SceneError(f"--goal: got '{name}', must be one of {', '.join(GOALS)}, or module:NAME of a measure{hint}")
    given = [limit_of(text) for text in limits]
    kept = [each for each in goal.limits if each.measure not in {own.measure for own in given}]
    return replace(goal, limits=(*kept, *given))


def limit_of(text: str) -> Limit:
    """Return the limit of a text such as `roll_max_deg<=20`; SceneError if there is no such measure or bound."""
    parts = re.fullmatch(r"\s*(\w+)\s*(<=|>=)\s*(\S+)\s*", text)
    try:
        bound = float(parts[3]) if parts else math.nan
    except ValueError:
        bound = math.nan
    if parts is None or not math.isfinite(bound):
        raise SceneError(f"--limit: got '{text}', must be a measure and a bound, such as roll_max_deg<=20")
    if parts[1] not in MEASURES:
        meant = did_you_mean(parts[1], [(each, each) for each in MEASURES])
        hint = f"; did you mean '{meant}'?" if meant else "; 'worm3d list measure' lists the measures"
        raise SceneError(f"--limit: there is no measure '{parts[1]}'{hint}")
    return Limit(parts[1], parts[2] == "<=", bound)
