"""Kinds of parts that scenes take as `module:NAME`, and the decorator that marks a user's own as one of a kind.

A class that is derived from the base class of its kind is marked by that. Anything else is marked by hand, such as a
controller that shares nothing with those that ship:

    @part("controller")
    class Mine:
        @classmethod
        def of(cls, task): ...

A scene calls nothing that is not marked for the key in which it stands.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Any, TypeVar

from worm3d.values.named import Kind, marked

T = TypeVar("T", bound=Callable[..., Any])

CONTROLLER = Kind("controller", "a controller", "control.loop", "WaveController", form="of(task)")
ESTIMATOR = Kind(
    "estimator",
    "an estimator",
    "control.estimation.estimator",
    "Estimator",
    form="for_sensors(worm, model, schedule, sensors)",
)
MODEL = Kind("model", "a model", "control.estimation.reduced", "ReducedModel", form="of(worm, identified, mechanism)")
TERM = Kind("term", "a term of the cost", "control.planning.terms", "CostTerm")
CONSTRAINT = Kind("constraint", "a constraint", "control.planning.constraints", "Constraint")
PATH = Kind("path", "a path", "control.tracking.paths", "Path")
KINDS = MappingProxyType({kind.name: kind for kind in (CONTROLLER, ESTIMATOR, MODEL, TERM, CONSTRAINT, PATH)})
"""Kinds by name."""


def part(kind: str) -> Callable[[T], T]:
    """Return the decorator that marks a class, or a function that returns such an object, as a part of a kind.

    Parameters
    ----------
    kind : str
        A name of `KINDS`.

    Raises
    ------
    ValueError
        There is no such kind.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        known = ", ".join(map(repr, KINDS))
        raise ValueError(f"part: got {getattr(kind, '__name__', kind)!r}, must be one of {known}: @part('controller')")
    return lambda given: marked(kind, given)
