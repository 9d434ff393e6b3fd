"""The command `worm3d compare`: table, CSV, figures and page of the differences between results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, fields, replace
from pathlib import Path

import typer

from scenes.records.folder import prepared, write_bytes
from scenes.records.text import aligned, csv_bytes
from scenes.running.drawing import save_figure
from scenes.running.overlays import OVERLAYS, drawn
from scenes.running.terminal import busy, counted
from scenes.studies.compare import page
from scenes.studies.compare.aligned import aligned as aligned_to
from scenes.studies.compare.differences import (
    ABSENT,
    Difference,
    figures,
    left_out,
    named_by_settings,
    rows_by_name,
    series,
    settings,
)
from scenes.studies.compare.sources import Source, records, sources
from worm3d.values.metrics import written

COMPARISON_TABLE_FILE, COMPARISON_PAGE_FILE = "compare.csv", "compare.html"

MOST_ROWS, WIDEST = 20, 30
"""Largest number of printed settings, and largest number of characters of their values."""

MAIN = (
    *("duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "speed_BL_per_period", "heading_change_deg"),
    *("work_contract_J", "work_friction_J", "cost_of_transport", "mass_kg"),
    *("speed_bias_relative", "speed_error_rms_relative", "heading_error_rms_deg", "cross_track_rms_bl"),
)
"""Printed figures; the CSV file contains the other figures, too."""

MAIN_SERIES = ("com", "heading", "joints", "joint", "main_node", "strain", "force", "cable", "normal_load")
"""Printed series of simulations; of measurements, all series are printed."""


def run(
    paths: Sequence[Path], out: Path | None, *, align: bool = False, force: bool = False, quiet: bool = False
) -> int:
    """Compare results, write the differences into a folder, and return the exit code.

    With `align` all results are moved and turned to fit the first result best (`scenes.studies.compare.aligned`).

    Raises
    ------
    SceneError
        Fewer than two results, an invalid result, or a folder that cannot be used.
    """
    as_they_are = named_by_settings(sources(paths))
    given = _aligned(as_they_are) if align else as_they_are
    with prepared(out, "compare", force=force) as folder, busy("comparing", quiet=quiet):
        for stem in (*(f"{stem}.png" for stem in OVERLAYS), COMPARISON_TABLE_FILE, COMPARISON_PAGE_FILE):
            (folder / stem).unlink(missing_ok=True)
        found = [*figures(given), *series(given)]
        write_bytes(folder / COMPARISON_TABLE_FILE, _csv(given, found))
        for stem, figure in drawn(records(given)):
            save_figure(figure, folder / f"{stem}.png")
        missing = page.write(
            records(as_they_are), folder / COMPARISON_PAGE_FILE, " and ".join(source.label for source in given)
        )
    if not quiet:
        for line in _told(given, found, missing, folder):
            typer.echo(line)
    return 0


def _aligned(given: Sequence[Source]) -> list[Source]:
    first, *others = given
    if first.record is None:
        return list(given)
    moved = [
        each if each.record is None else replace(each, record=aligned_to(first.record, each.record)) for each in others
    ]
    return [first, *moved]


def _csv(given: Sequence[Source], found: Sequence[Difference]) -> bytes:
    """Return the table of all differences of settings, figures and series, one row each."""
    of_settings = (
        ("setting", setting.key, "", source.label, setting.values[0], value, "", "")
        for setting in settings(given)
        for source, value in zip(given[1:], setting.values[1:], strict=True)
        if not source.is_measured
    )
    return csv_bytes([[each.name for each in fields(Difference)], *of_settings, *map(astuple, found)])


def _told(given: Sequence[Source], found: Sequence[Difference], missing: str, folder: Path) -> Iterator[str]:
    labels = [source.label for source in given]
    yield from _settings(given)
    yield f"figures (difference from {labels[0]}); equal ones are left out"
    yield from _indented(_figures(given, [each for each in found if each.kind == "figure"]))
    if moved := [each for each in found if each.kind == "both"]:
        yield "over the time that both have"
        yield from _indented(_both(moved))
    if over_time := [each for each in found if each.kind == "series" and each.reference and _is_main(given, each)]:
        yield f"rms difference from {labels[0]} over the time that both have, and its share of the range"
        yield from _indented(_series(labels, over_time))
    for sentence in left_out(given):
        yield f"not compared: {sentence}"
    if missing:
        yield missing
    yield f"files in {folder}: {COMPARISON_TABLE_FILE} has all differences"


def _settings(given: Sequence[Source]) -> Iterator[str]:
    """Yield the differing keys that all scenes have; keys that some scenes lack are counted."""
    differing, simulated = settings(given), [k for k, source in enumerate(given) if not source.is_measured]
    shared = [each for each in differing if all(each.values[k] != ABSENT for k in simulated)]
    if shared:
        yield "settings that differ"
        rows = [(each.key, *(_short(value) for value in each.values)) for each in shared[:MOST_ROWS]]
        yield from _indented(aligned(("", *(source.label for source in given)), rows))
    if more := len(differing) - len(shared[:MOST_ROWS]):
        yield f"{counted(more, 'setting')} more that differ, or that not all have: {COMPARISON_TABLE_FILE} has them"


def _short(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 3]}..."


def _both(found: Sequence[Difference]) -> Iterator[str]:
    rows = [
        (f"{each.name} [{each.unit}]", _number(each.reference, each.unit), each.source, _against(each))
        for each in found
    ]
    return aligned(("", "reference", "", "other"), rows)


def _is_main(given: Sequence[Source], each: Difference) -> bool:
    measured = given[0].is_measured or next(source for source in given if source.label == each.source).is_measured
    return measured or each.name in MAIN_SERIES


def _figures(given: Sequence[Source], found: Sequence[Difference]) -> Iterator[str]:
    rows = []
    for name, row in rows_by_name(found).items():
        if name in MAIN and any(each.value != each.reference for each in row):
            rows.append((name, _number(row[0].reference, row[0].unit), *(_against(each) for each in row)))
    return aligned(("", *(source.label for source in given)), rows)


def _series(labels: Sequence[str], found: Sequence[Difference]) -> Iterator[str]:
    rows = []
    for name, row in rows_by_name(found).items():
        known = {each.source: f"{_number(each.difference)} {_share(each)}".rstrip() for each in row}
        unit = row[0].unit
        rows.append((f"{name} [{unit}]" if unit != "1" else name, *(known.get(label, "-") for label in labels[1:])))
    return aligned(("", *labels[1:]), rows)


def _against(each: Difference) -> str:
    return f"{_number(each.value, each.unit)} {_share(each, sign='+')}".rstrip()


def _share(each: Difference, sign: str = "") -> str:
    return "" if each.relative is None or each.difference == 0.0 else f"({each.relative:{sign}.1%})"


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else written(value, unit, digits=5)


def _indented(lines: Iterator[str]) -> Iterator[str]:
    yield from (f"  {line}" for line in lines)
