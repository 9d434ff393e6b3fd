"""What a person wants to know when a run has ended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenes.commands.progress import counted
from scenes.models.base import Model
from scenes.records.folder import VIEWER
from scenes.records.record import Record
from scenes.records.summary import Cell

HEADLINES = (
    ("distance_m", "distance", "m"),
    ("mean_speed_m_s", "mean speed", "m/s"),
    ("work_contract_J", "work of contraction", "J"),
    ("work_friction_J", "work of friction", "J"),
    ("cost_of_transport", "cost of transport", ""),
    ("energy_balance_error", "energy balance error", ""),
)

USES = ("friction", "damping", "impact", "numerical", "gained")
"""What the work goes into, in the names of the summary: `work_friction_J` and so on."""

DOUBTS = {
    "unconverged_steps": "Newton's iteration left {} above its tolerance: try a smaller run.dt_s",
    "inverted_steps": "a segment is inside out after {}: these are shapes that no worm has",
}
"""Counts in the summary that must be 0, and what to say if one is not."""


def ending(record: Record, model: Model[Any], folder: Path) -> str:
    """Return the lines that end a run: the figures that matter, and where the files are."""
    lines = model.table(record) if model.table else _figures(record, model)
    page = folder / VIEWER
    seen = (f"{'to look at':22}{page}",) if model.view is not None and page.is_file() else ()
    titled = () if record.title == record.name else (f"{'title':22}{record.title}",)
    return "\n".join(
        (
            f"{record.name}: {_sentence(record)}",
            *(f"  {line}" for line in (*lines, *titled, f"{'files':22}{folder}", *seen)),
        )
    )


def failure(record: Record, model: Model[Any]) -> str:
    """Return the one line about a run that failed, at least in part: what, when, where, and what to try."""
    return f"{record.status}: {record.sentence}; {model.advice}"


def failed(record: Record) -> bool:
    """Return whether a run failed, at least in part."""
    return record.status in ("diverged", "incomplete")


def warnings(record: Record) -> list[str]:
    """Return what makes the figures of a run doubtful though it reached its end, its faults included."""
    found = ((record.summary.figures.get(name), text) for name, text in DOUBTS.items())
    doubts = [text.format(counted(number, "step")) for number, text in found if isinstance(number, int) and number]
    return [*doubts, *map(_fault, faults(record))]


def faults(record: Record) -> list[dict[str, Cell]]:
    """Return the faults of a run, each with `time_s`, `kind`, `what` and `advice`, as they came."""
    found = record.summary.figures.get("faults")
    return found if isinstance(found, list) else []


def _fault(row: dict[str, Cell]) -> str:
    when = f" (from {row['time_s']:.1f} s on)" if isinstance(row["time_s"], float) else ""
    return f"{row['what']}{when}: {row['advice']}"


def _figures(record: Record, model: Model[Any]) -> list[str]:
    lines = [f"{label:22}{_figure(record, key, unit)}" for key, label, unit in (*HEADLINES, *model.headlines)]
    return [*lines, *_uses(record)]


def _uses(record: Record) -> list[str]:
    """Return a line that says which parts of the work, and so of the cost of transport, went where; none without."""
    parts = {name: record.summary.figures.get(f"work_{name}_J") for name in USES}
    joules = {name: float(part) for name, part in parts.items() if isinstance(part, float | int)}
    work = sum(joules.values())
    if len(joules) < len(USES) or work <= 0.0:
        return []
    return [f"{'of the work':22}" + ", ".join(f"{name} {part / work:.2%}" for name, part in joules.items())]


def timing(record: Record) -> dict[str, float]:
    """Return the wall-clock figures that are single numbers."""
    return {v.name: float(v.values) for v in record.timing if not v.dims}


def _sentence(record: Record) -> str:
    how = record.status if failed(record) else record.sentence
    how += f", with {counted(len(faults(record)), 'fault')}" if faults(record) else ""
    return f"{how} ({record.summary['duration_s']:g} s simulated, {_speed(record)})"


def _speed(record: Record) -> str:
    return f"{timing(record)['real_time_factor']:.3g} times real time"


def _figure(record: Record, key: str, unit: str) -> str:
    figure = record.summary[key]
    return (
        f"{figure:.6g} {unit}".rstrip() if isinstance(figure, float | int) else f"none: {record.summary.reasons[key]}"
    )
