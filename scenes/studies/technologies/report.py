"""Files of `worm3d study technologies`: a table as CSV, and a text with the table, the sentences and the sources."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from scenes.records.text import csv_bytes, markdown_table
from scenes.studies.technologies.limits import Verdict
from scenes.studies.technologies.runs import Bench
from worm3d.physics.technologies.presets import TECHNOLOGIES

VERDICT_COLUMNS = (
    ("technology", "technology"),
    ("speed_bl_s", "speed [BL/s]"),
    ("stride_bl", "way a wave [BL]"),
    ("cost_of_transport_input", "cost of transport, energy drawn"),
    ("cost_of_transport_given", "cost of transport, work on the worm"),
    ("power_W", "power drawn [W]"),
    ("idle_W", "of it idle [W]"),
    ("efficiency", "efficiency"),
    ("limit", "limit"),
    ("best_period_s", "best period [s]"),
    ("best_speed_bl_s", "speed at it [BL/s]"),
    ("stroke", "free stroke"),
    ("blocking_N", "blocking force of a chamber [N]"),
    ("area_mm2", "cross-section [mm^2]"),
    ("warmth_K", "warmth [K]"),
    ("not_counted", "not counted in what is drawn"),
)
"""Columns of the CSV file, and their titles in the text."""


def row(of: Verdict) -> dict[str, Any]:
    """Return the row of a technology by column; NaN where there is no number."""
    own, best = of.own, of.best
    return {
        "technology": of.kind,
        "speed_bl_s": own.speed,
        "stride_bl": own.stride,
        "cost_of_transport_input": own.drawn if of.moves else math.nan,
        "cost_of_transport_given": own.given if of.moves else math.nan,
        "power_W": own.power,
        "idle_W": of.idle,
        "efficiency": own.given / own.drawn if of.moves and not of.acting.uncounted else math.nan,
        "limit": of.limit or "-",
        "best_period_s": best.period,
        "best_speed_bl_s": best.speed,
        "stroke": of.stroke,
        "blocking_N": of.blocking,
        "area_mm2": float(of.area.min()) * 1e6,
        "warmth_K": own.warmth,
        "not_counted": of.acting.uncounted,
    }


def table(verdicts: Sequence[Verdict]) -> bytes:
    """Return the table as a CSV file; a missing number is an empty cell."""
    return csv_bytes([[name for name, _ in VERDICT_COLUMNS], *(row(each).values() for each in verdicts)])


def text(bench: Bench, verdicts: Sequence[Verdict]) -> str:
    """Return the text, in Markdown."""
    lines = [
        f"# Technologies: {bench.name}",
        "",
        f"The worm of the scene with its gait, of a period of {bench.period:g} s, which asks for a contraction by "
        f"{bench.asked:.2g}, on each technology. Each has the size that springs and weight ask for, within the room "
        "that a chamber has (`actuator.reserve`, `actuator.room`), unless the scene gives `actuator.area_m2`.",
        "",
        *markdown_table(
            [title for _, title in VERDICT_COLUMNS], ([*map(_cell, row(each).values())] for each in verdicts)
        ),
        "",
        "## What limits each",
        "",
        *(f"* {each.sentence}." for each in verdicts),
        "",
        conclusion(verdicts),
        "",
        "## Where the numbers are from",
        "",
    ]
    for each in verdicts:
        lines += [f"**{each.kind}**: {(TECHNOLOGIES[each.kind].__doc__ or '').splitlines()[0]}", ""]
        sources = each.acting.sources
        lines += [f"* {name} = {_cell(getattr(each.acting, name))}: {source}" for name, source in sources.items()]
        lines.append("")
    return "\n".join(lines)


def conclusion(verdicts: Sequence[Verdict]) -> str:
    """Return the fastest and the most economical technology, and the costs that the numbers leave out."""
    moving = [each for each in verdicts if each.moves]
    if not moving:
        return "None of them moves this worm with this gait."
    fast, whole = max(moving, key=lambda each: each.own.speed), [each for each in moving if not each.acting.uncounted]
    said = [f"With this gait {fast.kind} is fastest ({fast.own.speed:.2g} BL/s)."]
    if whole:
        thrifty, idle = min(whole, key=lambda each: each.own.drawn), [each.kind for each in whole if each.idle]
        said.append(
            f"{thrifty.kind} draws least for its way ({thrifty.own.drawn:.2g} times weight times distance) of those "
            f"whose source is counted; idle power is counted of {', '.join(idle) or 'none'} alone, that of the pumps, "
            "valves and supplies of others is not known."
        )
    said += [
        f"{each.kind} is not compared: what it draws leaves out {each.acting.uncounted}."
        for each in moving
        if each.acting.uncounted
    ]
    if still := [each.kind for each in verdicts if not each.moves]:
        said.append(f"Not moved by: {', '.join(still)}.")
    return " ".join(said)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{round(value, 12) + 0.0:.3g}"  # a worm at rest has rounding errors
    return str(value)
