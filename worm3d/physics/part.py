"""Parts that have a name: the common base class of actuators, joint friction, media, loads and laws of friction.

A part is a frozen dataclass. Its fields are the parameters. Its class methods describe the behaviour in a time step in
CasADi symbols. The kernels are generated from these methods. Parameters are inputs of the kernels, so that each class
is compiled only once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, parameters_of
from worm3d.values.read_only import ReadOnly

Symbol = Any
"""A scalar expression: casadi.SX, or a number."""
Symbols = Mapping[str, Any]

Numbers = float | FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Part(ReadOnly):
    """Base class of all parts: a frozen dataclass with fields made by `worm3d.values.parameters.parameter`.

    The base class of a kind of parts has a registry, for example `class Actuator(Part, registry=ACTUATORS)`. Each
    subclass, for example `class Valve(Actuator, name="valve")`, is added to the registry of its kind under its name.

    Raises
    ------
    ValueError
        A name that another class has, a parameter that is out of range, or a parameter name that is taken.
    """

    name: ClassVar[str] = ""
    """Name in scenes; empty if scenes cannot use the part."""
    states: ClassVar[Mapping[str, str]] = {}
    """Unit of each state of a chamber or hinge, by name."""
    known: ClassVar[tuple[str, ...]] = ()
    """Names of the inputs of the methods other than parameters and states."""
    needs_links: ClassVar[bool] = False
    """Whether an actuator or a friction uses the links of a rhombus, which other segment laws do not have."""
    told: ClassVar[tuple[str, ...]] = ("states",)
    """Class attributes that files of results contain for classes outside worm3d, whose code may be missing later."""
    registry: ClassVar[dict[str, Any]] = {}
    """Class of each part of the same kind, by name."""

    def __init_subclass__(cls, name: str = "", registry: dict[str, Any] | None = None) -> None:
        super().__init_subclass__()
        if registry is not None:
            cls.registry = registry
        there = cls.registry.get(name)
        if there is not None and (there.__module__, there.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"{cls.__name__}: {there.__qualname__} has the name {name!r} already, must be another one")
        cls.name = name
        if name:
            cls.registry[name] = cls

    def __post_init__(self) -> None:
        names = [*parameters_of(type(self)), *self.states]
        if taken := sorted({name for name in names if name in self.known or names.count(name) > 1}):
            raise ValueError(f"{type(self).__name__}: the names {', '.join(taken)} are taken; rename the parameter")
        check(self)
        super().__post_init__()

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(np.array_equal(getattr(self, each.name), getattr(other, each.name)) for each in fields(self))

    __hash__ = None  # type: ignore[assignment]

    def parameters(self) -> Mapping[str, Numbers]:
        """Return the parameters by name; each is a number, or an array with a number for each segment."""
        return {name: getattr(self, name) for name in parameters_of(type(self))}

    def require_size(self, name: str, count: int) -> None:
        """Raise ValueError if a parameter is an array of another size; `name` is the argument that holds the part."""
        for field in parameters_of(type(self)):
            arguments.require_count(f"{name}.{field}", getattr(self, field), count)
