"""Users' own parts in a scene, which the scene names as `module:NAME`.

This module extends the schema of a scene by the keys of such parts (`completed`), or removes such parts from a scene
(`without`). There are two cases. If a key names a single part, such as gait.kind, the parameters of the part are keys
of the same section. If a section lists several parts, such as cost.parts, or contains the parts themselves, such as
[fault], each part has a sub-section, [fault."my_robot:Slip"]. Without parameters the sub-section may be written as a
switch, fault."my_robot:Slip" = true.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import cache
from types import new_class
from typing import Any, NamedTuple, TypeVar

from scenes.language.checks import of_this_kind
from scenes.language.mistakes import Mistake
from scenes.language.parts import ITSELF, Keys, PartSection, head, keys_of
from scenes.language.schema import OWN_KINDS, Key, Section, keys_in
from worm3d.values import named
from worm3d.values.named import Kind

S = TypeVar("S", bound=Section)

Extended = tuple[type[Section], Mapping[str, Any], list[Mistake]]
"""Class of a section with the keys of users' own parts, data of the section, and mistakes."""


class _Named(NamedTuple):
    """A user's own part that a section names."""

    key: str
    """Key of the section that names the part, as in `PartSection.holds`."""
    name: str
    """Name of the part, `module:NAME`."""
    kind: Kind
    parts: tuple[Any, ...] = ()
    """The imported part, in a tuple; empty before the import."""

    def __hash__(self) -> int:
        return hash((self.key, self.name, *map(id, self.parts)))

    def in_a_section(self, section: type[Section]) -> bool:
        """Return whether the part has a sub-section. It has one if the section may have several parts."""
        return self.key == ITSELF or isinstance(keys_in(section)[self.key].default, tuple)


def completed(schema: type[S], data: Mapping[str, Any]) -> tuple[type[S], dict[str, Any], list[Mistake]]:
    """Return the schema extended by the keys of the user's own parts in a scene, the data of the scene, and mistakes.

    The modules of the parts are imported. In the data, a switch that is true becomes an empty sub-section.
    """
    filled, mistakes, changed = dict(data), list[Mistake](), dict[str, type[Section]]()
    for name, declared in keys_in(schema).items():
        section, given = declared.section, data.get(name)
        if section is not None and isinstance(given, Mapping):
            extended, given, wrong = _with_parts(name, section, given)
            extended, filled[name], wrong_tables = _with_tables(name, extended, given)
            mistakes += wrong + wrong_tables
            changed |= {name: extended} if extended is not section else {}
    return _with(schema, tuple(changed.items())) if changed else schema, filled, mistakes


def _with_parts(name: str, section: type[Section], given: Mapping[str, Any]) -> Extended:
    """Return a section with the keys of the user's own parts that its data name."""
    asked, mistakes = _asked(section, given), list[Mistake]()
    if not asked:
        return section, given, mistakes
    found = [*_found(name, asked, mistakes)]
    lost = {each.name for each in asked} - {each.name for each in found}
    off = {each.name for each in found if each.key == ITSELF and given.get(each.name) is False}
    found = [each for each in found if each.name not in off]
    asked_for = {each.name: given.get(each.name, True) for each in found if each.in_a_section(section)}
    kept = {key: value for key, value in given.items() if key not in lost | off}
    kept |= {each: {} if value is True else value for each, value in asked_for.items()}
    if lost:  # without the parts, their keys would be reported as unknown
        kept = {key: value for key, value in kept.items() if key in {*keys_in(section), *asked_for}}
    if not found:
        return section, kept, mistakes
    extended, clashes = _extended(section, tuple(found))
    mistakes += [Mistake((name, each.key), text) for each, text in clashes]
    mistakes += _of_other_kinds(name, section, extended, found[0], kept)
    return extended, kept, mistakes


def _found(name: str, asked: list[_Named], mistakes: list[Mistake]) -> Iterator[_Named]:
    """Yield the imported parts of a section. Names without a part are added to the mistakes."""
    for each in asked:
        try:
            yield each._replace(parts=(named.own(each.name, each.kind),))
        except ValueError as error:
            mistakes.append(Mistake((name, each.key or each.name), str(error)))


def _of_other_kinds(
    name: str, section: type[Section], extended: type[Section], own: _Named, kept: dict[str, Any]
) -> Iterator[Mistake]:
    """Remove the keys of shipped kinds from the data of a section, and yield mistakes for those set by the user."""
    for key in keys_in(section).keys() - keys_in(extended).keys() & kept.keys():
        known = keys_in(section)[key]
        known = replace(known, only=known.only or keys_in(section)[own.key].choices)
        text = of_this_kind(kept.pop(key), own.name, by=f"{name}.{own.key}", known=known)
        if text:
            yield Mistake((name, key), str(text))


def _with_tables(name: str, section: type[Section], given: Mapping[str, Any]) -> Extended:
    """Return a section with the keys of the user's own parts that its arrays of tables name."""
    mistakes = list[Mistake]()
    for key, by, kind, items in _tables(section, given):
        parts, lost = dict[str, Any](), set[int]()
        for n, name_of in ((n, each) for n, item in enumerate(items) for each in _own_names(item, by)):
            try:
                parts[name_of] = named.own(name_of, kind)
            except ValueError as error:
                lost.add(n)
                mistakes.append(Mistake((name, key, n, by), str(error)))
        if lost:  # without the parts, their keys would be reported as unknown
            given = {**given, key: [item for n, item in enumerate(items) if n not in lost]}
        if parts:
            section = _with_table(section, key, tuple(parts.items()))
    return section, given, mistakes


