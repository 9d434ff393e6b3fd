"""The notation of varied keys, and the design of a sweep from it.

The values of a key are a list `v1,v2,...`, or a range `lo:hi:n` of n values, or for random values the limits `lo:hi`.
With `:log` at the end, a range has equal ratios, and random values are uniform on a logarithmic scale. Cases may also
be listed in a CSV file.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.language.errors import SceneError
from scenes.language.loader import read_text
from scenes.language.schema import Section, key_at
from scenes.language.toml import path_of, shown
from scenes.sweep.design import CASE, SAMPLE, Design, Varied
from worm3d.values.spelling import did_you_mean

MOST_CASES = 100_000
"""Largest number of cases of a sweep. It is limited because each case has a file."""
DIGITS = 12
"""Values of a range are rounded to this number of significant digits, so that rounding errors such as
0.30000000000000004 do not appear."""

_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_RANGE = re.compile(rf"{_NUMBER}:{_NUMBER}(?::\s*(\d+)\s*)?(?::\s*(log|lin)\s*)?")
_ITEM = re.compile(r"""(?:"(?:\\.|[^"\\])*"|'[^']*'|[^,\[\]{}"'])+|[\[\]{},"']""")

_NEARLY = re.compile(rf"{_NUMBER}:{_NUMBER}:\s*([^:,]*?)\s*(?::\s*([^:,]*?)\s*)?")
"""Pattern of a text that is probably meant as a range, but may be invalid. `_RANGE` is the pattern of valid ranges."""

SPACINGS = (("log", "log"), ("lin", "lin"))
LISTED = "write a row of keys, such as gait.period_s,seed, then a row of values for each case"
HOW = "write values v1,v2,... or a range lo:hi:n or lo:hi:n:log"


def design_of(
    scene: str,
    schema: type[Section],
    vary: Mapping[str, Any],
    *,
    random: int | None = None,
    listed: Sequence[Mapping[str, Any]] = (),
    seed: int = 0,
) -> Design:
    """Return the design of a sweep.

    Parameters
    ----------
    scene : str
        Name of the scene.
    schema : type of Section
        Schema of the model, which has the units and the meanings of the keys.
    vary : mapping
        Values of each varied key, by key. They are a text in the notation of the command line, or a sequence.
    random : int, optional
        Number of random cases, for keys whose values are given as `lo:hi` or `lo:hi:log`.
    listed : sequence of mappings
        List of cases. Each case has values by key, and all cases have the same keys.
    seed : int
        Seed of the random values. With the same seed, a sweep with more random cases begins with the same cases.

    Raises
    ------
    SceneError
        If the values of a key are invalid, there is nothing to vary, or there are too many cases.
    """
    if random is not None and not (isinstance(random, int) and 1 <= random <= MOST_CASES):
        raise SceneError(f"--random: got {random}, must be from 1 to {MOST_CASES}")
    if random is not None and listed:
        raise SceneError("--random and --list: both choose the cases; give one of the two")
    grid: list[Varied] = []
    drawn: dict[str, Any] = {}
    for key, given in vary.items():
        limits = _limits(given)
        if limits is None:
            grid.append(_described(schema, key, key, _values(schema, key, given)))
        elif random is None:
            raise SceneError(
                f"vary {key}: got '{given}': a range needs a number of values, {key}={given}:5, or --random N"
            )
        else:
            drawn[key] = _drawn(schema, key, limits, random, seed)
    if random is not None and not drawn:
        raise SceneError("--random: no key to draw; give at least one as --vary key=lo:hi or --vary key=lo:hi:log")
    dim = SAMPLE if grid else CASE
    single = drawn | _columns(listed)
    if twice := [key for key in single if key in {each.key for each in grid}]:
        raise SceneError(f"vary {twice[0]}: varied twice, in --vary and in --list")
    design = Design(scene, (*grid, *(_described(schema, key, dim, values) for key, values in single.items())))
    paths = [path_of(each.key) for each in design.varied]
    if again := [each.key for k, each in enumerate(design.varied) if paths[k] in paths[:k]]:
        raise SceneError(f"vary {again[0]}: varied twice, since a key with quotes is the same as the key without them")
    if not design.varied:
        raise SceneError(f"{scene}: nothing to vary; give --vary key=v1,v2,... or --list FILE, or a section [sweep]")
    return _of_a_size(design)


def texts(given: Iterable[str]) -> dict[str, str]:
    """Return the texts of the values, by key, from the options `--vary key=values`.

    Raises
    ------
    SceneError
        If a key or its values are missing, or a key is given twice.
    """
    found: dict[str, str] = {}
    for text in given:
        key, equals, values = text.partition("=")
        key = key.strip()
        if not (equals and key and values.strip()):
            raise SceneError(f"--vary: got '{text}': must be key=values, such as gait.period_s=2,3,4 ({HOW})")
        if path_of(key) in map(path_of, found):
            raise SceneError(f"--vary {key}: given twice; write all values of the key in one option")
        found[key] = values
    return found


def cases_of(path: Path) -> list[dict[str, Any]]:
    """Return the cases in a CSV file, which has a row of keys and then a row of values for each case.

    Raises
    ------
    SceneError
        If the file cannot be read, has no cases, or has a row with too few or too many values.
    """
    rows = [(n, row) for n, row in enumerate(csv.reader(io.StringIO(read_text(path, LISTED))), start=1) if any(row)]
    keys = [key.strip() for key in rows[0][1]] if rows else []
    if not all(keys) or len(set(keys)) < len(keys):
        raise SceneError(f"{path}: its first row must be keys of the scene, each once; got {', '.join(keys) or 'none'}")
    if len(rows) < 2:
        raise SceneError(f"{path}: no cases; below the row of keys, each row has the values of one case")
    for number, row in rows:
        if len(row) != len(keys) or not all(cell.strip() for cell in row):
            raise SceneError(
                f"{path}: row {number}: got {len([c for c in row if c.strip()])} values, must be {len(keys)}"
            )
    return [dict(zip(keys, map(_value, row), strict=True)) for _, row in rows[1:]]


def _columns(listed: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the values of each key, given a list of cases."""
    keys = list(listed[0]) if listed else []
    for number, row in enumerate(listed, start=1):
        if set(row) != set(keys):
            raise SceneError(
                f"case {number}: got the keys {', '.join(row)}, must be the keys of the first case: {', '.join(keys)}"
            )
    return {key: [_plain(row[key]) for row in listed] for key in keys}


