"""What `worm3d bench control` found as text: CSV, Markdown, and lines for the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from typing import Any

from scenes.bench.control import METRICS, TIMES, Found, Row, Value
from scenes.bench.control_bars import Verdict, verdicts
from scenes.bench.tables import Cells, aligned, markdown_table

HEADER = (
    *("scene", "controller", "seeds", "speed bias [%]", "speed rms [%]", "settling [periods]", "heading mean [deg]"),
    *("heading rms [deg]", "offset rms [BL]", "offset max [BL]", "MPC failures", "step p50 [ms]", "step p99 [ms]"),
    "overruns",
)
SCALES = {"speed_bias_relative": 100.0, "speed_error_rms_relative": 100.0}
FORMS = {"cross_track_rms_bl": ".4f", "cross_track_max_bl": ".4f", "mpc_failures": ".0f", "overruns": ".0f"}

SAYS = (
    "The worst of all seeds, on the full 3D plant, without a sensor of the heading unless the scene has one. All is "
    "averaged over a moving window of one commanded period; the first three periods, and three after each step of the "
    "speed, are left out. BL: body lengths. A control step is all that a controller computes in a control period, its "
    "estimates included. open_loop looks at nothing, so one seed is enough."
)


def as_csv(found: Sequence[Found]) -> str:
    """Return one line for each run."""
    names = (*METRICS, *TIMES, "control_period_ms")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("scene", "controller", "seed", "status", *names))
    for each in found:
        writer.writerow((each.trial, each.controller, each.seed, each.status, *(_cell(each.figures[n]) for n in names)))
    return text.getvalue()


def markdown(rows: Sequence[Row], machine: dict[str, Any], picture: str) -> str:
    """Return the report; `picture` is the file beside it, which it shows."""
    lines = (
        *("# How well worms keep to their references", "", SAYS, "", f"![the worst of the seeds]({picture})", ""),
        *markdown_table(HEADER, map(_cells, rows)),
        *("", "## What the MPC is held to", ""),
        *markdown_table(("scene", "what", "found", "at most", ""), map(_verdict_cells, verdicts(rows))),
        *("", f"{machine['cpu']}, {machine['system']}, {machine['date']}, one core."),
    )
    return "\n".join(lines) + "\n"


def terminal_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines to print."""
    yield from aligned(HEADER, map(_cells, rows))
    yield ""
    yield from aligned(("scene", "what", "found", "at most", ""), map(_verdict_cells, verdicts(rows)))


def _cells(row: Row) -> Cells:
    failed = f" ({row.failed} failed)" if row.failed else ""
    values = (_number(name, row.figures[name]) for name in (*METRICS, *TIMES))
    bias, rms, settling, *rest = values
    return (row.trial, row.controller, f"{row.seeds}{failed}", bias, rms, settling, *rest)


def _number(name: str, value: Value) -> str:
    return "-" if value is None else f"{SCALES.get(name, 1.0) * value:{FORMS.get(name, '.2f')}}"


def _verdict_cells(verdict: Verdict) -> Cells:
    numbers = ("-" if value is None else f"{value:.4g}" for value in (verdict.found, verdict.most))
    word = {True: "kept", False: "NOT KEPT", None: "not run"}[verdict.kept]
    return (verdict.trial, verdict.says, *numbers, word)


def _cell(value: Value) -> str:
    return "" if value is None else repr(value)
