"""The command `worm3d compare`: table, CSV, figures and page of the differences between results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, fields, replace
from pathlib import Path

from scenes.records.text import csv_bytes
from scenes.running.overlays import OVERLAYS, drawn
from scenes.running.report import Block, Heading, Items, Report, Table, report_study
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

COMPARISON_TABLE_FILE = "compare.csv"

MOST_ROWS = 20
"""Largest number of settings in the printed table."""

MAIN = (
    *("duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "speed_BL_per_period", "heading_change_deg"),
    *("work_contract_J", "work_friction_J", "cost_of_transport", "mass_kg"),
    *("speed_bias_relative", "speed_error_rms_relative", "heading_error_rms_deg", "cross_track_rms_bl"),
)
"""Figures of the summary that are printed. The CSV file contains all figures."""

MAIN_SERIES = ("com", "heading", "joints", "joint", "main_node", "strain", "force", "cable", "normal_load")
"""Series that are printed if two simulations are compared. If one of the two is a measurement, all common series are
printed."""


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

    def study(folder: Path) -> Report:
        for name in (*(f"{stem}.png" for stem in OVERLAYS), COMPARISON_TABLE_FILE, page.COMPARISON_PAGE_FILE):
            (folder / name).unlink(missing_ok=True)
        with busy("comparing", quiet=quiet):
            found = [*figures(given), *series(given)]
            pages, missing = page.pages(records(as_they_are), " and ".join(source.label for source in given))
            return Report(
                said=list(_said(given, found, missing)),
                files={COMPARISON_TABLE_FILE: _csv(given, found), **pages},
                pictures={f"{stem}.png": figure for stem, figure in drawn(records(given))},
            )

    return report_study("compare", study, out, force=force, quiet=quiet)


def _aligned(given: Sequence[Source]) -> list[Source]:
    first, *others = given
    if first.record is None:
        return list(given)
    moved = [
        each if each.record is None else replace(each, record=aligned_to(first.record, each.record)) for each in others
    ]
    return [first, *moved]


def _csv(given: Sequence[Source], found: Sequence[Difference]) -> bytes:
    """Return a CSV table with one row for each difference of a setting, a figure or a series."""
    of_settings = (
        ("setting", setting.key, "", source.label, setting.values[0], value, "", "")
        for setting in settings(given)
        for source, value in zip(given[1:], setting.values[1:], strict=True)
        if not source.is_measured
    )
    return csv_bytes([[each.name for each in fields(Difference)], *of_settings, *map(astuple, found)])


def _said(given: Sequence[Source], found: Sequence[Difference], missing: str) -> Iterator[Block]:
    labels = [source.label for source in given]
    yield from _settings(given)
    yield Heading(f"figures (difference from {labels[0]}); equal ones are left out")
    yield _figures(labels, [each for each in found if each.kind == "figure"])
    if moved := [each for each in found if each.kind == "both"]:
        yield from (Heading("over the time that both have"), _both(moved))
    if over_time := [each for each in found if each.kind == "series" and each.reference and _is_main(given, each)]:
        yield Heading(f"rms difference from {labels[0]} over the time that both have, and its share of the range")
        yield _series(labels, over_time)
    yield Items([f"not compared: {sentence}" for sentence in left_out(given)])
    if missing:
        yield missing
    yield f"{COMPARISON_TABLE_FILE} has all differences"


def _settings(given: Sequence[Source]) -> Iterator[Block]:
    """Yield a table of the differing keys that all scenes have, and the number of other differing keys."""
    differing, simulated = settings(given), [k for k, source in enumerate(given) if not source.is_measured]
    shared = [each for each in differing if all(each.values[k] != ABSENT for k in simulated)]
    if shared:
        yield Heading("settings that differ")
        rows = [(each.key, *(_short(value) for value in each.values)) for each in shared[:MOST_ROWS]]
        yield Table(("", *(source.label for source in given)), rows)
    if more := len(differing) - len(shared[:MOST_ROWS]):
        yield f"{counted(more, 'setting')} more that differ, or that not all have: {COMPARISON_TABLE_FILE} has them"


def _short(text: str) -> str:
    return text if len(text) <= 30 else f"{text[:27]}..."


def _both(found: Sequence[Difference]) -> Table:
    rows = [
        (f"{each.name} [{each.unit}]", _number(each.reference, each.unit), each.source, _against(each))
        for each in found
    ]
    return Table(("", "reference", "", "other"), rows)


def _is_main(given: Sequence[Source], each: Difference) -> bool:
    measured = given[0].is_measured or next(source for source in given if source.label == each.source).is_measured
    return measured or each.name in MAIN_SERIES


def _figures(labels: Sequence[str], found: Sequence[Difference]) -> Table:
    rows = []
    for name, row in rows_by_name(found).items():
        if name in MAIN and any(each.value != each.reference for each in row):
            rows.append((name, _number(row[0].reference, row[0].unit), *(_against(each) for each in row)))
    return Table(("", *labels), rows)


def _series(labels: Sequence[str], found: Sequence[Difference]) -> Table:
    rows = []
    for name, row in rows_by_name(found).items():
        known = {each.source: f"{_number(each.difference)} {_share(each)}".rstrip() for each in row}
        unit = row[0].unit
        rows.append((f"{name} [{unit}]" if unit != "1" else name, *(known.get(label, "-") for label in labels[1:])))
    return Table(("", *labels[1:]), rows)


def _against(each: Difference) -> str:
    return f"{_number(each.value, each.unit)} {_share(each, sign='+')}".rstrip()


def _share(each: Difference, sign: str = "") -> str:
    return "" if each.relative is None or each.difference == 0.0 else f"({each.relative:{sign}.1%})"


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else written(value, unit, digits=5)
