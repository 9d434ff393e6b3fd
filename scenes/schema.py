"""How a scene's sections are declared: strict, frozen, each key with its unit, range, default and meaning."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

from scenes import toml_text
from scenes.toml_lines import KeyPath


class Section(BaseModel):
    """Keys of one section of a scene; nothing is converted, nothing unknown passes."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


def quantity(
    default: float | None = None,
    *,
    title: str,
    unit: str = "",
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
    aka: tuple[str, ...] = (),
) -> Any:
    """Declare a number.

    Parameters
    ----------
    default : float, optional
        Without one the key must be given.
    title : str
        What it is, in a few words.
    unit : str
        As in the key's name; empty for a pure number.
    gt, ge, lt, le : float, optional
        The range.
    aka : tuple of str
        Other names that people try, for "did you mean".
    """
    extra: dict[str, Any] = {"unit": unit, "aka": list(aka)}
    given = ... if default is None else default
    return Field(given, title=title, gt=gt, ge=ge, lt=lt, le=le, json_schema_extra=extra)


def setting(default: str | int | bool | None = None, *, title: str, aka: tuple[str, ...] = ()) -> Any:
    """Declare a choice, a switch or a text; without a default it must be given."""
    given = ... if default is None else default
    return Field(given, title=title, json_schema_extra={"aka": list(aka)})


def section_type(field: FieldInfo) -> type[Section] | None:
    """Return the section that a field holds, or None if it is a plain key."""
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, Section) else None


def field_at(schema: type[Section], path: KeyPath) -> FieldInfo | None:
    """Return the declaration of a key or section, or None if there is none."""
    field = schema.model_fields.get(str(path[0]))
    if field is None or len(path) == 1:
        return field
    inner = section_type(field)
    return field_at(inner, path[1:]) if inner else field


def names(schema: type[Section]) -> Iterator[tuple[str, str]]:
    """Yield each name that may be tried for a key, with the key it means."""
    for name, field in schema.model_fields.items():
        yield name, name
        yield from ((other, name) for other in _extra(field, "aka") or ())


def choices(field: FieldInfo) -> tuple[Any, ...]:
    """Return the allowed values of a choice, empty for anything else."""
    return get_args(field.annotation) if get_origin(field.annotation) is Literal else ()


def describe(field: FieldInfo, *, with_default: bool = True) -> str:
    """Return what an error line says of a key: ` [m], 0 < … <= 100 (default 1.0)`."""
    unit, span = _extra(field, "unit"), range_text(field)
    text = (f" [{unit}]" if unit else "") + (f", {span}" if span else "")
    known = with_default and not field.is_required() and section_type(field) is None
    return text + (f" (default {toml_text.shown(field.default)})" if known else "")


def range_text(field: FieldInfo) -> str:
    """Return the range of a number, `0 < … <= 100`; empty if it has none."""
    bounds = {key: getattr(m, key) for m in field.metadata for key in ("gt", "ge", "lt", "le") if hasattr(m, key)}
    low = next((f"{_short(bounds[k])} {sign} " for k, sign in (("gt", "<"), ("ge", "<=")) if k in bounds), "")
    high = next((f" {sign} {_short(bounds[k])}" for k, sign in (("lt", "<"), ("le", "<=")) if k in bounds), "")
    return f"{low}…{high}" if bounds else ""


def _short(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:g}"


def _extra(field: FieldInfo, key: str) -> Any:
    return field.json_schema_extra.get(key) if isinstance(field.json_schema_extra, dict) else None
