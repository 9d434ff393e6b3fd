"""The record of a run: metrics, arrays with dimensions and units, the scene, and the versions of the programs."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

from numpy.typing import NDArray

from scenes.language.errors import SceneError
from worm3d.values.variable import Variable

Cell = float | int | str | None

Metric = Cell | list[dict[str, Cell]]
"""Value of an entry of the summary: a number, a text, or a table (for example the faults of a run) as a list of
rows."""


def fault_row(time: float, kind: str, what: str, advice: str) -> dict[str, Cell]:
    """Return a fault, detected at the given time [s], as a row of the table of faults in the summary."""
    return {"time_s": time, "kind": kind, "what": what, "advice": advice}


class MissingVariableError(SceneError, KeyError):
    """A record does not contain a variable of the requested name."""


@dataclass(frozen=True)
class Summary:
    """Metrics of a run by name. NaN and infinite values are replaced by None.

    Raises
    ------
    ValueError
        A metric is None, and `reasons` has no reason for this metric.
    """

    metrics: Mapping[str, Metric]
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Reason why a metric is None, by the name of the metric. Reasons for other metrics are dropped."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Estimated errors of metrics by name, for the metrics whose errors are known."""

    def __post_init__(self) -> None:
        metrics = {name: metric if _has_value(metric) else None for name, metric in self.metrics.items()}
        absent = [name for name, metric in metrics.items() if metric is None]
        unexplained = sorted(set(absent) - self.reasons.keys())
        if unexplained:
            raise ValueError(f"summary: got no value of {', '.join(unexplained)}, must have a reason")
        object.__setattr__(self, "metrics", MappingProxyType(metrics))
        object.__setattr__(self, "reasons", MappingProxyType({name: self.reasons[name] for name in absent}))

    def __getitem__(self, name: str) -> Metric:
        """Return the metric with the given name."""
        return self.metrics[name]

    @property
    def faults(self) -> list[dict[str, Cell]]:
        """Faults of the run, sorted by time. Each fault is a dict with the keys that `fault_row` returns."""
        found = self.metrics.get("faults")
        return found if isinstance(found, list) else []

    def to_dict(self) -> dict[str, Any]:
        """Return the metrics, with the reasons under the key `reasons` and any errors under `errors`, for JSON."""
        return {**self.metrics, "reasons": dict(self.reasons), **({"errors": dict(self.errors)} if self.errors else {})}


def _has_value(metric: Metric) -> bool:
    return metric is not None and not (isinstance(metric, float) and not math.isfinite(metric))


@dataclass(frozen=True, eq=False)
class Record:
    """The record of a run.

    If the same scene is run again on the same machine with the same versions of the programs, all fields except
    `timing` are the same, bit for bit.
    """

    name: str
    """Name of the scene."""
    model: str
    scene: str
    """The scene as TOML, with all overrides and defaults filled in."""
    status: str
    sentence: str
    """Sentence that says how the run ended."""
    seed: int
    versions: Mapping[str, str]
    """Versions of the programs that made the record."""
    summary: Summary
    variables: tuple[Variable, ...]
    """Variables with unique names; a dimension has the same length in all variables."""
    timing: tuple[Variable, ...] = ()
    """Computing times."""
    checkpoint: tuple[Variable, ...] = ()
    """State at the end of the run. A run that continues from this state gives the same result, bit for bit, as a run
    without interruption."""
    run: str = ""
    """Description of the worm, of the world, and of how the run ended, as JSON text in the format that `worm3d.load`
    reads. Empty for models without a 3D worm."""
    parts: tuple[Variable, ...] = ()
    """Larger arrays of the description `run`, which are stored beside the JSON text."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "versions", MappingProxyType(dict(self.versions)))
        for group in (self.variables, self.timing, self.checkpoint):
            _require_consistent(group)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return the values of a variable."""
        return self.variable(name).values

    def __contains__(self, name: str) -> bool:
        """Return whether there is a variable with this name."""
        return any(variable.name == name for variable in self.variables)

    def variable(self, name: str) -> Variable:
        """Return the variable with the given name; raise MissingVariableError if there is none."""
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise MissingVariableError(
            f"{name}: not in this result, which has {', '.join(v.name for v in self.variables)}; perhaps another "
            "version of worm3d wrote it"
        )

    @cached_property
    def title(self) -> str:
        """Title of the scene for users, or the name of the scene if there is no title."""
        return str(tomllib.loads(self.scene).get("title") or self.name)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Length of each dimension."""
        return {dim: size for variable in self.variables for dim, size in variable.sizes.items()}


def _require_consistent(variables: tuple[Variable, ...]) -> None:
    """Raise ValueError if two variables have the same name, or if a dimension has different lengths in two of them."""
    names = [variable.name for variable in variables]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"variables: {', '.join(twice)} given more than once, names must be unique")
    sizes: dict[str, int] = {}
    for variable in variables:
        for dim, size in variable.sizes.items():
            if sizes.setdefault(dim, size) != size:
                raise ValueError(
                    f"{variable.name}: got {size} along '{dim}', must be {sizes[dim]} as in the variables before"
                )
