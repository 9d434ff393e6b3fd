"""Names, units and print of metrics; `worm3d.measures` has their table, NOTATION.md their formulas."""

from __future__ import annotations

from math import ceil, floor, inf, log10

UNITS = {
    **{f"_{unit}": unit for unit in ("m", "s", "ms", "deg", "J", "N", "kg")},
    "_m_s": "m/s",
    "_J_per_m": "J/m",
    "_BL_per_period": "BL/period",
    "_bl": "BL",
    "_bl_s": "BL/s",
    "_per_metre": "m/m",
}
"""Unit of a metric by the ending of its name, of which the longest counts; BL is a body length."""


ROUNDING = {"deg": 1e-9, "rad": 1e-11, "m": 1e-12, "m/s": 1e-12, "m/m": 1e-12}
"""Magnitude below which a metric is rounding and written as 0, by its unit."""


TWO_DIGITS = 2.95
"""First digits of an error below which two digits are written: one digit alone would make it twice as large."""
MOST_DECIMALS = 9
"""Largest number of decimals of a metric that is written with its error."""


def written(value: float, unit: str, digits: int = 6) -> str:
    """Return a metric as text, without its unit."""
    return f"{0.0 if abs(value) < ROUNDING.get(unit, 0.0) else value:.{digits}g}"


def rounded_up(error: float) -> float:
    """Return an error rounded up to the digits with which it is written: two if the first is a 1 or a 2, else one."""
    if not 0.0 < error < inf:
        return error
    last = _last(error)
    return float(f"{ceil(error / 10.0**last - 1e-9) * 10.0**last:.2g}")


def _last(error: float) -> int:
    """Return the power of ten of the last digit of an error that is written."""
    first = floor(log10(error))
    return first - 1 if error < TWO_DIGITS * 10.0**first else first


def with_error(value: float, error: float, unit: str) -> str:
    """Return a metric and its error as text, both with the digits that the error leaves; no unit.

    An error that is 0, or not known (NaN), is left out.
    """
    if not error > 0.0 or abs(value) < ROUNDING.get(unit, 0.0):
        return written(value, unit, 3)
    off = rounded_up(error)
    last = _last(off)
    if last < -MOST_DECIMALS:
        return f"{value:.6g} ± {off:.2g}"
    return f"{round(value, -last):.{max(0, -last)}f} ± {off:.{max(0, -last)}f}"


def named(metric: str) -> tuple[str, str]:
    """Return the name of a metric in words, and its unit: `mean_speed_m_s` is ("mean speed", "m/s")."""
    ending = max((ending for ending in UNITS if metric.endswith(ending)), key=len, default="")
    return metric.removesuffix(ending).replace("_", " "), UNITS.get(ending, "")


class Summary(dict[str, float | str | None]):
    """Metrics by name; printed as a table with units."""

    def __repr__(self) -> str:
        rows = (self.row(name) for name in self)
        return "\n".join(f"{name:<34}{shown:>12} {unit}".rstrip() for name, shown, unit in rows)

    def row(self, name: str, digits: int = 6) -> tuple[str, str, str]:
        """Return a metric as name, value and unit to print."""
        value, (words, unit) = self[name], named(name)
        shown = "-" if value is None else value if isinstance(value, str) else written(value, unit, digits)
        return words, shown, unit
