"""How much memory a run needs, known before any is taken."""

from __future__ import annotations

MOST_MEMORY = 4e9
"""Largest memory of a run, grid or table [byte]."""

BYTES_PER_STEP = 250.0
"""Memory that a step takes beside the rows of the result [byte]."""


def bytes_of_run(segments: int, steps: float, every: int) -> float:
    """Return the memory that a run takes until it is on disc, half as much again as measured [byte]."""
    return steps * (BYTES_PER_STEP + (1000.0 + 2100.0 * segments) / every)


def require_room(name: str, needed: float, what: str, remedy: str) -> None:
    """Raise ValueError for what would not fit into memory; `needed` in bytes."""
    if not needed <= MOST_MEMORY:
        raise ValueError(
            f"{name}: got {what}, about {needed / 1e9:.3g} GB of memory, must be at most {MOST_MEMORY / 1e9:g} GB; "
            f"use {remedy}"
        )
