"""Results of a run: metrics, named arrays with dimensions and units, and the origin of the results."""

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
"""A number of the summary, or a table, such as the faults of a run."""


def fault_row(time: float, kind: str, what: str, advice: str) -> dict[str, Cell]:
    """Return a fault of a run, detected at a time [s], as a row of the summary."""
    return {"time_s": time, "kind": kind, "what": what, "advice": advice}


class MissingVariableError(SceneError, KeyError):
    """A result does not contain a variable."""


@dataclass(frozen=True)
class Summary:
    """Metrics of a run by name; a metric that is None, NaN or infinite becomes None and needs a reason."""

    metrics: Mapping[str, Metric]
    reasons: Mapping[str, str] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    """Errors of the metrics by name, if known."""

    def __post_init__(self) -> None:
        metrics = {name: metric if _has_value(metric) else None for name, metric in self.metrics.items()}
        absent = [name for name, metric in metrics.items() if metric is None]
        unexplained = sorted(set(absent) - self.reasons.keys())
        if unexplained:
            raise ValueError(f"summary: {', '.join(unexplained)} without a value, must have a reason")
        object.__setattr__(self, "metrics", MappingProxyType(metrics))
        object.__setattr__(self, "reasons", MappingProxyType({name: self.reasons[name] for name in absent}))

    def __getitem__(self, name: str) -> Metric:
        """Return a metric by name."""
        return self.metrics[name]

    @property
    def faults(self) -> list[dict[str, Cell]]:
        """Faults of a run in the order of detection, each as in `fault_row`."""
        found = self.metrics.get("faults")
        return found if isinstance(found, list) else []

    def to_dict(self) -> dict[str, Any]:
        """Return the metrics, the reasons under `reasons` and any errors under `errors`, as data for JSON."""
        return {**self.metrics, "reasons": dict(self.reasons), **({"errors": dict(self.errors)} if self.errors else {})}


def _has_value(metric: Metric) -> bool:
    return metric is not None and not (isinstance(metric, float) and not math.isfinite(metric))


@dataclass(frozen=True, eq=False)
class Record:
    """A finished run; when the scene is run again, all fields but `timing` are the same, bit for bit."""

    name: str
    """Name of the scene."""
    model: str
    scene: str
    """The resolved scene as TOML, with every default."""
    status: str
    sentence: str
    """Sentence about the end of the run."""
    seed: int
    versions: Mapping[str, str]
    """Versions of the programs that made the record."""
    summary: Summary
    variables: tuple[Variable, ...]
    """Variables with unique names; a dimension has the same length in all variables."""
    timing: tuple[Variable, ...] = ()
    """Wall-clock values."""
    checkpoint: tuple[Variable, ...] = ()
    """State from which the run can be continued, bit for bit."""
    run: str = ""
    """Worm, world and end of the run, in the format of `worm3d.load`; empty for a planar worm."""
    parts: tuple[Variable, ...] = ()
    """Arrays of worm and world."""

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
        """Return a variable; the sentence of the KeyError lists the existing variables."""
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
    """Raise an error for variables with the same name, or with different lengths of one dimension."""
    names = [variable.name for variable in variables]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"variables: {', '.join(twice)} given more than once, names must be unique")
    sizes: dict[str, int] = {}
    for variable in variables:
        for dim, size in variable.sizes.items():
            if sizes.setdefault(dim, size) != size:
                raise ValueError(f"{variable.name}: got {size} along '{dim}', must be {sizes[dim]} as before")
