"""`worm3d study validate`: run all comparisons and write `validate.json`, `validate.md` and `validate.png`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import json_bytes, markdown_table
from scenes.running.drawing import save_figure
from scenes.running.packages import versions
from scenes.studies.validate import animals, closed_forms, pattern_generators, powered, robots
from scenes.studies.validate.figure import draw
from scenes.studies.validate.rows import AGREES, DEPENDS, EVIDENCE_KINDS, STANDINGS, TRUST, Chapter, Row

CHAPTERS: Mapping[str, Chapter] = {
    "Closed forms of crawling": closed_forms.rows,
    "Robots": robots.rows,
    "Robots on their actuators": powered.rows,
    "Animals": animals.rows,
    "Pattern generators": pattern_generators.rows,
}
"""Parts of the report by their titles."""

PREFACE = (
    "A spread is over numbers that the source does not tell. A row agrees if the whole spread lies in the band, and "
    "depends if only the number for the scene's values does. Numbers were chosen to meet rows that are fitted, which "
    "do not count, and no others."
)
"""Information that a reader of the tables needs."""

ROW_NAME_WIDTH = 66
"""Width of the names on a terminal."""

ROW_COLUMNS = ("", "what", "against", "standing", "model", "published", "ratio", "band", "spread", "sign", "source")


@dataclass(frozen=True)
class Found:
    """Rows of each chapter."""

    chapters: Mapping[str, Sequence[Row]]
    quick: bool = False
    """Whether the spreads were left out."""

    @property
    def rows(self) -> list[Row]:
        """All rows, in the order of the report."""
        return [row for rows in self.chapters.values() for row in rows]


def run(out: Path | None, *, quick: bool, force: bool, quiet: bool) -> int:
    """Run all comparisons, write the report and return the exit code; options as in the command.

    A row that the model misses is no failure of the command; the report shows the miss.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """
    with folders.prepared(out, "validate", force=force) as folder:
        found = Found({title: list(_told(chapter(quick), title, quiet)) for title, chapter in CHAPTERS.items()}, quick)
        write_bytes(folder / "validate.json", json_bytes(content(found)))
        write_bytes(folder / "validate.md", markdown(found).encode())
        save_figure(draw(found.chapters), folder / "validate.png")
    if not quiet:
        for line in verdict(found):
            typer.echo(line)
        typer.echo(f"  {folder / 'validate.md'} says why")
    return 0


def content(found: Found) -> dict[str, object]:
    """Return the content of `validate.json`."""
    rows = [{**row.to_dict(), "chapter": title} for title, rows in found.chapters.items() for row in rows]
    meanings = {"trust": TRUST, "kinds": EVIDENCE_KINDS, "standings": STANDINGS}
    return {"rows": rows, "counts": counts(found.rows), "quick": found.quick, **meanings, "versions": versions()}


def counts(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Return by kind the number of rows that count, and how many of them agree or depend on unpublished values."""
    of = {kind: [row for row in rows if row.counts and row.kind == kind] for kind in EVIDENCE_KINDS}
    return {
        kind: {
            "rows": len(some),
            AGREES: sum(row.agreement == AGREES for row in some),
            DEPENDS: sum(row.agreement == DEPENDS for row in some),
        }
        for kind, some in of.items()
        if some
    }


def verdict(found: Found) -> list[str]:
    """Return a line for each kind on how many rows agree, a line on trends, and a line on rows that do not count."""
    rows, lines = found.rows, []
    for kind, n in counts(rows).items():
        depends = f", {n[DEPENDS]} more for the scene's values of what is not published" if n[DEPENDS] else ""
        lines.append(f"{kind}: {n[AGREES]} of {n['rows']} agree{depends}")
    signs = [row.sign_agrees for row in rows if row.counts and row.sign_agrees is not None]
    if signs:
        over = "" if found.quick else ", over their whole spreads"
        lines.append(f"of them trends: {sum(signs)} of {len(signs)} have the right sign{over}")
    if left := sum(not row.counts for row in rows):
        lines.append(f"not counted, fitted or following from an input: {left}")
    if found.quick:
        lines.append("without the spreads over what is not published, over which some of these rows would not agree")
    return lines


def markdown(found: Found) -> str:
    """Return the report as Markdown."""
    return "\n".join(_lines(found)) + "\n"


def _lines(found: Found) -> Iterator[str]:
    yield "# Validation"
    yield ""
    yield "What the model gives beside what was published, counted by what it is compared with:"
    yield ""
    yield from (f"* {line}" for line in verdict(found))
    yield ""
    yield PREFACE
    yield ""
    for title, meanings in (("Against", EVIDENCE_KINDS), ("Standing", STANDINGS), ("Sources", TRUST)):
        yield f"{title}: " + "; ".join(f"{tag}: {meaning}" for tag, meaning in meanings.items()) + "."
        yield ""
    yield "![Model over published, and bands](validate.png)"
    for title, rows in found.chapters.items():
        yield from ("", f"## {title}", "")
        yield from markdown_table(ROW_COLUMNS, map(_cells, rows))
        yield ""
        yield from (f"* {row.name} (scene `{row.scene}`): {row.note}" for row in rows if row.note)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        _mark(row),
        row.name,
        row.kind,
        row.standing,
        _number(row.model),
        _number(row.published),
        _ratio(row),
        _band(row),
        _range(row.spread),
        {None: "", True: "agrees", False: "not all" if row.ok else "does not agree"}[row.sign_agrees],
        f"{row.source} [{row.trust}]",
    )


def _told(rows: Iterator[Row], title: str, quiet: bool) -> Iterator[Row]:
    """Yield rows, and print each row as soon as the row is known."""
    if not quiet:
        typer.echo(f"{title:{ROW_NAME_WIDTH + 10}}{'model':>12}{'published':>12}{'ratio':>10}  band")
    for row in rows:
        if not quiet:
            numbers = f"{_number(row.model):>12}{_number(row.published):>12}{_ratio(row):>10}"
            typer.echo(f"  {_mark(row):8}{row.name:{ROW_NAME_WIDTH}}{numbers}  {_band(row)}")
        yield row


def _mark(row: Row) -> str:
    return row.agreement if row.counts else row.standing


def _number(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else f"{value:.4g}"


def _ratio(row: Row) -> str:
    """Return the ratio; for a row with a relative tolerance, return the deviation of the ratio from 1."""
    if row.ratio is None or isinstance(row.tolerance, tuple):
        return _number(row.ratio)
    return f"1 {'-+'[row.ratio >= 1.0]} {abs(row.ratio - 1.0):.0e}"


def _band(row: Row) -> str:
    if not isinstance(row.tolerance, tuple):
        return f"within {row.tolerance:.2g}"
    low, high = row.band
    unit = "" if row.unit == "1" else f" {row.unit}"
    if math.isinf(high):
        return f"above {low:.4g}{unit}"
    return f"below {high:.4g}{unit}" if math.isinf(low) else f"{_range(row.band)}{unit}"


def _range(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g}"
