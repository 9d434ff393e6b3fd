"""The command `worm3d study technologies`: run the worm of a scene with each technology, and write the report.

The report has a table, sentences on the limits, the sources of all numbers, and a figure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from scenes.language.errors import SceneError
from scenes.records.text import Column, csv_table
from scenes.running.report import Block, Heading, Items, Report, Table, report_study
from scenes.running.terminal import each
from scenes.studies.technologies.limits import Verdict, judged
from scenes.studies.technologies.runs import Bench
from worm3d.physics.technologies.presets import TECHNOLOGIES

VERDICT_COLUMNS = {
    title: Column(attribute, ".3g", none="-", name=name)
    for name, title, attribute in (
        ("technology", "technology", "kind"),
        ("speed_bl_s", "speed [BL/s]", "own.speed"),
        ("stride_bl", "way a wave [BL]", "own.stride"),
        ("cost_of_transport_input", "cost of transport, energy drawn", "drawn"),
        ("cost_of_transport_given", "cost of transport, work on the worm", "given"),
        ("power_W", "power drawn [W]", "own.power"),
        ("idle_W", "of it idle [W]", "idle"),
        ("efficiency", "efficiency", "efficiency"),
        ("limit", "limit", "limit_or_none"),
        ("best_period_s", "best period [s]", "best.period"),
        ("best_speed_bl_s", "speed at it [BL/s]", "best.speed"),
        ("stroke", "free stroke", "stroke"),
        ("blocking_N", "blocking force of a chamber [N]", "blocking"),
        ("area_mm2", "cross-section [mm^2]", "smallest_area_mm2"),
        ("warmth_K", "warmth [K]", "own.warmth"),
        ("not_counted", "not counted in what is drawn", "acting.uncounted"),
    )
}
"""Columns of the table, by title."""


def run(
    scene: str, overrides: Sequence[str], only: Sequence[str], out: Path | None, *, force: bool, quiet: bool
) -> int:
    """Run the study and return the exit code. The default folder is `runs/technologies-<scene>-<time>`.

    Raises
    ------
    SceneError
        The scene has no 3D worm with a gait, a technology is unknown, or the folder cannot be used.
    """
    if unknown := [kind for kind in only if kind not in TECHNOLOGIES]:
        raise SceneError(f"--only: got {unknown[0]!r}, must be one of {', '.join(TECHNOLOGIES)}")
    bench = Bench(scene, overrides)
    kinds = [kind for kind in TECHNOLOGIES if kind in only or not only]

    def study(folder: Path) -> Report:
        found = each("technologies", kinds, lambda kind: judged(bench, kind), "actuator", quiet=quiet)
        return report(bench, list(found.values()))

    return report_study(f"technologies-{bench.name}", study, out, force=force, quiet=quiet)


def report(bench: Bench, verdicts: Sequence[Verdict]) -> Report:
    """Return the report on technologies, given their results."""
    from scenes.studies.technologies.figure import draw  # imports matplotlib

    return Report(
        said=[Items([verdict.sentence for verdict in verdicts])],
        pages={"technologies.md": list(_page(bench, verdicts))},
        files={"technologies.csv": csv_table(VERDICT_COLUMNS.values(), verdicts)},
        pictures={"technologies.png": draw(bench, verdicts)},
    )


def _page(bench: Bench, verdicts: Sequence[Verdict]) -> Iterator[Block]:
    yield Heading(f"Technologies: {bench.name}", 1)
    yield (
        f"The worm of the scene with its gait, of a period of {bench.period:g} s, which asks for a contraction by "
        f"{bench.asked:.2g}, on each technology. Each has the size that springs and weight ask for, within the room "
        "that a chamber has (`actuator.reserve`, `actuator.room`), unless the scene gives `actuator.area_m2`."
    )
    yield Table.of(VERDICT_COLUMNS, verdicts)
    yield Heading("What limits each")
    yield Items([f"{verdict.sentence}." for verdict in verdicts])
    yield conclusion(verdicts)
    yield Heading("Where the numbers are from")
    for verdict in verdicts:
        yield f"**{verdict.kind}**: {(TECHNOLOGIES[verdict.kind].__doc__ or '').splitlines()[0]}"
        sources = verdict.acting.sources.items()
        yield Items([f"{name} = {_number(getattr(verdict.acting, name))}: {source}" for name, source in sources])


def conclusion(verdicts: Sequence[Verdict]) -> str:
    """Return a text with the fastest and the most economical technology, and the energy that is not counted."""
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


def _number(value: Any) -> str:
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.3g}"
    return str(value)
