"""Parameters of a dataclass, declared with unit, range and meaning at the field itself.

    @documented
    @dataclass(frozen=True, kw_only=True)
    class Wave:
        period: float = parameter(2.0, "duration of a wave", "s", gt=0)

        def __post_init__(self) -> None:
            check(self)

`check` validates an instance, and `documented` adds the Attributes section to the docstring. `scenes.language.parts`
makes the keys of a section of a scene from the same fields.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from textwrap import fill
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from worm3d.values import arguments
from worm3d.values.documented import by

T = TypeVar("T")

PARAMETER = "parameter"
"""Key of the `Parameter` in the metadata of a field."""

EACH: Mapping[str, tuple[int, str, str]] = MappingProxyType(
    {
        "": (0, "", ""),
        "segment": (1, "float or ndarray, shape (N,)", "a number or one for each segment"),
        "joint": (1, "float or ndarray, shape (N-1,)", "a number or one for each joint"),
        "side": (
            2,
            "float or ndarray, shape (N,) or (N, 2)",
            "a number, or one or a pair of left and right for each segment",
        ),
        "sample": (
            3,
            "ndarray, shape (M,), (N, M) or (N, 2, M)",
            "a list, or one or a pair of left and right lists for each segment",
        ),
    }
)
"""Properties of array parameters, by the objects that the numbers of an array describe.

