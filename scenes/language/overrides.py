"""Overrides from the command line, `section.key=value`, applied to the data of a scene."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from scenes.language.errors import SceneError
from scenes.language.mistakes import Mistake, dotted
from scenes.language.toml import MAX_NESTING, KeyPath, path_of, require_shallow
from worm3d.values.named import is_own


def apply_overrides(
    data: Mapping[str, Any], overrides: Iterable[str], most: int = 1000
) -> tuple[dict[str, Any], list[KeyPath], list[Mistake]]:
    """Return a copy of the data with the overrides applied, the paths of the overrides, and mistakes in them.

    Raises
    ------
    SceneError
        If an override is no text, there are more than `most` overrides, or the value of an override is nested too
        deeply.
    """
    overrides = override_texts(overrides)
    if len(overrides) > most:
        raise SceneError(f"got {len(overrides)} overrides, at most {most} are allowed: write them into a scene's file")
    result: dict[str, Any] = dict(data)
    paths: list[KeyPath] = []
    mistakes: list[Mistake] = []
    for override in overrides:
        key, equals, text = override.partition("=")
        path = path_of(key)
        paths.append(path)
        if not (equals and all(path)) or len(path) > MAX_NESTING:
            mistakes.append(Mistake(path, "must be written as section.key=value"))
        elif (outer := _plain_value_above(result, path)) is not None:
            mistakes.append(Mistake(path, f"{dotted(outer)} is not a section, it has no keys"))
        else:
            result = _with(result, path, _value(text.strip()))
    require_shallow(result)
    return result, paths, mistakes


def override_texts(overrides: Any) -> tuple[str, ...]:
    """Return overrides as a tuple; raise SceneError if they are no list of texts, since programs may pass anything."""
    try:
        texts = () if isinstance(overrides, str | Mapping) else tuple(overrides)
    except TypeError:
        texts = ()
    if overrides and (not texts or not all(isinstance(text, str) for text in texts)):
        raise SceneError(f'overrides: got {overrides!r:.60}, must be a list of texts, such as ["run.duration_s=4"]')
    return texts


def _value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _plain_value_above(data: Mapping[str, Any], path: KeyPath) -> KeyPath | None:
    here: Any = data
    for depth, key in enumerate(path[:-1], start=1):
        here = {} if _is_switch(key, here.get(key)) else here.get(key, {})
        if not isinstance(here, Mapping):
            return path[:depth]
    return None


def _with(data: Mapping[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    key, rest = path[0], path[1:]
    inner = {} if _is_switch(key, data.get(key)) else data.get(key, {})
    return {**data, key: _with(inner, rest, value) if rest else value}


def _is_switch(key: str | int, value: Any) -> bool:
    """Return whether `key = value` switches on a user's own part without parameters.

    An override of a parameter of this part then replaces the switch by a section.
    """
    return value is True and is_own(str(key))
