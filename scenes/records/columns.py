"""Names of the columns of measurements: `name[_index...][_axis][_unit]`, such as `joints_0_x_m` or `force_N`.

`worm3d export --csv` uses the same names. A measurement may have other units than the units of an export, and is
converted to SI units. A dimensionless number has no unit, or the unit `1`. An axis is x, y or z, and an index counts
from 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.language.errors import SceneError
from worm3d.recorded.series import Recorded, series_of
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import AXES, Variable

_DEGREE = math.pi / 180.0

COLUMN_UNITS = {
    **{name: ("m", factor) for name, factor in {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}.items()},
    **{name: ("s", factor) for name, factor in {"s": 1.0, "ms": 1e-3, "min": 60.0}.items()},
    **{name: ("rad", factor) for name, factor in {"rad": 1.0, "deg": _DEGREE}.items()},
    **{name: ("N", factor) for name, factor in {"N": 1.0, "mN": 1e-3, "kN": 1e3}.items()},
    **{name: ("J", factor) for name, factor in {"J": 1.0, "mJ": 1e-3}.items()},
    **{name: ("Pa", factor) for name, factor in {"Pa": 1.0, "kPa": 1e3}.items()},
    **{name: ("m/s", factor) for name, factor in {"m_per_s": 1.0, "cm_per_s": 1e-2, "mm_per_s": 1e-3}.items()},
    **{name: ("rad/s", factor) for name, factor in {"rad_per_s": 1.0, "deg_per_s": _DEGREE}.items()},
    **{unit.replace("/", "_per_").replace("^", ""): (unit, 1.0) for unit in ("kg m/s", "kg m^2/s", "J/m", "Hz", "kg")},
    "percent": ("1", 0.01),
}
"""For each unit at the end of the name of a column: the SI unit, and the factor that converts to it."""

MOST_NUMBERS = 20_000_000
"""Largest number of entries in the array of a quantity. Indices without a column count as entries, too."""

PURE = {"strain", "waves"} | {name for name, series in series_of(Recorded).items() if series.unit == "1"}
"""Dimensionless quantities, whose columns do not need a unit."""
INDEXED = {"strain"} | {name for name, series in series_of(Recorded).items() if set(series.dims) - {"time", "axis"}}
"""Quantities with an index. In their names, a final 1 is an index and not the unit: `strain_1` is the strain of segment
1."""

MARKER = "marker_"
"""Prefix of the name of a marker's position."""


@dataclass(frozen=True)
class Column:
    """What a column contains."""

    title: str
    """Name of the column in the file."""
    name: str
    """Name of the quantity."""
    index: tuple[int, ...]
    axis: int | None
    """Axis of the component, 0, 1 or 2 for x, y or z; None for a column without an axis."""
    unit: str
    """SI unit of the quantity."""
    factor: float
    """Factor that converts the numbers of the column to the SI unit."""


def parsed(title: str) -> Column:
    """Return the content of a column with the given name; raise SceneError if the name is invalid."""
    suffix = max((each for each in COLUMN_UNITS if title.endswith(f"_{each}")), key=len, default="")
    unit, factor = COLUMN_UNITS[suffix] if suffix else ("1", 1.0)
    tokens = title.removesuffix(f"_{suffix}").split("_")
    axis = AXES.index(tokens.pop()) if len(tokens) > 1 and tokens[-1] in set(AXES) else None
    index: tuple[int, ...] = ()
    while len(tokens) > 1 and tokens[-1].isascii() and tokens[-1].isdigit() and not title.startswith(MARKER):
        index = (int(tokens.pop()), *index)
    name = "_".join(tokens)
    if not all(tokens):
        raise SceneError(f"column '{title}': the name of a quantity is missing, such as com in com_x_m")
    if title.startswith(MARKER) and (axis is None or unit != "m"):
        raise SceneError(f"column '{title}': must be a position, such as marker_head_x_m")
    if not suffix and not index and axis is None and name not in PURE:
        raise SceneError(
            f"column '{title}': unknown unit '{tokens[-1]}', must end in one of {', '.join(COLUMN_UNITS)}, "
            "or 1 for a pure number"
        )
    if name not in INDEXED and index == (1,) and not suffix:
        index = ()
    return Column(title, name, index, axis, unit, factor)


def variables_of(titles: Sequence[str], table: FloatArray) -> tuple[Variable, ...]:
    """Return the quantities of a table as variables in SI units, including `time`.

    The table has T rows and K columns, shape (T, K). Entries of a variable that have no column are NaN. For example, if
    a column has the z of one quantity, all quantities with an axis get a z.

    Raises
    ------
    SceneError
        If the name of a column is invalid, occurs twice, or does not fit the other columns of the quantity.
    """
    columns = [parsed(title.strip()) for title in titles]
    axes = 3 if any(column.axis == 2 for column in columns) else 2
    groups: dict[str, dict[int, Column]] = {}
    for number, column in enumerate(columns):
        groups.setdefault(column.name, {})[number] = column
    return tuple(_variable(name, group, table, axes) for name, group in groups.items())


def _variable(name: str, group: Mapping[int, Column], table: FloatArray, axes: int) -> Variable:
    """Return a quantity as a variable; `group` are its columns by their number in the table."""
    first = next(iter(group.values()))
    seen: dict[tuple[int, ...], Column] = {}
    for column in group.values():
        if (len(column.index), column.axis is None, column.unit) != (len(first.index), first.axis is None, first.unit):
            raise SceneError(
                f"column '{column.title}': must have as many indices as '{first.title}', an axis only if "
                f"'{first.title}' has an axis, and the same kind of unit"
            )
        place: tuple[int, ...] = (*column.index, *(() if column.axis is None else (column.axis,)))
        if other := seen.get(place):
            raise SceneError(f"column '{column.title}': has the same quantity as '{other.title}', must occur once")
        seen[place] = column
    sizes = [max(place) + 1 for place in zip(*(column.index for column in group.values()), strict=True)]
    shape = (len(table), *sizes, *(() if first.axis is None else (axes,)))
    if math.prod(shape) > MOST_NUMBERS:
        raise SceneError(f"column '{max(group.values(), key=lambda c: c.index).title}': its index is too large")
    values = np.full(shape, np.nan)
    for (number, column), place in zip(group.items(), seen, strict=True):
        np.moveaxis(values, 0, -1)[place] = column.factor * table[:, number]
    dims = ("time", *(f"{name}_{k}" for k in range(len(sizes))), *(() if first.axis is None else ("axis",)))
    return Variable(name, dims, values, first.unit, f"{name.replace('_', ' ')}, measured")
