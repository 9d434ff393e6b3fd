"""The table of measures: what a run is judged by, each declared once, with its name, its meaning and its function.

Every summary of a run has all of them, and so have `summary.json`, `sweep.csv` and figures of sweeps. One of your own:

    @measure("lift_m", "how far the head is above the tail at the end")
    def lift(result):
        return float(result.joints[-1, -1, 2] - result.joints[-1, 0, 2])

One with parameters is a class below `Measure`, with `name` and `meaning` as fields and a method `of`. Scenes name such
functions and classes as `measures.parts = ["my_robot:lift"]`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from types import FunctionType
from typing import Any, TypeVar

from worm3d.recorded.finished import FinishedRun
from worm3d.values import named
from worm3d.values.metrics import Summary
from worm3d.values.named import marked
from worm3d.values.read_only import kept

Metric = tuple[float | str | None, str]
"""A value, and why there is none if it is None."""

Value = float | str
Function = Callable[[Any], Value]
F = TypeVar("F", bound=Function)

OVERFLOW = "it is too large for a number"


class NoValueError(Exception):
    """A run has no value of a measure; says why."""


@dataclass(frozen=True)
class Measure:
    """A measure of a run."""

    name: str = ""
    """Name, which ends in its unit as `worm3d.values.metrics.UNITS` has them."""
    meaning: str = ""
    """What it is, in a few words."""
    function: Function | None = None
    """Returns the value of a run, or raises NoValueError; None where `of` does."""

    def of(self, result: FinishedRun) -> Value:
        """Return the value of a run, or raise NoValueError."""
        assert self.function is not None, "a class below overrides it"
        return self.function(result)

    def __call__(self, result: FinishedRun) -> Metric:
        """Return the value of a run, None if it has none, and why; a measure of a user's own that raises has none."""
        try:
            value = self.of(result)
        except NoValueError as none:
            return None, str(none)
        except named.EXCEPTIONS as error:
            if getattr(self.function, "__module__", __name__).startswith("worm3d."):
                raise
            return None, f"{self.name}: raised {named.told(error)}"
        return (value, "") if isinstance(value, str) or isfinite(value) else (None, OVERFLOW)


MEASURES: dict[str, Measure] = {}
"""Measures by name, in the order of a summary."""


def measure(name: str, meaning: str) -> Callable[[F], F]:
    """Return a decorator that enters a function of a result in the table.

    Raises
    ------
    ValueError
        The name is taken.
    """

    def enter(function: F) -> F:
        if name in MEASURES:
            raise ValueError(f"measure: got {name!r}, which is taken ({MEASURES[name].meaning}); choose another name")
        MEASURES[name] = Measure(name, meaning, function)
        return marked("measure", function) if type(function) is FunctionType else function

    return enter


@kept
def _measured(result: FinishedRun) -> dict[str, Metric]:
    return {name: each(result) for name, each in MEASURES.items()}


def enter_figures(result: FinishedRun, figures: Mapping[str, Metric]) -> None:
    """Let a run have measures as they were computed before: of a world or a part whose code is not here."""
    _measured(result).update(figures)


def summary(result: FinishedRun) -> Summary:
    """Return the measures of a run by name, None where one has no value."""
    return Summary({name: value for name, (value, _) in _measured(result).items()})


def reasons(result: FinishedRun) -> dict[str, str]:
    """Return why measures of a run have no value."""
    return {name: why for name, (value, why) in _measured(result).items() if value is None}
