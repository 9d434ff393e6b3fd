"""Keys of a sweep that are set together with varied keys.

A choice is a name for values of several keys. Formulas compute the values of keys from other keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from typing import Any

from scenes.language.errors import SceneError
from scenes.language.formulas import evaluated, is_formula, names_in
from scenes.language.schema import Section, keys_in
from scenes.language.sweep_section import varied_keys
from scenes.language.toml import path_of, shown
from scenes.sweep.vary import DIGITS


@dataclass(frozen=True)
class Links:
    """The choices and formulas of a section [sweep]."""

    choices: Mapping[str, Mapping[str, Mapping[str, Any]]]
    """Choices by the name of their axis. Each is a dictionary from the name of the choice to keys and their values. A
    text that begins with `=` is a formula."""
    always: Mapping[str, Any]
    """Values or formulas of keys for all cases. If a choice sets the same key, the value of the choice is used."""
    settings: Section
    """Settings of the scene. They supply formulas with the values of keys that are not varied."""

    def axes(self, vary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values along all axes of the sweep, first of the varied keys and then of the choices."""
        if twice := [axis for axis in self.choices if axis in vary]:
            raise SceneError(f"sweep.choices.{twice[0]}: it is varied too; give one of the two another name")
        return {**vary, **{axis: list(names) for axis, names in self.choices.items()}}

    def keys_of(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the keys that a case sets and their values, given its values along the axes.

        A varied name that occurs in a formula and is not a key of the scene is a variable of formulas only.

        Raises
        ------
        SceneError
            If a formula is invalid, or has a name whose value is not a number.
        """
        given = dict(self.always)
        for axis, choices in self.choices.items():
            given |= varied_keys(choices[values[axis]])
        own = {key: value for key, value in values.items() if key not in self._variables}
        known = {**values, **{key: value for key, value in given.items() if not _names(value)}}
        for key, value in given.items():
            try:
                known[key] = own[key] = self._settled(value, known)
            except SceneError as error:
                raise SceneError(*(f"sweep, {key}: {line}" for line in error.lines)) from error
        return own

    @cached_property
    def _variables(self) -> set[str]:
        """Names that are not keys of the scene: the axes of choices, and variables of formulas."""
        given = [*self.always.values()]
        for choices in self.choices.values():
            given += [value for keys in choices.values() for value in varied_keys(keys).values()]
        named = set().union(*map(_names, given))
        return {*self.choices, *(name for name in named if _is_no_key(self.settings, path_of(name)[0]))}

    def _settled(self, value: Any, known: Mapping[str, Any]) -> Any:
        """Return a value with formulas replaced by their results. The value may be a list of formulas."""
        if isinstance(value, list):
            return [self._settled(item, known) for item in value]
        return _plain(evaluated(value, partial(self._number, known, value))) if is_formula(value) else value

    def _number(self, known: Mapping[str, Any], formula: str, name: str) -> Any:
        value = known[name] if name in known else value_at(self.settings, name, None)
        if isinstance(value, bool) or not isinstance(value, int | float):
            got = "is not known" if value is None else f"is {shown(value)}, no number"
            raise SceneError(f"formula '{formula}': {name} {got}; the names in a formula are keys of the scene")
        return float(value)


def given_keys(sweep: Mapping[str, Any]) -> set[str]:
    """Return all keys that a section [sweep] sets in cases."""
    choices = [keys for axis in sweep.get("choices", {}).values() for keys in axis.values()]
    return set().union(*map(varied_keys, (sweep.get("vary", {}), sweep.get("set", {}), *choices)))


def _names(value: Any) -> set[str]:
    """Return the names in a formula or in a list of formulas; empty for other values."""
    if isinstance(value, list):
        return set().union(*map(_names, value))
    return names_in(value) if is_formula(value) else set()


def value_at(settings: Section, key: str, otherwise: Any) -> Any:
    """Return the value of a key in checked settings, or `otherwise` if there is no such key."""
    here: Any = settings
    for name in path_of(key):
        if _is_no_key(here, name):
            return otherwise
        here = getattr(here, name)
    return asdict(here) if isinstance(here, Section) else here


def _is_no_key(section: Any, name: str) -> bool:
    return not isinstance(section, Section) or name not in keys_in(type(section))


def _plain(value: Any) -> Any:
    """Return a number rounded to `DIGITS` digits, as an integer if it is whole."""
    number = float(f"{value:.{DIGITS}g}")
    return int(number) if number.is_integer() else number