def _tables(section: type[Section], given: Mapping[str, Any]) -> Iterator[tuple[str, str, Kind, list[Any]]]:
    """Yield a section's arrays of tables that describe parts.

    Each item has the key of the array, the key of a table that names the part, the kind of the parts, and the tables.
    """
    for key, known in keys_in(section).items():
        items = given.get(key)
        for by, kind in getattr(known.table, "holds", {}).items() if isinstance(items, list | tuple) else ():
            yield key, by, kind, list(items or ())


def without(schema: type[Section], data: Mapping[str, Any], but: Collection[str] = ()) -> dict[str, Any]:
    """Return the data of a scene without users' own parts; no module is imported.

    A section with a key that names such a part is removed. Sections in `but` are kept, without the keys of the part.
    """
    filled = dict(data)
    for name, known in keys_in(schema).items():
        section, given = known.section, data.get(name)
        if section is None or not isinstance(given, Mapping):
            continue
        if there := _asked(section, given):
            given = {key: value for key, value in given.items() if key in keys_in(section)}
        for key, by, _, items in _tables(section, given):
            given = {**given, key: [item for item in items if not _own_names(item, by)]}
        filled[name] = given
        if there and name not in but and not there[0].in_a_section(section):
            del filled[name]
    return filled


def _asked(section: type[Section], given: Mapping[str, Any]) -> list[_Named]:
    """Return the user's own parts that the data of a section name."""
    kinds = section.holds if issubclass(section, PartSection) else {}
    return [_Named(key, each, kind) for key, kind in kinds.items() for each in _own_names(given, key)]


def _own_names(given: Any, key: str) -> list[str]:
    if not isinstance(given, Mapping):
        return []
    value = list(given) if key == ITSELF else given.get(key)
    names = value if isinstance(value, list | tuple) else [value]
    return [name for name in dict.fromkeys(each for each in names if isinstance(each, str)) if named.is_own(name)]


@cache
def _extended(
    section: type[PartSection], own: tuple[_Named, ...]
) -> tuple[type[Section], tuple[tuple[_Named, str], ...]]:
    """Return a section with the keys of a user's own parts, and errors for parts whose keys clash with other keys."""
    first = next(iter(section.holds))
    is_chosen = any(each.key == first and not each.in_a_section(section) for each in own)
    keys: Keys = {
        key: known
        for key, known in keys_in(section).items()
        if not is_chosen or (key not in section.of_parts and (not known.only or OWN_KINDS in known.only))
    }
    clashes: list[tuple[_Named, str]] = []
    for each in own:
        (part,) = each.parts
        if each.in_a_section(section):
            inner = _section_of("Own", section.each(each.name, part), head(part))
            keys[each.name] = Key(meaning="", hint=inner, default=inner())
            continue
        added = _keys(section, each, part) if each.key == first else {}
        taken = [key for key in added if key in keys]
        clashes += [
            (each, f"{each.name}: the key {key} of its parameter is taken; rename the parameter") for key in taken
        ]
        keys |= added
    made = _section_of(section.__name__, keys, section.__doc__)
    made.holds = {} if is_chosen else section.holds
    return made, tuple(clashes)


def _section_of(name: str, keys: Keys, doc: str | None, base: type[Section] = PartSection) -> Any:
    """Return a new class of a section with the given keys, derived from `base`."""
    space: dict[str, Any] = {
        "__annotations__": {key: known.hint for key, known in keys.items()},
        "__doc__": doc or "Parameters of a part.",
    }
    space |= {key: known.as_field() for key, known in keys.items()}
    return new_class(name, (base,), exec_body=lambda body: body.update(space))


def _keys(section: type[PartSection], each: _Named, part: Any) -> Keys:
    """Return the keys for the parameters of a user's own part. They are named as for shipped parts."""
    made = section.source({each.name: part}) if hasattr(section, "source") else keys_of({each.name: part})
    return {key: declared for key, declared in made.items() if key not in section.holds}


@cache
def _with_table(section: type[Section], key: str, parts: tuple[tuple[str, Any], ...]) -> type[Section]:
    """Return a section whose array of tables `key` also has the keys of a user's own parts.

    `parts` are pairs of `module:NAME` and the part.
    """
    known = keys_in(section)[key]
    table: Any = known.table
    ((by, kind),) = table.holds.items()
    keys = table.source({**kind.registry, **dict(parts)})
    inner = _section_of(table.__name__, {**keys, by: keys_in(table)[by]}, table.__doc__)
    inner.holds = table.holds
    many: Any = tuple
    made: type[Section] = _section_of(
        section.__name__, {key: replace(known, hint=many[inner, ...])}, section.__doc__, section
    )
    return made


@cache
def _with(schema: type[S], sections: tuple[tuple[str, type[Section]], ...]) -> type[S]:
    """Return a schema with some sections replaced, by name."""
    keys = {name: Key(meaning="", hint=section, default=section()) for name, section in sections}
    made: type[S] = _section_of(schema.__name__, keys, schema.__doc__, schema)
    return made
