"""The paper's study as text: Markdown for a file, lines for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from scenes.paper.claims import Claim
from scenes.paper.differences import Difference
from scenes.paper.tables import PERIODS, SEGMENTS, Row

HEADER = ("n", "T_wave [s]", "distance [m]", "work [J]", "total CoT [J/m]", "true displacement [m]")


def markdown(rows: Sequence[Row], claims: Sequence[Claim], differences: Sequence[Difference]) -> str:
    """Return the whole report."""
    return "\n".join(_markdown_lines(rows, claims, differences)) + "\n"


def _markdown_lines(rows: Sequence[Row], claims: Sequence[Claim], differences: Sequence[Difference]) -> Iterator[str]:
    yield "# The paper's results, from our own runs"
    yield ""
    yield "Distance, work and cost of transport are counted as the author's program counts them; the true displacement"
    yield "is the mean displacement of the main nodes. The program inverts the sign of the elastic force: these numbers"
    yield "are a regression target, not physics."
    for title, part in _tables(rows):
        yield from ("", f"## {title}", "")
        yield "| " + " | ".join(HEADER) + " |"
        yield "|---" * len(HEADER) + "|"
        yield from ("| " + " | ".join(cells) + " |" for cells in map(_cells, part))
    yield from ("", "## The paper's claims", "")
    for c in claims:
        yield f"* **{c.verdict}**: {c.claim} ({c.source}). Evidence: {c.evidence}."
    yield from ("", "## Where text and program differ", "")
    for d in differences:
        yield f"* **{d.what}**. Text: {d.text}. Program: {d.program}. Effect: {d.effect}."


def terminal_lines(
    rows: Sequence[Row], claims: Sequence[Claim], differences: Sequence[Difference], width: int
) -> Iterator[str]:
    """Yield the lines to print: the tables and the verdicts; the evidence stands in the report."""
    for title, part in _tables(rows):
        yield title
        yield "  ".join(f"{name:>{len(name)}}" for name in HEADER)
        for cells in map(_cells, part):
            yield "  ".join(f"{cell:>{len(name)}}" for cell, name in zip(cells, HEADER, strict=True))
        yield ""
    yield "The paper's claims"
    for c in claims:
        yield from textwrap.wrap(f"{c.verdict}: {c.claim}", width, initial_indent="  ", subsequent_indent="    ")
    yield ""
    yield f"{len(differences)} differences between text and program, each with its effect, are in the report."


def _tables(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    yield "Table II: segments", [r for r in rows if r.T_wave_s == 2.0 and r.n in SEGMENTS]
    by_period = [r for r in rows if r.n == 6 and r.T_wave_s in PERIODS]
    yield "Table III: wave period", sorted(by_period, key=lambda r: r.T_wave_s)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        f"{row.n}",
        f"{row.T_wave_s:g}",
        f"{row.reported_distance_m:.6f}",
        f"{row.work_J:.6f}",
        f"{row.total_cot_J_per_m:.4f}",
        f"{row.true_displacement_m:.6f}",
    )