The properties are the largest number of dimensions, the type for docstrings, and the form in words.
"""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Description of a parameter."""

    meaning: str
    """Meaning of the parameter, as a noun phrase."""
    unit: str = ""
    """SI unit, with radians for angles. Empty for a dimensionless number."""
    bounds: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Range, as the values of some of the bounds gt, ge, lt and le."""
    each: Literal["", "segment", "joint", "side", "sample"] = ""
    """Objects that the numbers of an array describe, a key of `EACH`. Empty for a single number."""
    infinite: bool = False
    """Whether the parameter may be infinite."""
    allowed: str = ""
    """Range in words for error messages, instead of the words that are made from `bounds`."""
    key: str = ""
    """Name in a scene, if it is not the name of the field with the unit."""
    aka: tuple[str, ...] = ()
    """Wrong names that users might write in a scene. The error message then suggests the correct name."""
    left_out: str = ""
    """Text in place of the default in the documentation, if there is no finite default."""
    name: str = ""
    default: Any = None
    hint: Any = None
    """Type of the field."""

    @property
    def optional(self) -> bool:
        """Whether the parameter may be None, which means a default that depends on other parameters."""
        return type(None) in get_args(self.hint)

    @property
    def choices(self) -> tuple[str, ...]:
        """The allowed words. Empty if the parameter is not a choice between words."""
        return get_args(self.hint) if get_origin(self.hint) is Literal else ()

    @property
    def is_pair(self) -> bool:
        """Whether the parameter is a pair of numbers. The class with the parameter then has to check it."""
        return get_origin(self.hint) is tuple

    def checked(self, value: Any, size: int | None = None, largest: float = arguments.MAX_MAGNITUDE) -> Any:
        """Return a checked value in the type that the rest of the program uses.

        Parameters
        ----------
        value : object
        size : int, optional
            Number of values of an array, if it is known.
        largest : float
            Largest allowed size of a single number.

        Raises
        ------
        ValueError
            The value has a wrong type or is out of range.
        """
        if (value is None and self.optional) or self.is_pair:
            return value
        if self.choices:
            return arguments.choice(self.name, value, self.choices)
        if self.hint is bool:
            return arguments.flag(self.name, value)
        if self.hint is str:
            return arguments.instance(self.name, value, str, "a text")
        if self.hint is int:
            return arguments.whole(self.name, value, **{key: int(bound) for key, bound in self.bounds.items()})
        if not self.each:
            words: dict[str, Any] = {"infinite": self.infinite, "allowed": self.allowed}
            return arguments.number(self.name, value, self.unit, largest=largest, **words, **self.bounds)
        if size is None:
            depth, _, form = EACH[self.each]
            return arguments.one_or_each(self.name, value, form, depth, **self.bounds)
        return arguments.array(self.name, value, (size,), fill=True, **self.bounds)


def parameter(
    default: Any = dataclasses.MISSING,
    meaning: str = "",
    unit: str = "",
    *,
    made: type[Parameter] = Parameter,
    **others: Any,
) -> Any:
    """Return a field of a dataclass, with its description.

    Parameters
    ----------
    default : object
        Default of the field. Without a default, the field is a required argument of the dataclass.
    meaning : str
        Meaning of the parameter, as a noun phrase. `worm3d init` and error messages show the meaning.
    unit : str
        SI unit, such as "s", "N/m" or "rad". Empty for a dimensionless number. A scene's key ends in the unit.
    made : type
        `Parameter` or a subclass.
    others
        Any of the following. The bounds `gt`, `ge`, `lt` and `le`: the value must be above, at least, below, or at most
        this number. `each`: "segment", "joint", "side" or "sample", if the value may be an array with a number for each
        of them; see `EACH`. `key`: name in a scene, if it is not the name of the field with the unit. `aka`: wrong
        names for which an error message suggests the right name. `infinite`: whether the value may be infinite.
        `left_out`: text in place of a default that is None or infinite.
    """
    bounds: dict[str, Any] = {name: others.pop(name) for name in ("gt", "ge", "lt", "le") if name in others}
    known = made(meaning=meaning, unit=unit, bounds=bounds, **others)
    return dataclasses.field(default=default, metadata={PARAMETER: known})


def _read(part: Any) -> Mapping[str, Parameter]:
    hints, found = get_type_hints(part), {}
    for field in dataclasses.fields(part):
        if known := field.metadata.get(PARAMETER):
            default = known.default if field.default is dataclasses.MISSING else field.default
            found[field.name] = dataclasses.replace(known, name=field.name, default=default, hint=hints[field.name])
    return MappingProxyType(found)


parameters_of: Callable[[type], Mapping[str, Parameter]] = cache(_read)
"""Function that returns the parameters of a dataclass by name. Fields without `parameter` are left out."""


def check(instance: Any, *, largest: float = arguments.MAX_MAGNITUDE, **sizes: int) -> None:
    """Check the parameters of a dataclass instance, and store them in the types that the rest of the program uses.

    The instance may be frozen. Single numbers must not be larger than `largest`. `sizes` are the numbers of values of
    arrays, for example `segment=6, joint=5` for arrays with a value for each segment or joint.
    """
    for name, known in parameters_of(type(instance)).items():
        value = known.checked(getattr(instance, name), sizes.get(known.each), largest)
        object.__setattr__(instance, name, value)


@by
def documented(part: Any) -> str:
    """Return the Attributes section for the parameters of a dataclass."""
    return "".join(map(_described, parameters_of(part).values()))


def _described(known: Parameter) -> str:
    """Return the lines of a docstring for a parameter.

    The first line has name, type, unit and default. The following lines have the meaning and the range.
    """
    default = f", default {known.left_out or known.default}" if known.left_out or known.default is not None else ""
    unit, span = f" [{known.unit}]" if known.unit else "", known.allowed
    if known.bounds and not span:
        span = arguments.range_text(infinite=True, **known.bounds)
    text = f"{known.meaning[:1].upper()}{known.meaning[1:]}{f'; {span}' if span else ''}."
    body = fill(text, width=110, initial_indent=" " * 8, subsequent_indent=" " * 8)
    return f"    {known.name} : {_type_text(known)}{unit}{default}\n{body}\n"


def _type_text(known: Parameter) -> str:
    if known.each:
        return EACH[known.each][1]
    if known.choices:
        return " or ".join(map(repr, known.choices))
    return "tuple of float" if known.is_pair else "float" if known.optional else str(known.hint.__name__)


def in_degrees(known: Parameter) -> Parameter:
    """Return a parameter in radians (also per second) as a parameter in degrees. Others are returned unchanged."""
    if not known.unit.startswith("rad"):
        return known
    turned = {name: round(math.degrees(bound), 9) for name, bound in known.bounds.items()}
    default = round(math.degrees(known.default), 9) if isinstance(known.default, float) else known.default
    unit = known.unit.replace("rad", "deg")
    return dataclasses.replace(known, unit=unit, bounds=turned, default=default)
