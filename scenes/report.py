"""What a person wants to know when a run has ended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenes.kinds.base import Kind
from scenes.record import Record

HEADLINES = (
    ("distance_m", "distance", "m"),
    ("mean_speed_m_s", "mean speed", "m/s"),
    ("work_contract_J", "work of contraction", "J"),
    ("work_friction_J", "work of friction", "J"),
    ("cost_of_transport", "cost of transport", ""),
    ("energy_balance_error", "energy balance error", ""),
)


def ending(record: Record, kind: Kind[Any], folder: Path) -> str:
    """Return the lines that end a run: the figures that matter, and where the files are."""
    rows = [(label, _figure(record, key, unit)) for key, label, unit in (*HEADLINES, *kind.headlines)]
    rows.append(("files", str(folder)))
    width = max(len(label) for label, _ in rows)
    return "\n".join((f"{record.name}: {_sentence(record)}", *(f"  {label:{width}}  {text}" for label, text in rows)))


def divergence(record: Record, kind: Kind[Any]) -> str:
    """Return the one line about a run that diverged: what, when, where, and what to try."""
    return f"diverged: {record.sentence}; {kind.advice}"


def timing(record: Record) -> dict[str, float]:
    """Return the wall-clock figures that are single numbers."""
    return {v.name: float(v.values) for v in record.timing if not v.dims}


def _sentence(record: Record) -> str:
    how = "diverged" if record.status == "diverged" else record.sentence
    return f"{how} ({record['time'][-1]:g} s simulated, {_speed(record)})"


def _speed(record: Record) -> str:
    return f"{timing(record)['real_time_factor']:.3g} times real time"


def _figure(record: Record, key: str, unit: str) -> str:
    figure = record.summary[key]
    return f"none: {record.summary.reasons[key]}" if figure is None else f"{figure:.6g} {unit}".rstrip()
