"""The table of measures of a run. Each measure is declared once, with its name, meaning and function.

All measures are in every summary of a run, in `summary.json`, in `sweep.csv` and in the figures of sweeps. The
following code adds a measure:

    @measure("lift_m", "how far the head is above the tail at the end")
    def lift(result):
        return float(result.joints[-1, -1, 2] - result.joints[-1, 0, 2])

A measure with parameters is a subclass of `Measure` with the fields `name` and `meaning` and a method `of`. Scenes
refer to such functions and classes as `measures.parts = ["my_robot:lift"]`.
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
"""A value and a reason: the value of a measure, or None, and the reason if the value is None."""

Value = float | str
Function = Callable[[Any], Value]
F = TypeVar("F", bound=Function)

OVERFLOW = "the value is too large for a number"


class NoValueError(Exception):
    """Raised if a run has no value of a measure; the message is the reason."""


@dataclass(frozen=True)
class Measure:
    """A measure of a run."""

    name: str = ""
    """Name, which ends in a unit of `worm3d.values.metrics.METRIC_UNITS`."""
    meaning: str = ""
    """Meaning of the measure, in a few words."""
    function: Function | None = None
    """Function that returns the value of a run, or raises NoValueError. None if a subclass overrides `of`."""

    def of(self, result: FinishedRun) -> Value:
        """Return the value of a run, or raise NoValueError."""
        assert self.function is not None, "a class below overrides it"
        return self.function(result)

    def __call__(self, result: FinishedRun) -> Metric:
        """Return the value and "", or None and the reason, for example the error that a user's measure raised."""
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
    """Return a decorator that adds a function of a result to the table of measures.

    Raises
    ------
    ValueError
        Another measure has this name.
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
    """Store measures of a run that were computed earlier, since the code of its world or of a part may be missing."""
    _measured(result).update(figures)


def summary(result: FinishedRun) -> Summary:
    """Return the measures of a run by name, None for a measure without a value."""
    return Summary({name: value for name, (value, _) in _measured(result).items()})


def reasons(result: FinishedRun) -> dict[str, str]:
    """Return the reasons why measures of a run have no value, by name."""
    return {name: why for name, (value, why) in _measured(result).items() if value is None}
