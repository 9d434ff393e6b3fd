"""Names, units and printed form of metrics. `worm3d.measures` has the list of metrics, and NOTATION.md the formulas."""

from __future__ import annotations

from math import ceil, floor, inf, log10

METRIC_UNITS = {
    **{f"_{unit}": unit for unit in ("m", "s", "ms", "deg", "J", "N", "kg")},
    "_m_s": "m/s",
    "_J_per_m": "J/m",
    "_BL_per_period": "BL/period",
    "_bl": "BL",
    "_bl_s": "BL/s",
    "_per_metre": "m/m",
}
"""Unit of a metric by the longest matching ending of its name. BL is a body length."""


METRIC_ROUNDING = {"deg": 1e-9, "rad": 1e-11, "m": 1e-12, "m/s": 1e-12, "m/m": 1e-12}
"""A metric below this size, by unit, is regarded as a rounding error and is written as 0."""


def written(value: float, unit: str, digits: int = 6) -> str:
    """Return a metric as text, without the unit."""
    return f"{0.0 if abs(value) < METRIC_ROUNDING.get(unit, 0.0) else value:.{digits}g}"


def rounded_up(error: float) -> float:
    """Return an error rounded up to two digits if it begins with 1 or 2, otherwise to one digit."""
    if not 0.0 < error < inf:
        return error
    last = _last(error)
    return float(f"{ceil(error / 10.0**last - 1e-9) * 10.0**last:.2g}")


def _last(error: float) -> int:
    """Return the power of ten of the last written digit of an error."""
    first = floor(log10(error))
    return first - 1 if error < 2.95 * 10.0**first else first  # rounding up to one digit might double it


def with_error(value: float, error: float, unit: str) -> str:
    """Return a metric and its error as text without a unit. The error sets the number of digits of both.

    An error that is 0 or unknown (NaN) is left out.
    """
    if not error > 0.0 or abs(value) < METRIC_ROUNDING.get(unit, 0.0):
        return written(value, unit, 3)
    off = rounded_up(error)
    last = _last(off)
    if last < -9:
        return f"{value:.6g} ± {off:.2g}"
    return f"{round(value, -last):.{max(0, -last)}f} ± {off:.{max(0, -last)}f}"


def named(metric: str) -> tuple[str, str]:
    """Return the name of a metric in words, and its unit. For `mean_speed_m_s` they are "mean speed" and "m/s"."""
    ending = max((ending for ending in METRIC_UNITS if metric.endswith(ending)), key=len, default="")
    return metric.removesuffix(ending).replace("_", " "), METRIC_UNITS.get(ending, "")


class Summary(dict[str, float | str | None]):
    """Metrics by name. They are printed as a table with units."""

    def __repr__(self) -> str:
        rows = (self.row(name) for name in self)
        return "\n".join(f"{name:<34}{shown:>12} {unit}".rstrip() for name, shown, unit in rows)

    def row(self, name: str, digits: int = 6) -> tuple[str, str, str]:
        """Return the name in words, the value as text, and the unit of a metric."""
        value, (words, unit) = self[name], named(name)
        shown = "-" if value is None else value if isinstance(value, str) else written(value, unit, digits)
        return words, shown, unit
