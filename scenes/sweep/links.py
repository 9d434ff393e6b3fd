"""Keys of a sweep that follow from others: choices, names for values of several keys, and keys given by formulas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from pydantic import BaseModel
from pydantic_core import to_jsonable_python

from scenes.language.errors import SceneError
from scenes.language.formulas import evaluated, is_formula, names_in
from scenes.language.sweep_section import varied_keys
from scenes.language.toml import shown
from scenes.sweep.vary import DIGITS


@dataclass(frozen=True)
class Links:
    """What a section [sweep] says beside the varied keys."""

    choices: Mapping[str, Mapping[str, Mapping[str, Any]]]
    """Axis -> name of a choice -> keys and their values; a text that begins with `=` is a formula."""
    always: Mapping[str, Any]
    """Keys of all cases, but for those whose choice says otherwise, and their formulas."""
    settings: BaseModel
    """Settings of the scene, which names that are not varied mean."""

    def axes(self, vary: Mapping[str, Any]) -> dict[str, Any]:
        """Return all axes of the sweep: the varied keys, then the choices."""
        if twice := [axis for axis in self.choices if axis in vary]:
            raise SceneError(f"sweep.choices.{twice[0]}: it is varied too; give one of the two another name")
        return {**vary, **{axis: list(names) for axis, names in self.choices.items()}}

    def keys_of(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the keys of a case and their values, given its places along the axes.

        A varied name that is no key of the scene, but stands in a formula, is a variable, and no key of the case.

        Raises
        ------
        SceneError
            A formula that cannot be read, or with a name that means no number.
        """
        given = dict(self.always)
        for axis, choices in self.choices.items():
            given |= varied_keys(choices[values[axis]])
        formulas = {key: text for key, text in given.items() if is_formula(text)}
        variables = set(self.choices).union(*map(names_in, formulas.values())) if formulas else set(self.choices)
        own = {key: value for key, value in values.items() if not (key in variables and _is_no_key(self.settings, key))}
        known = {**values, **{key: value for key, value in given.items() if key not in formulas}}
        for key, text in formulas.items():
            known[key] = own[key] = _plain(evaluated(text, partial(self._number, known, text)))
        return {**own, **{key: value for key, value in given.items() if key not in formulas}}

    def _number(self, known: Mapping[str, Any], formula: str, name: str) -> Any:
        value = known[name] if name in known else value_at(self.settings, name, None)
        if isinstance(value, bool) or not isinstance(value, int | float):
            got = "is not known" if value is None else f"is {shown(value)}, no number"
            raise SceneError(f"formula '{formula}': {name} {got}; names are keys of the scene, varied ones and others")
        return float(value)


def value_at(settings: BaseModel, key: str, otherwise: Any) -> Any:
    """Return the resolved value of a key as data for JSON: 2 and 2.0 seconds are the same; `otherwise` if no key."""
    here: Any = settings
    for name in key.split("."):
        if _is_no_key(here, name):
            return otherwise
        here = getattr(here, name)
    return to_jsonable_python(here)


def _is_no_key(section: Any, name: str) -> bool:
    fields = type(section).model_fields if isinstance(section, BaseModel) else {}
    return name.split(".")[0] not in fields


def _plain(value: Any) -> Any:
    """Return a number as it is written: a whole one without a point, others with `DIGITS` digits."""
    number = float(f"{value:.{DIGITS}g}")
    return int(number) if number.is_integer() else number
