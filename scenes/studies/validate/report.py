"""The command `worm3d study validate`, which writes `validate.json`, `validate.md` and `validate.png`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from scenes.records.text import Column, json_bytes
from scenes.running.packages import versions
from scenes.running.report import Block, Heading, Items, Picture, Report, Table, report_study
from scenes.studies.validate import animals, closed_forms, pattern_generators, powered, robots
from scenes.studies.validate.figure import draw
from scenes.studies.validate.rows import AGREES, DEPENDS, EVIDENCE_KINDS, STANDINGS, TRUST, Chapter, Row, number

CHAPTERS: Mapping[str, Chapter] = {
    "Closed forms of crawling": closed_forms.rows,
    "Robots": robots.rows,
    "Robots on their actuators": powered.rows,
    "Animals": animals.rows,
    "Pattern generators": pattern_generators.rows,
}
"""Chapters of the report by their titles."""

PREFACE = (
    "A spread is the range of the model's number over values that the source does not give. A row agrees if the whole "
    "spread lies in the band. A row depends if only the number for the scene's own values lies in the band. Values of "
    "the scenes were chosen to meet the published numbers only in fitted rows, which do not count."
)
"""Explanation above the tables of `validate.md`."""

ROW_NAME_WIDTH = 66
"""Width of the column of names in the terminal [characters]."""

ROW_COLUMNS = {
    "": Column("mark"),
    "what": Column("name"),
    "against": Column("kind"),
    "standing": Column("standing"),
    "model": Column("model", ".4g"),
    "published": Column("published", ".4g"),
    "ratio": Column("ratio_text"),
    "band": Column("band_text"),
    "spread": Column("spread_text"),
    "sign": Column("sign_text"),
    "source": Column("source_text"),
}


@dataclass(frozen=True)
class Found:
    """Results: the rows of each chapter."""

    chapters: Mapping[str, Sequence[Row]]
    quick: bool = False
    """Whether the spreads were left out."""

    @property
    def rows(self) -> list[Row]:
        """All rows, in the order of the report."""
        return [row for rows in self.chapters.values() for row in rows]


def run(out: Path | None, *, quick: bool, force: bool, quiet: bool) -> int:
    """Make all comparisons, write the report and return the exit code. The command has the same options.

    The exit code does not depend on whether the model agrees with the published numbers.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """

    def study(folder: Path) -> Report:
        chapters = {title: list(_told(chapter(quick), title, quiet)) for title, chapter in CHAPTERS.items()}
        return report(Found(chapters, quick))

    return report_study("validate", study, out, force=force, quiet=quiet)


def report(found: Found) -> Report:
    """Return the report."""
    return Report(
        said=[Items([*verdict(found), "validate.md says why"])],
        pages={"validate.md": list(_page(found))},
        files={"validate.json": json_bytes(content(found))},
        pictures={"validate.png": draw(found.chapters)},
    )


def content(found: Found) -> dict[str, object]:
    """Return the content of `validate.json`."""
    rows = [{**row.to_dict(), "chapter": title} for title, rows in found.chapters.items() for row in rows]
    meanings = {"trust": TRUST, "kinds": EVIDENCE_KINDS, "standings": STANDINGS}
    return {"rows": rows, "counts": counts(found.rows), "quick": found.quick, **meanings, "versions": versions()}


def counts(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Return, for each kind of evidence, the number of rows that count, of rows that agree, and of rows that depend."""
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
    """Return lines that say how many rows of each kind agree, how many trends agree, and how many rows do not count."""
    rows, lines = found.rows, []
    for kind, n in counts(rows).items():
        depends = f", {n[DEPENDS]} more only for the values assumed in the scene" if n[DEPENDS] else ""
        lines.append(f"{kind}: {n[AGREES]} of {n['rows']} agree{depends}")
    signs = [row.sign_agrees for row in rows if row.counts and row.sign_agrees is not None]
    if signs:
        over = "" if found.quick else ", over their whole spreads"
        lines.append(f"of them trends: {sum(signs)} of {len(signs)} have the right sign{over}")
    if left := sum(not row.counts for row in rows):
        lines.append(f"not counted, fitted or following from an input: {left}")
    if found.quick:
        lines.append("without the spreads over unpublished values, with which some of these rows would not agree")
    return lines


def _page(found: Found) -> Iterator[Block]:
    yield Heading("Validation", 1)
    yield "Numbers of the model compared with published numbers. Rows that agree, by the kind of evidence:"
    yield Items(verdict(found))
    yield PREFACE
    for title, meanings in (("Against", EVIDENCE_KINDS), ("Standing", STANDINGS), ("Sources", TRUST)):
        yield f"{title}: " + "; ".join(f"{tag}: {meaning}" for tag, meaning in meanings.items()) + "."
    yield Picture("validate.png", "Model over published, and bands")
    for title, rows in found.chapters.items():
        yield from (Heading(title), Table.of(ROW_COLUMNS, rows))
        yield Items([f"{row.name} (scene `{row.scene}`): {row.note}" for row in rows if row.note])


def _told(rows: Iterator[Row], title: str, quiet: bool) -> Iterator[Row]:
    """Yield the rows of a chapter, and print each row as soon as its runs are finished."""
    if not quiet:
        typer.echo(f"{title:{ROW_NAME_WIDTH + 10}}{'model':>12}{'published':>12}{'ratio':>10}  band")
    for row in rows:
        if not quiet:
            numbers = f"{number(row.model):>12}{number(row.published):>12}{row.ratio_text:>10}"
            typer.echo(f"  {row.mark:8}{row.name:{ROW_NAME_WIDTH}}{numbers}  {row.band_text}")
        yield row
