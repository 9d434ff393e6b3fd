"""TOML: parsing, the line of each key, pictures of syntax errors, and writing of settings and values.

An error line needs a position, but tomllib keeps none: `key_lines` scans texts that tomllib has accepted.
"""

from __future__ import annotations

import ast
import json
import re
import tomllib
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any

from scenes.language.errors import SceneError

KeyPath = tuple[str | int, ...]
"""Path to a key, including the index in an array of tables: ("obstacle", 1, "radius_m")."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_KEY = r"""(?:[A-Za-z0-9_-]+|"(?:\\.|[^"\\])*"|'[^']*')"""
_PART = re.compile(_KEY)
_DOTTED = re.compile(rf"[ \t]*{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*[ \t]*")
_DOT = re.compile(r"""\.(?=(?:[^"']*(?:"[^"]*"|'[^']*'))*[^"']*$)""")
"""A dot outside of quotes."""
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
"""A path in the messages of tomllib: a tuple in Python notation."""


MAX_NESTING = 20
"""Largest nesting depth of sections, tables and lists; no scene needs more than 5."""


def parse(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    SceneError
        The TOML is invalid, or nested deeper than `MAX_NESTING`. The error shows the source line and a caret under
        the column.
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
    """Raise SceneError if data are nested deeper than `MAX_NESTING`, as functions walk through data by recursion."""
    level = [data]
    for _ in range(MAX_NESTING):
        level = [item for outer in level for item in _items(outer)]
    if level:
        raise SceneError(f"sections and lists are nested too deeply: got more than {MAX_NESTING} within each other")


def _items(outer: Any) -> Iterator[Any]:
    inner = outer.values() if isinstance(outer, dict) else outer if isinstance(outer, list) else ()
    return (item for item in inner if isinstance(item, dict | list))


def _picture(text: str, message: str, most: int = 160) -> tuple[str, str, str]:
    """Return an error of tomllib in words, `most` characters of the source line, and a caret under the column."""
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
    """Return the line, counted from 1, of every table, key and element of an array of tables."""
    return _Scanner(text).lines


def line_of(lines: Mapping[KeyPath, int], path: KeyPath) -> int:
    """Return the line of `path`, or of the nearest enclosing table with a line; 1 if there is none."""
    return next((lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in lines), 1)


class _Scanner:
    """Scanner of headers and `key = value` statements; values are skipped."""

    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self._text = text
        self._begins = [0, *(match.end() for match in re.finditer("\n", text))]
        self._table: KeyPath = ()
        self._last_element: dict[KeyPath, int] = {}
        position = self._after(_BLANK, 0)
        while position < len(text):
            statement = self._header if text[position] == "[" else self._assignment
            position = self._after(_BLANK, statement(position))

    def _after(self, pattern: re.Pattern[str], position: int) -> int:
        match = pattern.match(self._text, position)
        return match.end() if match else position

    def _header(self, start: int) -> int:
        brackets = 2 if self._text.startswith("[[", start) else 1
        end = self._after(_DOTTED, start + brackets)
        keys = _keys_of(self._text[start + brackets : end])
        self._table = self._element(keys) if brackets == 2 else self._resolved(keys)
        self._note(self._table, start)
        self.lines[self._table] = self._line(start)
        return end + brackets

    def _assignment(self, start: int) -> int:
        end = self._after(_DOTTED, start)
        self._note(self._table + _keys_of(self._text[start:end]), start)
        return self._after_value(end + 1)

    def _after_value(self, position: int) -> int:
        depth = 0
        while match := _TOKEN.match(self._text, position):
            token, position = match[0], match.end()
            depth += (token in ("[", "{")) - (token in ("]", "}"))
            if token == "\n" and depth == 0:
                break
        return position

    def _element(self, keys: KeyPath) -> KeyPath:
        array = (*self._resolved(keys[:-1]), keys[-1])
        self._last_element[array] = self._last_element.get(array, -1) + 1
        return (*array, self._last_element[array])

    def _resolved(self, keys: KeyPath) -> KeyPath:
        """Insert the index of the last element after each array of tables in a header."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if path in self._last_element:
                path = (*path, self._last_element[path])
        return path

    def _note(self, path: KeyPath, position: int) -> None:
        for n in range(1, len(path) + 1):
            self.lines.setdefault(path[:n], self._line(position))

    def _line(self, position: int) -> int:
        return bisect_right(self._begins, position)


def _keys_of(dotted: str) -> KeyPath:
    return tuple(_unquoted(match[0]) for match in _PART.finditer(dotted))


def _unquoted(part: str) -> str:
    return str(tomllib.loads(f"key = {part}")["key"]) if part[0] in "\"'" else part


def path_of(dotted: str) -> tuple[str, ...]:
    """Return the path of a key in the user's notation, `gait.period_s` or `fault."my.robot:Slip".begin_s`."""
    return tuple(part.strip().strip("\"'") for part in _DOT.split(dotted))


def key(name: str) -> str:
    """Return a name in TOML: quoted, unless the name consists of letters, digits, _ and - only."""
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
            # TOML accepts the escapes of JSON, and needs an escape for one control character that JSON does not escape.
            return json.dumps(str(item), ensure_ascii=False).replace("\x7f", "\\u007F")


def shown(item: Any) -> str:
    """Return a value for an error line: shortened, with strings in single quotes."""
    text = repr(item) if isinstance(item, str) else value(item)
    return text if len(text) <= 60 else f"{text[:57]}..."


def document(settings: Any) -> str:
    """Return all settings as TOML text, with every default; keys without a value (None) are left out."""
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
