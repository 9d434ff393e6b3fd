"""How a scene's sections are declared: strict, frozen, each key with its unit, range, default and meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Strict, Tag
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from scenes.language import toml
from scenes.language.toml import KeyPath
from worm3d.values import named
from worm3d.values.parameters import EACH

N = TypeVar("N")

OWN = "module:NAME"
"""Stands, among the kinds that a key is for, for all kinds of the user's own."""

FORMS = ("<number>", "<list>")
"""Tags of the two forms of an `Each`; pydantic puts them into the place of a mistake."""


def _form(value: Any) -> str:
    return FORMS[isinstance(value, list | tuple)]


Each = Annotated[
    Annotated[N, Tag(FORMS[0])] | Annotated[tuple[N, ...], Strict(False), Tag(FORMS[1])], Discriminator(_form)
]
"""A number for all, or a list with one for each; an annotated number checks the range of every one."""


def _is_int(value: Any) -> Any:
    if isinstance(value, str) or (type(value) is int):
        return value
    raise PydanticCustomError("literal_error", "input should be -1 or 1")


Sign = Annotated[Literal[-1, 1], BeforeValidator(_is_int)]
"""-1 or 1; to Python `true` and 1.0 are equal to 1, to a scene they are not."""

Numbers = Annotated[tuple[float, ...], Strict(False), Field(min_length=1)]
"""A list of numbers, at least one."""

Pair = Annotated[tuple[float, ...], Strict(False), Field(min_length=2, max_length=2)]
Triple = Annotated[tuple[float, ...], Strict(False), Field(min_length=3, max_length=3)]
"""A list of two or three numbers."""

Points = Annotated[tuple[Triple, ...], Strict(False)]
"""A list of places, [x, y, z] each."""

Tables = Annotated[tuple[N, ...], Strict(False)]
"""An array of tables: `Tables[Patch]` are sections under headers [[world.patches]]."""


