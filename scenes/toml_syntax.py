"""TOML parsed, or the place of the syntax error with the source line and a caret."""

from __future__ import annotations

import ast
import re
import tomllib
from typing import Any

from scenes.errors import SceneError

_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

_KEYS = re.compile(r"""\((?:'[^']*'|"[^"]*")(?:, (?:'[^']*'|"[^"]*"))*,?\)""")
"""A path as the messages show it: a tuple of Python."""


def parse(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    SceneError
        Broken TOML: what and where, the source line, a caret under the column.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(*_picture(text, str(error))) from error
    except RecursionError as error:
        raise SceneError("broken TOML: the brackets are nested too deeply") from error
    except ValueError as error:
        raise SceneError("broken TOML: a number has thousands of digits") from error


def _picture(text: str, message: str) -> tuple[str, str, str]:
    lines = text.replace("\r\n", "\n").split("\n")
    place = _PLACE.search(message)
    if place and place[1]:
        line, column = int(place[1]), int(place[2])
    else:
        line = max(n for n, content in enumerate(lines, 1) if content.strip())
        column = len(lines[line - 1]) + 1
    what = _KEYS.sub(lambda keys: f"'{_dotted(keys[0])}'", _PLACE.sub("", message))
    source = lines[line - 1].replace("\t", " ")
    return (
        f"line {line}, column {column}: broken TOML: {what[:1].lower()}{what[1:]}",
        f"    {source}",
        f"    {' ' * (column - 1)}^",
    )


def _dotted(keys: str) -> str:
    return ".".join(map(str, ast.literal_eval(keys)))
