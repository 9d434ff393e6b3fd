"""Tables of the states of a segment: reading of NetCDF and CSV files, and their checks.

A row is an equilibrium at a held length. The columns are those of `COLUMNS`. The name of a column in a CSV file ends in
a unit, for example `length_mm`. Further facts, such as the rest length, are attributes of a NetCDF file, or lines such
as `# rest_length_m: 0.06` at the top of a CSV file.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.language.errors import DiscError, SceneError
from scenes.records import csv_file
from scenes.records.columns import COLUMN_UNITS
from worm3d.values import regular_file
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

COLUMNS = {
    "length": "m",
    "bend": "rad",
    "pressure": "Pa",
    "cable": "N",
    "taken_in": "m",
    "force": "N",
    "moment": "N m",
    "radius": "m",
    "volume": "m^3",
    "stable": "1",
}
"""SI unit of each quantity in a table. `taken_in` is the length of a hoop cable that is taken in."""

INPUTS = {"pressure": "Pa", "cable": "N"}
"""Quantities that may be the input of a segment, with their units."""

FACTS = (
    "rest_length_m",
    "plate_radius_m",
    "rest_radius_m",
    "chamber_offset_m",
    "cable_per_diameter",
    "contact_stiffness_N_m",
    "least_input",
)
"""Facts about a segment that are numbers. "contact_stiffness_N_m" is the stiffness of a contact point, see `friction`,
and "least_input" the input below which rows are left out [Pa or N]."""

UNITS = {
    **COLUMN_UNITS,
    "Nm": ("N m", 1.0),
    "mNm": ("N m", 1e-3),
    "m3": ("m^3", 1.0),
    "cm3": ("m^3", 1e-6),
    "ml": ("m^3", 1e-6),
    "bar": ("Pa", 1e5),
    "mbar": ("Pa", 100.0),
}
"""For each unit at the end of a column's name: the SI unit, and the factor that converts to it."""

MOST_BYTES = 200_000_000
"""Largest size of a table [byte]. A table with a million states is half as large."""

MOST_MISSING = 0.2
"""Largest fraction of rows with a missing number. With more of them, a whole region of states may be missing."""

LENGTH_RATIO = 20.0
"""Largest ratio of a length in the table to the rest length, or of the rest length to a length. A larger ratio is a
wrong unit: millimetres as metres give 1000. No soft segment stretches by half of this ratio."""


@dataclass(frozen=True, eq=False)
class Table(ReadOnly):
    """States of a segment, from rows without missing numbers and without crumpled shapes."""

    columns: Mapping[str, FloatArray]
    """Quantities in SI units by name, each of shape (S,); those that the file lacks are left out."""
    facts: Mapping[str, float]
    """Values of `FACTS`; those that are unknown are left out."""
    source: str
    sha256: str
    left_out: Mapping[str, int]
    """Number of rows that were left out, by reason."""
    ordered: bool
    """Whether rows follow one another in time."""

    def __len__(self) -> int:
        return len(self.columns["force"])

    @property
    def input_name(self) -> str:
        """Name of the input; `cable` if there is none."""
        return next((name for name in INPUTS if name in self.columns), "cable")

    @property
    def input(self) -> FloatArray:
        """Input of each state, shape (S,); 0 if there is no input."""
        return self.columns.get(self.input_name, np.zeros(len(self)))

    def fact(self, name: str) -> float:
        """Return a fact that is needed; SceneError if it is unknown."""
        if name not in self.facts:
            raise SceneError(
                f"{name}: the table does not have it, must be a number above 0; give it with -o {name}=VALUE"
            )
        return self.facts[name]


def load(path: Path, renamed: Sequence[str] = (), given: Sequence[str] = ()) -> Table:
    """Read a table.

    Parameters
    ----------
    path : Path
        CSV file (with the ending .csv or .csv.gz), or NetCDF file, version 3 or 4.
    renamed : sequence of str
        Texts NAME=TITLE: the column with the title TITLE in the file has the name NAME, for example
        length_mm=Position.
    given : sequence of str
        Texts NAME=NUMBER with facts of `FACTS`, which replace those in the file.

    Raises
    ------
    SceneError
        The file is not a table, lacks a column or fact, has a wrong unit or a number out of range, or has too few rows.
    DiscError
        The file cannot be read.
    """
    data = _bytes(path)
    try:
        is_csv = ".csv" in path.suffixes
        said, titled = _csv(path) if is_csv else _netcdf(data)
        columns = _in_si(_renamed(titled, renamed))
        columns = {name: values for name, values in columns.items() if name == "force" or np.isfinite(values).any()}
        facts = _facts({**said, **_pairs("-o", given)})
        rows, left_out = _usable(columns, facts.get("least_input", -np.inf))
        kept = {name: values[rows] for name, values in columns.items() if name != "stable"}
        _require_possible(kept, facts)
    except SceneError as error:
        raise SceneError(*(f"{path}: {line}" for line in error.lines)) from None
    source = str(said.get("source", "")) or f"table {path.name}"
    return Table(kept, facts, source, hashlib.sha256(data).hexdigest(), left_out, is_csv)


def _bytes(path: Path) -> bytes:
    try:
        return regular_file.read(path, MOST_BYTES)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file") from None
    except OSError as error:
        raise DiscError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error


def _csv(path: Path) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    header, titles, rows = csv_file.split(path)
    numbers = csv_file.table(titles, rows)
    return dict(header), {title: numbers[:, k] for k, title in enumerate(titles)}


