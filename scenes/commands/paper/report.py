"""The paper's study as text: Markdown for a file, lines for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

from scenes.commands.paper.claims import Claim
from scenes.commands.paper.corrected import CorrectedRow, Overstatement
from scenes.commands.paper.differences import Difference
from scenes.commands.paper.tables import PERIODS, SEGMENTS, Row

HEADER = ("n", "T_wave [s]", "distance [m]", "work [J]", "total CoT [J/m]", "true displacement [m]")

COMPARED = ("n", "distance [m]", "work [J]", "total CoT [J/m]", "true displacement [m]")

CORRECTED = ("n", "T_wave [s]", "ground", "friction", "distance [m]", "work [J]", "friction loss [J]", "CoT", "BL/wave")


@dataclass(frozen=True)
class Study:
    """All that the report tells.

    Attributes
    ----------
    rows, claims, differences : sequences
        Of the published program.
    corrected, corrected_claims, overstatements : sequences
        Of the corrected worm.
    """

    rows: Sequence[Row]
    claims: Sequence[Claim]
    differences: Sequence[Difference]
    corrected: Sequence[CorrectedRow]
    corrected_claims: Sequence[Claim]
    overstatements: Sequence[Overstatement]

    def as_dict(self) -> dict[str, list[dict[str, Any]]]:
        """Return the study as `paper.json` holds it."""
        return {field.name: [each.as_dict() for each in getattr(self, field.name)] for field in fields(self)}


PRINTED = {
    3: (0.176235, 1.062124, 6.0267, 0.332435),
    4: (0.529555, 2.017679, 3.8101, 0.852656),
    5: (0.556600, 1.876227, 3.3709, 1.078139),
    6: (0.739210, 4.547915, 6.1524, 1.250650),
    7: (0.534746, 2.023594, 3.7842, 1.021245),
}
"""What the author's program prints for T_wave = 2 s, by segments: distance, work, total CoT, true displacement."""


def markdown(study: Study, pictures: Sequence[str] = ()) -> str:
    """Return the whole report; `pictures` are the files beside it, which it shows."""
    parts = (*_published_lines(study), *_corrected_lines(study), *_picture_lines(pictures))
    return "\n".join(parts) + "\n"


def _picture_lines(pictures: Sequence[str]) -> Iterator[str]:
    if pictures:
        yield from ("", "## Figures")
    for name in pictures:
        yield from ("", f"![{name.rpartition('.')[0].replace('_', ' ')}]({name})")


def _printed_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the program's printed values beside ours, with the difference."""
    yield from ("", "## What the program prints at T_wave = 2 s, ours, and ours less the printed", "")
    yield from _markdown_table(COMPARED, [tuple(_compared_cells(row)) for row in rows if row.n in PRINTED])
    yield from ("", "The program prints six decimals, the total CoT to four.")


def _compared_cells(row: Row) -> Iterator[str]:
    ours = (row.reported_distance_m, row.work_J, row.total_cot_J_per_m, row.true_displacement_m)
    yield f"{row.n}"
    for digits, printed, own in zip((6, 6, 4, 6), PRINTED[row.n], ours, strict=True):
        yield f"{printed:.{digits}f} / {own:.{digits}f} ({own - printed:+.1e})"


def _published_lines(study: Study) -> Iterator[str]:
    yield "# The paper's results, from our own runs"
    yield ""
    yield "Distance, work and cost of transport are counted as the author's program counts them; the true displacement"
    yield "is the mean displacement of the main nodes. The program inverts the sign of the elastic force: these numbers"
    yield "are a regression target, not physics."
    for title, part in _tables(study.rows):
        yield from ("", f"## {title}", "", *_markdown_table(HEADER, map(_cells, part)))
    yield from _printed_lines([r for r in study.rows if r.T_wave_s == 2.0])
    yield from ("", "## The paper's claims", "", *_judged(study.claims))
    yield from ("", "## Where text and program differ", "")
    for d in study.differences:
        yield f"* **{d.what}**. Text: {d.text}. Program: {d.program}. Effect: {d.effect}."


def _corrected_lines(study: Study) -> Iterator[str]:
    yield from ("", "## The corrected worm", "")
    yield "The same cases with the physics right: rigid rhombi, Table I's mass, torsion and hinges, the contraction as"
    yield "a commanded rest length, friction 0.03 and 0.20. CoT is the net work of the actuators over weight and"
    yield "distance; none: the worm made no way forward. In contact the friction is set-valued with anchors, or for"
    yield "comparison the paper's threshold (P10); clamped, the joints' heights are held, with (P9) and (P10)."
    yield from ("", *_markdown_table(CORRECTED, map(_corrected_cells, study.corrected)), "")
    yield "What the distance of six segments is overstated by, against set-valued friction in contact:"
    yield ""
    header = ("T_wave [s]", "set-valued [m]", "threshold", "clamped")
    yield from _markdown_table(header, map(_overstated_cells, study.overstatements))
    yield from ("", "## The paper's claims, by the corrected worm in contact", "", *_judged(study.corrected_claims))


def _judged(claims: Sequence[Claim]) -> Iterator[str]:
    return (f"* **{c.verdict}**: {c.claim} ({c.source}). Evidence: {c.evidence}." for c in claims)


def _markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield "| " + " | ".join(header) + " |"
    yield "|---" * len(header) + "|"
    yield from ("| " + " | ".join(cells) + " |" for cells in rows)


def terminal_lines(study: Study, width: int) -> Iterator[str]:
    """Yield the lines to print: the tables and the verdicts; the evidence stands in the report."""
    for title, part in _tables(study.rows):
        yield from (title, *_aligned(HEADER, map(_cells, part)), "")
    yield from ("The paper's claims", *_wrapped(study.claims, width), "")
    yield f"{len(study.differences)} differences between text and program, each with its effect, are in the report."
    yield from ("", "The corrected worm", *_aligned(CORRECTED, map(_corrected_cells, study.corrected)), "")
    overstated = ", ".join(
        f"{_percent(each.threshold_percent)} at T = {each.T_wave_s:g} s" for each in study.overstatements
    )
    yield from _paragraph(f"Threshold friction overstates the distance of six segments by {overstated}.", width)
    yield from ("", "The paper's claims, by the corrected worm in contact", *_wrapped(study.corrected_claims, width))


def _aligned(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    body = list(rows)
    widths = [max(map(len, column)) for column in zip(header, *body, strict=True)]
    for cells in (header, *body):
        yield "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))


def _wrapped(claims: Sequence[Claim], width: int) -> Iterator[str]:
    for c in claims:
        yield from _paragraph(f"  {c.verdict}: {c.claim}", width)


def _paragraph(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, width, subsequent_indent="    ")


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


def _corrected_cells(row: CorrectedRow) -> tuple[str, ...]:
    return (
        f"{row.n}",
        f"{row.T_wave_s:g}",
        row.ground,
        row.law,
        f"{row.distance_m:.4f}",
        f"{row.work_contract_J:.4f}",
        f"{row.work_friction_J:.4f}",
        _or_none(row.cost_of_transport, ".3f"),
        _or_none(row.speed_BL_per_wave, ".4f"),
    )


def _overstated_cells(each: Overstatement) -> tuple[str, ...]:
    percents = (_percent(each.threshold_percent), _percent(each.clamped_percent))
    return (f"{each.T_wave_s:g}", f"{each.set_valued_distance_m:.4f}", *percents)


def _percent(value: float | None) -> str:
    return _or_none(value, ".0f", " %")


def _or_none(value: float | None, form: str, unit: str = "") -> str:
    return "none" if value is None else f"{value:{form}}{unit}"