def _of_a_size(design: Design) -> Design:
    number = len(design)
    if number > MOST_CASES:
        sizes = " x ".join(map(str, design.sizes.values()))
        raise SceneError(
            f"{design.scene}: {number} cases ({sizes}): at most {MOST_CASES}; vary fewer values, or divide the sweep"
        )
    return design


def _described(schema: type[Section], key: str, dim: str, values: Sequence[Any]) -> Varied:
    return with_meaning(Varied(key, dim, tuple(values)), schema)


def with_meaning(varied: Varied, schema: type[Section]) -> Varied:
    """Return a varied key with its unit and meaning from the schema. A key that is not in the schema is unchanged."""
    known = key_at(schema, path_of(varied.key))
    return varied if known is None else replace(varied, unit=known.unit_or_one, title=known.meaning)


def is_drawn(given: Any) -> bool:
    """Return whether the values of a key are given as limits for random values, `lo:hi` or `lo:hi:log`."""
    return _limits(given) is not None


def _limits(given: Any) -> tuple[str, str, bool] | None:
    """Return the two limits for random values, and whether the scale is logarithmic.

    Return None if the values are not given as limits.
    """
    match = _RANGE.fullmatch(given) if isinstance(given, str) else None
    return (match[1], match[2], match[4] == "log") if match and not match[3] else None


def _values(schema: type[Section], key: str, given: Any) -> list[Any]:
    """Return the values of a key that is one dimension of a grid."""
    if isinstance(given, range | Sequence) and not isinstance(given, str):
        _require_few(key, len(given))
    values = _plain(given)
    if isinstance(values, str):
        match = _RANGE.fullmatch(values)
        if match is None and (nearly := _NEARLY.fullmatch(values)):
            raise SceneError(f"vary {key}: got '{values}': {_told_of_range(*nearly.groups())}")
        values = _between(schema, key, match) if match else [_value(item) for item in _items(values)]
    values = values if isinstance(values, list) else [values]
    if not values:
        raise SceneError(f"vary {key}: no values; {HOW}")
    _require_few(key, len(values))
    seen = set()
    for value in values:
        known = repr(value) if isinstance(value, list | dict) else value
        if known in seen:
            raise SceneError(f"vary {key}: got {shown(value)} twice; each value is one place of the grid")
        seen.add(known)
    return values


