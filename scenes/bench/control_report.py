"""What `worm3d bench control` found as text: CSV, Markdown, and lines for the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from control.tracking.metrics import SETTLED_METRICS, SPEED_METRICS
from scenes.bench.control import BLIND, METRICS, TIMES, Found, Row, Value
from scenes.bench.control_bars import MPC, RIVAL, Verdict, verdicts
from scenes.bench.tables import Cells, aligned, markdown_table

TABLES = {
    "Speed [%], and its settling [periods]": {
        "speed_bias_relative": "bias",
        "speed_error_rms_relative": "rms",
        **dict(zip(SETTLED_METRICS, ("settled bias", "settled rms"), strict=True)),
        "settling_periods": "settling",
    },
    "Heading [deg], and offset from the path [BL]": {
        "heading_error_mean_deg": "heading mean",
        "heading_error_rms_deg": "heading rms",
        "cross_track_rms_bl": "offset rms",
        "cross_track_max_bl": "offset max",
    },
    "Control steps [ms], and how many failed or took too long": {
        "mpc_failures": "MPC failures",
        "control_step_ms_p50": "p50",
        "control_step_ms_p99": "p99",
        "overruns": "overruns",
    },
}
"""Tables of a report: title and columns of each, which stand beside scene, controller and seeds."""
KEYS = ("scene", "controller", "seeds")
SCALES = dict.fromkeys((*SPEED_METRICS, *SETTLED_METRICS), 100.0)
UNITS = {
    **dict.fromkeys(SCALES, "%"),
    **dict.fromkeys(("heading_error_mean_deg", "heading_error_rms_deg"), "deg"),
    **dict.fromkeys(("cross_track_rms_bl", "cross_track_max_bl"), "BL"),
    "settling_periods": "periods",
    "control_step_ms_p99": "ms",
}
FORMS = {"cross_track_rms_bl": ".4f", "cross_track_max_bl": ".4f", "mpc_failures": ".0f", "overruns": ".0f"}

SAYS = (
    "The worst of all seeds, on the full 3D plant, without a sensor of the heading unless the scene has one. All is "
    "averaged over a moving window of one commanded period; the first three periods are left out, and from the settled "
    "bias and rms of the speed also three after each of its steps. BL: body lengths. A control step is all that a "
    "controller computes in a control period, its estimates included. open_loop looks at nothing: one seed is enough."
)
SHORT = ("cross_track_rms_bl", "heading_error_rms_deg", "speed_error_rms_relative")
"""What a trial is about: the first of these that its MPC has, but of those of the velocity the last."""
TITLES = {
    "cross_track_rms_bl": "offset from the path, rms",
    "heading_error_rms_deg": "heading error, rms",
    "speed_error_rms_relative": "speed error, rms",
}
TOLD = {MPC: "MPC", RIVAL: "line-of-sight", BLIND: "open loop"}
NO_VERDICTS = "These runs are too short to be held to any bar."
VERDICTS = ("scene", "what", "found", "at most", "")


def as_csv(found: Sequence[Found]) -> str:
    """Return one line for each run."""
    names = (*METRICS, *TIMES, "control_period_ms")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("scene", "controller", "seed", "status", *names))
    for each in found:
        writer.writerow((each.trial, each.controller, each.seed, each.status, *(_cell(each.figures[n]) for n in names)))
    return text.getvalue()


def markdown(rows: Sequence[Row], machine: dict[str, Any], picture: str, *, judged: bool = True) -> str:
    """Return the report; `picture` is the file beside it, which it shows; bars are left out unless `judged`."""
    bars = markdown_table(VERDICTS, map(_verdict_cells, verdicts(rows))) if judged else (NO_VERDICTS,)
    lines = (
        *("# How well worms keep to their references", "", SAYS, "", f"![the worst of the seeds]({picture})", ""),
        *(line for title in TABLES for line in (f"## {title}", "", *markdown_table(*_table(title, rows)), "")),
        *("## In short", "", *markdown_table(("scene", "what", *TOLD.values()), _short(rows))),
        *("", "## What the MPC is held to", "", *bars),
        *("", f"{machine['cpu']}, {machine['system']}, {machine['date']}, one core."),
    )
    return "\n".join(lines) + "\n"


def terminal_lines(rows: Sequence[Row], *, judged: bool = True) -> Iterator[str]:
    """Yield the lines to print; bars are left out unless `judged`."""
    for title in TABLES:
        yield title
        yield from aligned(*_table(title, rows))
        yield ""
    yield from aligned(VERDICTS, map(_verdict_cells, verdicts(rows))) if judged else (NO_VERDICTS,)


def _short(rows: Sequence[Row]) -> Iterator[Cells]:
    """Yield one figure of each trial, of every controller."""
    of = {(row.trial, row.controller): row.figures for row in rows}
    for trial in dict.fromkeys(row.trial for row in rows):
        mine = of.get((trial, MPC), {})
        places = () if trial.startswith("velocity") else SHORT
        name = next((name for name in places if mine.get(name) is not None), SHORT[-1])
        yield trial, TITLES[name], *(_with_unit(name, of.get((trial, kind), {}).get(name)) for kind in TOLD)


def _table(title: str, rows: Sequence[Row]) -> tuple[Cells, Iterator[Cells]]:
    """Return the header and the rows of a table."""
    return (*KEYS, *TABLES[title].values()), (_cells(row, TABLES[title]) for row in rows)


def _cells(row: Row, names: Iterable[str]) -> Cells:
    failed = f" ({row.failed} failed)" if row.failed else ""
    return (row.trial, row.controller, f"{row.seeds}{failed}", *(_number(name, row.figures[name]) for name in names))


def _number(name: str, value: Value) -> str:
    return "-" if value is None else f"{SCALES.get(name, 1.0) * value:{FORMS.get(name, '.2f')}}"


def _with_unit(name: str, value: Value) -> str:
    return "-" if value is None else f"{_number(name, value)} {UNITS[name]}"


def _verdict_cells(verdict: Verdict) -> Cells:
    numbers = (_with_unit(verdict.figure, value) for value in (verdict.found, verdict.most))
    return (verdict.trial, verdict.says, *numbers, verdict.word)


def _cell(value: Value) -> str:
    return "" if value is None else repr(value)
