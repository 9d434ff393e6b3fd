"""Where each key of a TOML text stands: tomllib keeps no positions, and an error line needs one.

Only for texts that tomllib has accepted: the scanner trusts the syntax.
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_right
from collections.abc import Mapping

KeyPath = tuple[str | int, ...]
"""Path to a key, with the index of an element of an array of tables: ("obstacle", 1, "radius_m")."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_KEY = r"""(?:[A-Za-z0-9_-]+|"(?:\\.|[^"\\])*"|'[^']*')"""
_PART = re.compile(_KEY)
_DOTTED = re.compile(rf"[ \t]*{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*[ \t]*")
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


def key_lines(text: str) -> dict[KeyPath, int]:
    """Return the line, counted from 1, of every table, key and element of an array of tables."""
    return _Scanner(text).lines


def line_of(lines: Mapping[KeyPath, int], path: KeyPath) -> int:
    """Return the line of `path`, or of the nearest thing around it that has one; 1 if nothing has."""
    return next((lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in lines), 1)


class _Scanner:
    """Walks over headers and `key = value` statements; values are skipped."""

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
        keys = _split(self._text[start + brackets : end])
        self._table = self._element(keys) if brackets == 2 else self._resolved(keys)
        self._note(self._table, start)
        self.lines[self._table] = self._line(start)
        return end + brackets

    def _assignment(self, start: int) -> int:
        end = self._after(_DOTTED, start)
        self._note(self._table + _split(self._text[start:end]), start)
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
        """Put in the index of the last element wherever a header passes through an array of tables."""
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


def _split(dotted: str) -> KeyPath:
    return tuple(_unquoted(match[0]) for match in _PART.finditer(dotted))


def _unquoted(part: str) -> str:
    return str(tomllib.loads(f"key = {part}")["key"]) if part[0] in "\"'" else part