def _told_of_range(low: str, high: str, number: str, spacing: str | None) -> str:
    """Return the text of an error about an invalid range, with the range that was probably meant."""
    if not number.isdecimal() and (spacing is not None or did_you_mean(number, SPACINGS) is None):
        return f"the number of values must be a whole number, {low}:{high}:5"
    last = number if spacing is None else spacing
    meant = did_you_mean(last, SPACINGS) or "log"
    counted = "" if spacing is None else f":{number}"
    return f"a range ends with 'log' or 'lin', not '{last}'; did you mean {low}:{high}{counted}:{meant}?"


def _require_few(key: str, number: int) -> None:
    if number > MOST_CASES:
        raise SceneError(f"vary {key}: {number} values: at most {MOST_CASES} cases in a sweep")


def _plain(given: Any) -> Any:
    """Return Python or NumPy values as values that TOML has."""
    if isinstance(given, np.ndarray | np.generic):
        return given.tolist()
    if isinstance(given, tuple | list | range):
        return [_plain(item) for item in given]
    return given


def _items(text: str) -> list[str]:
    """Return the parts of a text between commas. Commas within brackets or quotes do not separate parts."""
    parts, depth = [""], 0
    for token in _ITEM.findall(text):
        depth += (token in ("[", "{")) - (token in ("]", "}"))
        if token == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += token
    return [part.strip() for part in parts if part.strip()]


def _value(text: str) -> Any:
    """Return the value of a TOML text. If it is not valid TOML, return the text itself."""
    try:
        parsed = tomllib.loads(f"value = {text.strip()}")
    except (ValueError, RecursionError):
        return text.strip()
    return parsed["value"] if len(parsed) == 1 else text.strip()


def _between(schema: type[Section], key: str, match: re.Match[str]) -> list[Any]:
    low, high, number = float(match[1]), float(match[2]), int(match[3])
    if not 2 <= number <= MOST_CASES:
        raise SceneError(f"vary {key}: got '{match[0]}': must be from 2 to {MOST_CASES} values")
    if match[4] == "log":
        _require_positive(key, low, high)
        values = np.geomspace(low, high, number)
    else:
        values = np.linspace(low, high, number)
    return list(dict.fromkeys(_rounded(schema, key, values)))


def _drawn(schema: type[Section], key: str, limits: tuple[str, str, bool], number: int, seed: int) -> list[Any]:
    low, high, log = float(limits[0]), float(limits[1]), limits[2]
    if not low < high:
        raise SceneError(f"vary {key}: got '{limits[0]}:{limits[1]}': the first limit must be below the second")
    generator = np.random.default_rng([seed, *hashlib.sha256(f"sweep {key}".encode()).digest()])
    if _is_whole(schema, key) and not log:
        if math.ceil(low) > math.floor(high):
            raise SceneError(f"vary {key}: got '{limits[0]}:{limits[1]}': no whole number between {low:g} and {high:g}")
        return [int(value) for value in generator.integers(math.ceil(low), math.floor(high), number, endpoint=True)]
    if log:
        _require_positive(key, low, high)
        return _rounded(schema, key, np.exp(generator.uniform(math.log(low), math.log(high), number)))
    return _rounded(schema, key, generator.uniform(low, high, number))


def _require_positive(key: str, low: float, high: float) -> None:
    if min(low, high) <= 0.0:
        raise SceneError(f"vary {key}: got {low:g} and {high:g}: the limits of a range with 'log' must be above 0")


def _rounded(schema: type[Section], key: str, values: Any) -> list[Any]:
    if _is_whole(schema, key):
        return [round(float(value)) for value in values]
    return [float(f"{value:.{DIGITS}g}") for value in values]


def _is_whole(schema: type[Section], key: str) -> bool:
    known = key_at(schema, path_of(key))
    return known is not None and known.is_whole