class Section(BaseModel):
    """Keys of one section of a scene; nothing is converted, nothing unknown passes."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=())


def quantity(
    default: float | tuple[float, ...] | None = None,
    *,
    title: str,
    unit: str = "",
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
    aka: tuple[str, ...] = (),
    each: Literal["", "segment", "joint", "side", "sample"] = "",
    left_out: str = "",
    only: str | tuple[str, ...] = "",
    own: Mapping[str, Any] | None = None,
) -> Any:
    """Declare a number, or several.

    Parameters
    ----------
    default : float or tuple of float, optional
        Without one the key must be given.
    title : str
        What it is, in a few words.
    unit : str
        As in the key's name; empty for a pure number.
    gt, ge, lt, le : float, optional
        The range.
    aka : tuple of str
        Other names that people try, for "did you mean".
    each : str
        What the key, an `Each`, takes lists for; a key of `worm3d.values.parameters.EACH`.
    left_out : str
        What holds if the key is left out; it then has no default but None.
    only : str or tuple of str
        The `kind`, or kinds, of its section that the key is for; empty for all.
    own : mapping, optional
        Defaults by kind, where kinds have their own; the key's is then None (`with_own_defaults`).
    """
    extra: dict[str, Any] = {"unit": unit, "aka": list(aka), "number": True, "each": each, "left_out": left_out}
    extra |= {"only": _kinds(only), "own": dict(own or {})}
    given = ... if default is None and not left_out else default
    return Field(given, title=title, gt=gt, ge=ge, lt=lt, le=le, json_schema_extra=extra)


def setting(
    default: str | int | bool | None = None,
    *,
    title: str,
    aka: tuple[str, ...] = (),
    left_out: str = "",
    only: str | tuple[str, ...] = "",
    is_file: bool = False,
    words: Mapping[str, tuple[str, ...]] | None = None,
    own: Mapping[str, Any] | None = None,
) -> Any:
    """Declare a choice, a switch or a text (`is_file`: a path); without a default it must be given. See `quantity`.

    `words` are the kinds of the section that each word of a choice is for.
    """
    given = ... if default is None and not left_out else default
    extra: dict[str, Any] = {"aka": list(aka), "left_out": left_out, "only": _kinds(only), "file": is_file}
    extra["own"] = dict(own or {})
    extra["words"] = {word: list(kinds) for word, kinds in (words or {}).items()}
    return Field(given, title=title, json_schema_extra=extra)


def part(
    names: Sequence[str], *, title: str, aka: tuple[str, ...] = (), only: str | tuple[str, ...] = ""
) -> tuple[Any, Any]:
    """Return type and declaration of a key that names a part: one of `names`, the first by default, or `module:NAME`.

    See `worm3d.values.named`. With `OWN` among the kinds that a key is `only` for, it is for a user's own kinds too.
    """
    return _name_type(tuple(names)), _names(names[0], names, title, aka, only)


def parts(
    names: Sequence[str], *, title: str, aka: tuple[str, ...] = (), only: str | tuple[str, ...] = ""
) -> tuple[Any, Any]:
    """Return type and declaration of a key that lists parts, all of `names` by default. See `part`."""
    each: Any = tuple
    listed = each[_name_type(tuple(names)), ...]
    return Annotated[listed, Strict(False)], _names(tuple(names), names, title, aka, only)


def _names(default: Any, names: Sequence[str], title: str, aka: tuple[str, ...], only: str | tuple[str, ...]) -> Any:
    extra: dict[str, Any] = {"aka": list(aka), "only": _kinds(only), "left_out": "", "file": False, "own": {}}
    return Field(default, title=title, json_schema_extra=extra | {"words": {}, "choices": list(names)})


def _name_type(names: tuple[str, ...]) -> Any:
    def known(name: str) -> str:
        if name in names or named.is_own(name):
            return name
        allowed = f"one of {', '.join(map(repr, names))}, or module:NAME" if names else "module:NAME"
        raise PydanticCustomError("name", "input should be {allowed}", {"allowed": allowed})

    return Annotated[str, AfterValidator(known)]


def tables(*, title: str, only: str | tuple[str, ...] = "") -> Any:
    """Declare an array of tables, none by default. See `quantity`."""
    return Field((), title=title, json_schema_extra={"aka": [], "only": _kinds(only)})


def _kinds(only: str | tuple[str, ...]) -> list[Any]:
    """Return kinds of a section as a list, empty for all."""
    return list(only) if isinstance(only, tuple) else [only] if only else []


def section_type(field: FieldInfo) -> type[Section] | None:
    """Return the section that a field holds, or None if it is a plain key."""
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, Section) else None


def table_type(field: FieldInfo) -> type[Section] | None:
    """Return the section of which a field holds an array, or None if it holds something else."""
    kind = next(iter(get_args(field.annotation)), None) if get_origin(field.annotation) is tuple else None
    return kind if isinstance(kind, type) and issubclass(kind, Section) else None


def field_at(schema: type[Section], path: KeyPath) -> FieldInfo | None:
    """Return the declaration of a key or section, or None if there is none; indices in the path are passed over."""
    keys = [key for key in path if isinstance(key, str)]
    field = schema.model_fields.get(keys[0])
    if field is None or len(keys) == 1:
        return field
    inner = section_type(field) or table_type(field)
    return field_at(inner, tuple(keys[1:])) if inner else field


def names(schema: type[Section]) -> Iterator[tuple[str, str]]:
    """Yield each name that may be tried for a key, with the key it means."""
    for name, field in schema.model_fields.items():
        yield name, name
        yield from ((other, name) for other in _extra(field, "aka") or ())


def choices(field: FieldInfo) -> tuple[Any, ...]:
    """Return the allowed values of a choice, or the names of parts that ship; empty for anything else."""
    listed = _extra(field, "choices")
    if listed:
        return tuple(listed)
    return get_args(field.annotation) if get_origin(field.annotation) is Literal else ()


def describe(field: FieldInfo, *, with_default: bool = True) -> str:
    """Return what an error line says of a key: ` [m], 0 < … <= 100 (default 1.0)`."""
    unit, span, each = (_extra(field, "unit"), range_text(field), each_of(field))
    text = (f" [{unit}]" if unit else "") + (f", {span}" if span else "")
    text += f", {EACH[each][2]}" if each else ""
    known = with_default and not field.is_required() and section_type(field) is None
    return text + (f" (default {default_text(field)})" if known else "")


def default_text(field: FieldInfo) -> str:
    """Return the default of a key, or what holds if the key is left out."""
    return _extra(field, "left_out") or toml.shown(field.default)


def meaning(field: FieldInfo) -> str:
    """Return what a key is, in a few words, and for which kinds of its section it is if it is not for all."""
    only = ", ".join(few(only_for(field)))
    return f"{only} only: {field.title}" if only else str(field.title)


def few(words: Sequence[str]) -> list[str]:
    """Return words, or of more than four the first two and how many others there are."""
    return [*words] if len(words) <= 4 else [*words[:2], f"{len(words) - 2} others"]


def only_for(field: FieldInfo) -> tuple[str, ...]:
    """Return the kinds of its section that a key is for; empty for all."""
    return tuple(_extra(field, "only") or ())


def own_defaults(field: FieldInfo) -> Mapping[str, Any]:
    """Return the defaults of a key by the kinds of its section; empty where it has one for all."""
    return _extra(field, "own") or {}


def with_own_defaults(schema: type[Section], data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of a scene with the defaults that keys have in the kinds that its sections choose.

    A kind of the user's own has those of `OWN`, if there are any; a kind that is wrong, of which others tell, counts as
    the first.
    """
    filled = dict(data)
    for name, declared in schema.model_fields.items():
        section, keys = section_type(declared), data.get(name, {})
        if section is None or "kind" not in section.model_fields or not isinstance(keys, Mapping):
            continue
        kinds = section.model_fields["kind"]
        asked = keys.get("kind")
        kind: Any = asked if asked in choices(kinds) else kinds.default
        known = {key: own_defaults(field) for key, field in section.model_fields.items() if key not in keys}
        if isinstance(asked, str) and named.is_own(asked):
            known = {key: {kind: own[OWN]} if OWN in own else own for key, own in known.items()}
        added = {key: own[kind] for key, own in known.items() if kind in own}
        if added:
            filled[name] = {**keys, **added}
    return filled


