"""Names, units and printed form of metrics. `worm3d.measures` has the list of metrics, and NOTATION.md the formulas."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, floor, inf, log10

METRIC_UNITS = {
    **{f"_{unit}": unit for unit in ("m", "s", "ms", "deg", "J", "N", "Pa", "kg")},
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


METRIC_GROUPS = {
    "motion": (),
    "contact": ("slip", "backslide", "anchoring", "peak_wall_load", "largest_penetration", "settling"),
    "work": ("work_", "cost_of_transport", "effort", "commands_at_limit", "peak_pressure", "peak_cable"),
    "quality": (
        *("energy_balance", "newton", "distance_error", "heading_error", "work_error", "halved", "real_time"),
        "law_spread",
    ),
}
"""Groups of metrics, each with the beginnings of the names of its metrics. Other metrics belong to "motion"."""

MAIN_METRICS = (
    *("status", "duration_s", "distance_m", "mean_speed_m_s", "heading_change_deg", "slip_per_metre"),
    *("anchoring_duty", "work_contract_J", "cost_of_transport", "energy_balance_error"),
)
"""Metrics that a summary prints by default."""


def group_of(metric: str) -> str:
    """Return the group of a metric. The longest matching beginning decides."""
    found = {begin: group for group, begins in METRIC_GROUPS.items() for begin in begins if metric.startswith(begin)}
    return found[max(found, key=len)] if found else "motion"


class Summary(dict[str, float | str | None]):
    """Metrics by name. `print(summary)` shows the ten main metrics, and `print(summary.table())` shows all metrics."""

    def __repr__(self) -> str:
        names = [name for name in MAIN_METRICS if name in self]
        hidden = len(self) - len(names)
        more = [f"{hidden} more: print(result.summary().table())"] if hidden else []
        return "\n".join([self.table(names), *more])

    def table(self, names: Iterable[str] | None = None) -> str:
        """Return a table of metrics with units, in the groups motion, contact, work and quality.

        Parameters
        ----------
        names : iterable of str, optional
            Names of the metrics. The default is all metrics.
        """
        shown = list(self if names is None else names)
        lines = []
        for group in METRIC_GROUPS:
            rows = [self.row(name) for name in shown if group_of(name) == group]
            if rows:
                lines += [group, *(f"  {name:<32}{value:>12} {unit}".rstrip() for name, value, unit in rows)]
        return "\n".join(lines)

    def row(self, name: str, digits: int = 6) -> tuple[str, str, str]:
        """Return the name in words, the value as text, and the unit of a metric."""
        value, (words, unit) = self[name], named(name)
        shown = "-" if value is None else value if isinstance(value, str) else written(value, unit, digits)
        return words, shown, unit
