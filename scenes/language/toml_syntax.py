"""TOML parsed, or the place of the syntax error with the source line and a caret."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from typing import Any

from scenes.language.errors import SceneError

SHOWN = 160
"""Characters of a line that are shown about a mistake."""

_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

_KEYS = re.compile(r"""\((?:'[^']*'|"[^"]*")(?:, (?:'[^']*'|"[^"]*"))*,?\)""")
"""A path as the messages show it: a tuple of Python."""


DEEPEST = 20
"""Sections, tables and lists within each other; no scene needs more than 5."""


def parse(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    SceneError
        Broken TOML: what and where, the source line, a caret under the column. Or nested deeper than `DEEPEST`.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(*_picture(text, str(error))) from error
    except RecursionError as error:
        raise SceneError("broken TOML: the brackets are nested too deeply") from error
    except ValueError as error:
        raise SceneError("broken TOML: a number has thousands of digits") from error
    require_shallow(data)
    return data


def require_shallow(data: Any) -> None:
    """Raise SceneError for what is nested deeper than `DEEPEST`: all that walks through it does so by recursion."""
    level = [data]
    for _ in range(DEEPEST):
        level = [item for outer in level for item in _items(outer)]
    if level:
        raise SceneError(f"sections and lists are nested too deeply: got more than {DEEPEST} within each other")


def _items(outer: Any) -> Iterator[Any]:
    inner = outer.values() if isinstance(outer, dict) else outer if isinstance(outer, list) else ()
    return (item for item in inner if isinstance(item, dict | list))


def _picture(text: str, message: str) -> tuple[str, str, str]:
    lines = text.replace("\r\n", "\n").split("\n")
    place = _PLACE.search(message)
    if place and place[1]:
        line, column = int(place[1]), int(place[2])
    else:
        line = max(n for n, content in enumerate(lines, 1) if content.strip())
        column = len(lines[line - 1]) + 1
    what = _KEYS.sub(lambda keys: f"'{_dotted(keys[0])}'", _PLACE.sub("", message))
    begin = max(0, column - 1 - SHOWN // 2) if len(lines[line - 1]) > SHOWN else 0
    source = "".join(char if char.isprintable() else " " for char in lines[line - 1][begin : begin + SHOWN])
    return (
        f"line {line}, column {column}: broken TOML: {what[:1].lower()}{what[1:]}",
        f"    {source}",
        f"    {' ' * (column - 1 - begin)}^",
    )


def _dotted(keys: str) -> str:
    return ".".join(map(str, ast.literal_eval(keys)))
