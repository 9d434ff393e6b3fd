"""TOML: parsing, the line number of each key, messages for syntax errors, and writing of settings and values.

Error messages need the line numbers of keys, which tomllib does not return. `key_lines` finds them in a text that
tomllib has accepted.
"""

from __future__ import annotations

import ast
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any

from scenes.language.errors import SceneError

KeyPath = tuple[str | int, ...]
"""Path of a key, which includes the index in an array of tables. Example: ("obstacle", 1, "radius_m")."""

_DOT = re.compile(r"""\.(?=(?:[^"']*(?:"[^"]*"|'[^']*'))*[^"']*$)""")
"""Pattern of a dot that is not within quotation marks."""
_TOKEN = re.compile(
    r'"""(?:\\.|(?!""")[^\\])*"{3,5}'
    r"|'''(?:(?!''').)*'{3,5}"
    r'|"(?:\\.|[^"\\])*"'
    r"|'[^']*'"
    r"|\#[^\n]*"
    r"|[\[\]{}\n]"
    r"""|[^"'\#\[\]{}\n]+""",
    re.DOTALL,
)

_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

_KEY_TUPLE = re.compile(r"""\((?:'[^']*'|"[^"]*")(?:, (?:'[^']*'|"[^"]*"))*,?\)""")
"""Pattern of a path of keys in the messages of tomllib, which is a tuple in Python notation."""


MAX_NESTING = 20
"""Largest allowed nesting depth of sections, tables and lists. No scene needs more than 5."""


def parse(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    SceneError
        If the TOML is invalid, or nested deeper than `MAX_NESTING`. For invalid TOML, the error shows the source line
        and a caret under the column.
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
    """Raise SceneError if data are nested deeper than `MAX_NESTING`, since other functions process them recursively."""
    level = [data]
    for _ in range(MAX_NESTING):
        level = [item for outer in level for item in _items(outer)]
    if level:
        raise SceneError(f"sections and lists are nested too deeply: got more than {MAX_NESTING} within each other")


def _items(outer: Any) -> Iterator[Any]:
    inner = outer.values() if isinstance(outer, dict) else outer if isinstance(outer, list) else ()
    return (item for item in inner if isinstance(item, dict | list))


def _picture(text: str, message: str, most: int = 160) -> tuple[str, str, str]:
    """Return the three lines of an error message for an error of tomllib.

    They are the error in words, at most `most` characters of the source line, and a caret under the column.
    """
    lines = text.replace("\r\n", "\n").split("\n")
    place = _PLACE.search(message)
    if place and place[1]:
        line, column = int(place[1]), int(place[2])
    else:
        line = max(n for n, content in enumerate(lines, 1) if content.strip())
        column = len(lines[line - 1]) + 1
    what = _KEY_TUPLE.sub(lambda keys: f"'{_dotted(keys[0])}'", _PLACE.sub("", message))
    begin = max(0, column - 1 - most // 2) if len(lines[line - 1]) > most else 0
    source = "".join(char if char.isprintable() else " " for char in lines[line - 1][begin : begin + most])
    return (
        f"line {line}, column {column}: broken TOML: {what[:1].lower()}{what[1:]}",
        f"    {source}",
        f"    {' ' * (column - 1 - begin)}^",
    )


def _dotted(keys: str) -> str:
    return ".".join(map(str, ast.literal_eval(keys)))


def key_lines(text: str) -> dict[KeyPath, int]:
    """Return the line number, counted from 1, of every table, every key and every element of an array of tables."""
    lines: dict[KeyPath, int] = {}
    last: dict[KeyPath, int] = {}
    """Index of the last element of each array of tables so far."""
    table: KeyPath = ()
    for line, statement in _statements(text):
        keys = _keys_of(tomllib.loads(statement))
        if statement.startswith("[["):
            array = _resolved(keys[:-1], last) + keys[-1:]
            last[array] = last.get(array, -1) + 1
            path = table = (*array, last[array])
        elif statement.startswith("["):
            path = table = _resolved(keys, last)
        else:
            path = table + keys
        for n in range(1, len(path) + 1):
            lines.setdefault(path[:n], line)
        if path == table:
            lines[table] = line
    return lines


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line number and the text of each header and each `key = value`, without comments."""
    line, first, depth = 1, 1, 0
    tokens: list[str] = []
    for token in _TOKEN.findall(f"{text}\n"):
        if token == "\n" and depth == 0:
            if statement := "".join(tokens).strip():
                yield first, statement
            tokens = []
        elif not token.startswith("#"):
            first = first if tokens else line
            depth += (token in ("[", "{")) - (token in ("]", "}"))
            tokens.append(token)
        line += token.count("\n")


def _keys_of(data: Any) -> KeyPath:
    """Return the path of the first key in nested data; a statement has only one key."""
    if not isinstance(data, dict) or not data:
        return ()
    key, inner = next(iter(data.items()))
    return (key, *_keys_of(inner))


def _resolved(keys: KeyPath, last: Mapping[KeyPath, int]) -> KeyPath:
    """Return a path with the index of the last element inserted after each array of tables."""
    path: KeyPath = ()
    for key in keys:
        path = (*path, key)
        path = (*path, last[path]) if path in last else path
    return path


def line_of(lines: Mapping[KeyPath, int], path: KeyPath) -> int:
    """Return the line number of `path`, or of the innermost table around it that has one, or 1."""
    return next((lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in lines), 1)


def path_of(dotted: str) -> tuple[str, ...]:
    """Return the path of a key in a user's notation, such as `gait.period_s` or `fault."my.robot:Slip".begin_s`."""
    return tuple(part.strip().strip("\"'") for part in _DOT.split(dotted))


def key(name: str) -> str:
    """Return a name as a key in TOML. It is quoted, unless it has only letters, digits, _ and -."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else value(name)


def value(item: Any) -> str:
    """Return a value in TOML."""
    match item:
        case bool():
            return "true" if item else "false"
        case int() | float():
            return repr(item)
        case list() | tuple():
            return f"[{', '.join(value(inner) for inner in item)}]"
        case dict():
            return f"{{{', '.join(f'{key(name)} = {value(inner)}' for name, inner in item.items())}}}"
        case _:
            # TOML has the same escapes as JSON, but requires one for the control character U+007F.
            return json.dumps(str(item), ensure_ascii=False).replace("\x7f", "\\u007F")


def shown(item: Any) -> str:
    """Return a value as text for an error message. It is shortened, and strings are in single quotes."""
    text = repr(item) if isinstance(item, str) else value(item)
    return text if len(text) <= 60 else f"{text[:57]}..."


def document(settings: Any) -> str:
    """Return all settings as TOML text, including defaults. Keys whose value is None are left out."""
    return "\n".join(_lines(settings, "")).strip() + "\n"


def _lines(section: Any, prefix: str) -> Iterator[str]:
    inner = {name: item for name, item in section if is_dataclass(item)}
    arrays = {name: item for name, item in section if _is_array_of_tables(item)}
    plain = {name: item for name, item in section if name not in {*inner, *arrays} and item is not None}
    yield from (f"{key(name)} = {value(item)}" for name, item in plain.items())
    for name, items in arrays.items():
        for item in items:
            yield from ("", f"[[{prefix}{key(name)}]]")
            yield from _lines(item, f"{prefix}{key(name)}.")
    for name, item in inner.items():
        yield from ("", f"[{prefix}{key(name)}]")
        yield from _lines(item, f"{prefix}{key(name)}.")


def _is_array_of_tables(item: Any) -> bool:
    return isinstance(item, tuple) and bool(item) and is_dataclass(item[0])