def _netcdf(data: bytes) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Return the attributes and the variables along the dimension `state`."""
    import h5netcdf
    from scipy.io import netcdf_file

    try:
        opened = netcdf_file(io.BytesIO(data), mmap=False) if data[:3] == b"CDF" else h5netcdf.File(io.BytesIO(data))
        with opened as file:
            attributes = dict(getattr(file, "_attributes", None) or getattr(file, "attrs", {}))
            columns = {
                name: np.array(variable[:], dtype=float)
                for name, variable in file.variables.items()
                if tuple(variable.dimensions) == ("state",)
            }
    except Exception as error:  # damaged files make the libraries raise almost any exception
        raise SceneError("neither a NetCDF file nor a table in a .csv file, or damaged: make it again") from error
    return {key: each.decode() if isinstance(each, bytes) else each for key, each in attributes.items()}, columns


def _pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    pairs = [text.partition("=") for text in texts]
    if wrong := [text for text, (name, _, value) in zip(texts, pairs, strict=True) if not name or not value]:
        raise SceneError(f"{option}: got '{wrong[0]}', must be NAME=VALUE")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _renamed(columns: Mapping[str, FloatArray], renamed: Sequence[str]) -> dict[str, FloatArray]:
    named = dict(columns)
    for name, title in _pairs("--column", renamed).items():
        if title not in columns:
            raise SceneError(f"--column: got the title '{title}', must be one of {', '.join(columns)}")
        named.pop(title, None)
        named[name] = columns[title]
    return named


def _in_si(titled: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the quantities of `COLUMNS` in SI units. Columns with other names are ignored."""
    found: dict[str, FloatArray] = {}
    for title, values in titled.items():
        suffix = max((each for each in UNITS if title.endswith(f"_{each}")), key=len, default="")
        name = title.removesuffix(f"_{suffix}")
        unit, factor = UNITS.get(suffix, ("1", 1.0))
        if (name, unit) == ("cable", "m"):
            name = "taken_in"
        if name not in COLUMNS:
            continue
        if unit != COLUMNS[name]:
            fitting = ", ".join(f"{name}_{each}" for each, (si, _) in UNITS.items() if si == COLUMNS[name])
            raise SceneError(
                f"column '{title}': got {'no unit' if unit == '1' else f'a unit of [{unit}]'}, must be one of "
                f"{fitting}; rename it in the file, or with --column"
            )
        if name in found:
            raise SceneError(f"column '{title}': a second column of the {name}, must be one; remove the other")
        found[name] = factor * values
    lacking = [] if {"length", "taken_in"} & found.keys() else ["length_m"]
    lacking += [] if "force" in found else ["force_N"]
    if lacking or not len(found["force"]):
        raise SceneError(
            f"got the columns {', '.join(titled) or 'none'}, must have rows and the columns "
            f"{' and '.join(lacking or ['force_N'])}; rename with --column, for example --column length_mm=Position"
        )
    return found


def _facts(said: Mapping[str, Any]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name in FACTS:
        if name not in said:
            continue
        try:
            found[name] = float(said[name])
        except (TypeError, ValueError):
            found[name] = np.nan
        if not 0.0 < found[name] < np.inf:
            raise SceneError(f"{name}: got {said[name]}, must be a number above 0")
    return found


def _usable(columns: Mapping[str, FloatArray], least_input: float) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Return which rows can be used, and the number of the other rows by reason."""
    stable = columns.get("stable", np.ones(len(columns["force"])))
    crumpled = ~(stable > 0.0)
    numbers = [values for name, values in columns.items() if name not in ("stable", "moment")]
    missing = ~np.isfinite(numbers).all(axis=0) & ~crumpled
    if missing.sum() > MOST_MISSING * len(stable):
        raise SceneError(
            f"{missing.sum()} of {len(stable)} rows lack a number, must be at most {MOST_MISSING:.0%}; fill or remove "
            "the columns with gaps"
        )
    inputs = [columns[name] for name in INPUTS if name in columns]
    small = (inputs[0] < least_input) if inputs else np.zeros(len(stable), dtype=bool)
    left_out = {
        "a missing number": int(missing.sum()),
        "a crumpled shape": int(crumpled.sum()),
        f"an input below {least_input:g}": int((small & ~missing & ~crumpled).sum()),
    }
    return ~missing & ~crumpled & ~small, {reason: count for reason, count in left_out.items() if count}


def _require_possible(columns: Mapping[str, FloatArray], facts: Mapping[str, float]) -> None:
    """Raise SceneError for numbers that no segment has."""
    for name in ("length", "radius", "volume"):
        if name in columns and (columns[name] <= 0.0).any():
            raise SceneError(f"column '{name}': got {columns[name].min():g} {COLUMNS[name]}, must be above 0")
    for name in INPUTS:
        if name in columns and (columns[name] < 0.0).any():
            raise SceneError(
                f"column '{name}': got {columns[name].min():g} {COLUMNS[name]}, must not be below 0; subtract the zero "
                "reading of the sensor"
            )
    if INPUTS.keys() <= columns.keys():
        raise SceneError("got both a pressure and a cable force, must be one input; remove the other column")
    rest = facts.get("rest_length_m")
    for name in ("length", "radius"):
        if rest and name in columns and len(columns[name]):
            least, most = columns[name].min(), columns[name].max()
            if most > LENGTH_RATIO * rest or least < rest / LENGTH_RATIO:
                raise SceneError(
                    f"column '{name}': got {least:g} to {most:g} m with a rest length of {rest:g} m, must be at most "
                    f"{LENGTH_RATIO:g} times longer or shorter; correct the unit of the column or of rest_length_m"
                )
