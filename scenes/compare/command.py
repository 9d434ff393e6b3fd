"""The command `worm3d compare`: table, CSV, figures and page of what differs between results."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import astuple, fields
from pathlib import Path

import typer

from scenes.commands.terminal import busy
from scenes.compare import page
from scenes.compare.differences import Difference, figures, rows_by_name, series, settings
from scenes.compare.overlays import OVERLAYS, drawn
from scenes.compare.sources import Source, records, sources
from scenes.records.drawing import save_figure
from scenes.records.folder import prepared, write_bytes
from scenes.records.text import aligned
from worm3d.metrics import written

TABLE, PAGE = "compare.csv", "compare.html"

MAIN = (
    *("duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "speed_BL_per_period", "heading_change_deg"),
    *("work_contract_J", "work_friction_J", "cost_of_transport", "mass_kg"),
    *("speed_bias_relative", "speed_error_rms_relative", "heading_error_rms_deg", "cross_track_rms_bl"),
)
"""Figures that are printed; the others, too, stand in the CSV file."""

MAIN_SERIES = ("com", "heading", "joints", "joint", "main_node", "strain", "force", "cable", "normal_load")
"""Series of simulations that are printed; of measurements, all are."""


def run(paths: Sequence[Path], out: Path | None, *, force: bool, quiet: bool) -> int:
    """Compare results, write what was found into a folder, and return the exit code.

    Raises
    ------
    SceneError
        Fewer than two results, one that is none, or a folder that cannot be used.
    """
    given = sources(paths)
    with prepared(out, "compare", force=force) as folder, busy("comparing", quiet=quiet):
        for stem in (*(f"{stem}.png" for stem in OVERLAYS), TABLE, PAGE):
            (folder / stem).unlink(missing_ok=True)
        found = [*figures(given), *series(given)]
        write_bytes(folder / TABLE, _csv(given, found))
        for stem, figure in drawn(records(given)):
            save_figure(figure, folder / f"{stem}.png")
        missing = page.write(records(given), folder / PAGE, " and ".join(source.label for source in given))
    if not quiet:
        for line in _told(given, found, missing, folder):
            typer.echo(line)
    return 0


def _csv(given: Sequence[Source], found: Sequence[Difference]) -> bytes:
    """Return the table of all differences: of settings, figures and series, a row each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([each.name for each in fields(Difference)])
    for setting in settings(given):
        for source, value in zip(given[1:], setting.values[1:], strict=True):
            if not source.is_measured:
                writer.writerow(["setting", setting.key, "", source.label, setting.values[0], value, "", ""])
    for each in found:
        writer.writerow(["" if item is None else item for item in astuple(each)])
    return text.getvalue().encode()


def _told(given: Sequence[Source], found: Sequence[Difference], missing: str, folder: Path) -> Iterator[str]:
    labels = [source.label for source in given]
    if changed := settings(given):
        yield "settings that differ"
        yield from _indented(aligned(("key", *labels), [(each.key, *each.values) for each in changed]))
    yield f"figures (difference from {labels[0]})"
    yield from _indented(_figures(given, [each for each in found if each.kind == "figure"]))
    over_time = [each for each in found if each.kind == "series" and _is_main(given, each)]
    if over_time:
        yield "over the time that both have (rms difference, and its share of the range)"
        yield from _indented(_series(labels, over_time))
    if missing:
        yield missing
    yield f"files in {folder}: {TABLE} has all differences"


def _is_main(given: Sequence[Source], each: Difference) -> bool:
    measured = given[0].is_measured or next(source for source in given if source.label == each.source).is_measured
    return measured or each.name in MAIN_SERIES


def _figures(given: Sequence[Source], found: Sequence[Difference]) -> Iterator[str]:
    rows = []
    for name, row in rows_by_name(found).items():
        if name in MAIN and any(each.value is not None or each.reference is not None for each in row):
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
    return "" if each.relative is None else f"({each.relative:{sign}.1%})"


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else written(value, unit, digits=5)


def _indented(lines: Iterator[str]) -> Iterator[str]:
    yield from (f"  {line}" for line in lines)