def words_of(field: FieldInfo, kind: str) -> tuple[str, ...]:
    """Return the words of a choice that a kind of its section allows."""
    kinds = _extra(field, "words") or {}
    return tuple(word for word in choices(field) if kind in kinds.get(word, [kind]))


def is_file(field: FieldInfo) -> bool:
    """Return whether a key holds the path of a file."""
    return bool(_extra(field, "file"))


def each_of(field: FieldInfo) -> str:
    """Return what a key takes lists for, a key of `worm3d.values.parameters.EACH`; empty if it is a single value."""
    return str(_extra(field, "each") or "")


def is_number(field: FieldInfo) -> bool:
    """Return whether a key holds a number (or several)."""
    return bool(_extra(field, "number"))


def unit_of(field: FieldInfo) -> str:
    """Return the unit of a number, "1" for a pure one; empty for anything else."""
    return str(_extra(field, "unit") or "1") if is_number(field) else ""


def is_whole(field: FieldInfo) -> bool:
    """Return whether a key holds one whole number."""
    return field.annotation is int or set(get_args(field.annotation)) == {int, type(None)}


def range_text(field: FieldInfo) -> str:
    """Return the range of a number, `0 < … <= 100`; empty if it has none."""
    bounds = bounds_of(field)
    low = next((f"{_short(bounds[k])} {sign} " for k, sign in (("gt", "<"), ("ge", "<=")) if k in bounds), "")
    high = next((f" {sign} {_short(bounds[k])}" for k, sign in (("lt", "<"), ("le", "<=")) if k in bounds), "")
    return f"{low}…{high}" if bounds else ""


def bounds_of(field: FieldInfo) -> dict[str, Any]:
    """Return those of `gt`, `ge`, `lt` and `le` that a number has."""
    rules = (*field.metadata, *_rules(field.annotation))
    return {key: getattr(m, key) for m in rules for key in ("gt", "ge", "lt", "le") if hasattr(m, key)}


def _rules(annotation: Any) -> Iterator[Any]:
    """Yield what the items of an annotation have to obey."""
    for part in get_args(annotation):
        yield from part.metadata if isinstance(part, FieldInfo) else _rules(part)


def _short(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:g}"


def _extra(field: FieldInfo, key: str) -> Any:
    return field.json_schema_extra.get(key) if isinstance(field.json_schema_extra, dict) else None
