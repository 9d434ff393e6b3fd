"""The model `planar_study`: the corrected planar worm case by case, one number of it varied."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from planar import linkage
from scenes.models.base import Model, Observer, Outcome, Status
from scenes.models.checks import in_keys
from scenes.models.planar.linkage import ADVICE, animate, cumulative_cost, merits, reasons
from scenes.models.planar.linkage import states as states_of
from scenes.models.planar.linkage_scene import KEYS, simulate
from scenes.models.planar.merit import status_word
from scenes.models.planar.study_schema import CHECKS, StudyScene
from scenes.records import overview
from scenes.records.record import Cell, Record
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL.Image import Image

PER_CASE = "a study has one for each case: see 'cases'"

NOT_RUN = "not run: the study was interrupted before"

MERITS = {
    "distance_m": ("distance", "m", "displacement of the centre of mass"),
    "work_contract_J": ("work_contract", "J", "work of the actuators"),
    "work_friction_J": ("work_friction", "J", "energy lost to friction"),
    "cost_of_transport": ("cost_of_transport", "1", "work of the actuators over weight and distance"),
    "cumulative_cot_J_per_m": ("cumulative_cot", "J/m", "cumulative |cost of transport| of contraction, (P12)"),
    "mean_speed_m_s": ("mean_speed", "m/s", "speed averaged over a period"),
    "speed_BL_per_period": ("speed", "BL/period", "speed in body lengths per period"),
    "newton_iterations_mean": ("newton_iterations", "1", "evaluations of the Jacobian per step"),
    "energy_balance_error": ("energy_balance_error", "1", "residual of the energy ledger over its absolute terms"),
}
"""Figures of each case: name in the table of the summary -> variable, unit and meaning in the record."""


@dataclass(frozen=True)
class Case:
    """One case of a study.

    Attributes
    ----------
    value : float
        Of the number that is varied.
    run : Run or None
        None if the case was refused or not run.
    figures : dict
        Of `MERITS`; all None unless the case came to its end.
    why : dict
        Why a figure has no value.
    sentence : str
        How the case ended.
    """

    value: float
    run: linkage.Run | None
    figures: dict[str, float | None]
    why: dict[str, str]
    sentence: str

    @property
    def done(self) -> bool:
        """Whether the case came to its end."""
        return self.run is not None and self.run.status is self.run.status.DONE


def run(scene: StudyScene, observer: Observer) -> Outcome:
    """Simulate all cases; one that fails does not keep the others from running."""
    start = perf_counter()
    cases, interrupted = _simulate_cases(scene, observer)
    wall_s = perf_counter() - start
    return Outcome(
        status=_status(cases, interrupted),
        sentence=_sentence(scene, cases),
        variables=_variables(scene, cases),
        summary=_summary(scene, cases),
        reasons=dict.fromkeys(_NO_SINGLE_VALUE, PER_CASE) | dict.fromkeys(_OVER_ALL, "no case came to its end"),
        wall_s=wall_s,
    )


def _simulate_cases(scene: StudyScene, observer: Observer) -> tuple[list[Case], bool]:
    stopped = False
    cases = []
    for number, value in enumerate(scene.study.values):
        before = number * scene.run.steps

        def observe(done: int, before: int = before) -> bool:
            nonlocal stopped
            stopped = not observer(before + done)
            return not stopped

        cases.append(_failed(value, NOT_RUN) if stopped else _simulate(scene, value, observe))
    return cases, any(case.sentence == NOT_RUN or _interrupted(case) for case in cases)


def _simulate(scene: StudyScene, value: float, observer: Observer) -> Case:
    case = scene.case(value)
    try:
        result = simulate(case, observer)
    except ValueError as error:
        return _failed(value, in_keys(str(error), KEYS))
    if status_word(result.status) != "done":
        return _failed(value, result.stop.sentence, result)
    figures = merits(case, result)
    return Case(value, result, {name: figures[name] for name in MERITS}, reasons(figures), result.stop.sentence)


def _failed(value: float, sentence: str, result: linkage.Run | None = None) -> Case:
    return Case(value, result, dict.fromkeys(MERITS), dict.fromkeys(MERITS, sentence), sentence)


def _interrupted(case: Case) -> bool:
    return case.run is not None and case.run.status is case.run.status.INTERRUPTED


def _status(cases: Sequence[Case], interrupted: bool) -> Status:
    if interrupted:
        return "interrupted"
    if all(case.done for case in cases):
        return "done"
    return "incomplete" if any(case.done for case in cases) else "diverged"


def _sentence(scene: StudyScene, cases: Sequence[Case]) -> str:
    failed = [f"{scene.study.vary} = {case.value:g}: {case.sentence}" for case in cases if not case.done]
    return "; ".join((f"{len(cases) - len(failed)} of {len(cases)} cases reached their end", *failed))


_NO_SINGLE_VALUE = (
    *("distance_m", "path_length_m", "mean_speed_m_s", "work_contract_J", "work_friction_J"),
    "cost_of_transport",
)
_OVER_ALL = ("energy_balance_error", "newton_iterations_mean")


def _summary(scene: StudyScene, cases: Sequence[Case]) -> dict[str, Cell | list[dict[str, Cell]]]:
    done = [case for case in cases if case.done]

    def over_all(name: str, merge: Callable[[list[float]], float]) -> float | None:
        values = [figure for case in done if (figure := case.figures[name]) is not None]
        return float(merge(values)) if values else None

    return {
        "duration_s": float(sum(case.run.time[-1] for case in cases if case.run is not None)),
        **dict.fromkeys(_NO_SINGLE_VALUE),
        "heading_change_deg": 0.0,  # a planar worm cannot turn
        "energy_balance_error": over_all("energy_balance_error", max),
        "newton_iterations_mean": over_all("newton_iterations_mean", lambda values: sum(values) / len(values)),
        "vary": scene.study.vary,
        "cases": [_row(scene, case) for case in cases],
    }


def _row(scene: StudyScene, case: Case) -> dict[str, Cell]:
    absent = sorted({case.why[name] for name, figure in case.figures.items() if figure is None})
    return {scene.study.vary: case.value, **case.figures, "reason": "; ".join(absent) or None}


def _variables(scene: StudyScene, cases: Sequence[Case]) -> tuple[Variable, ...]:
    per_case = ("case",)
    return (
        Variable("value", per_case, scene.study.values, "1", f"{scene.study.vary} in each case"),
        *(
            Variable(variable, per_case, [_or_nan(case.figures[name]) for case in cases], unit, meaning)
            for name, (variable, unit, meaning) in MERITS.items()
        ),
        *_curves(scene, cases),
        *_shown(scene, cases),
    )


def _or_nan(figure: float | None) -> float:
    return float("nan") if figure is None else figure


def _curves(scene: StudyScene, cases: Sequence[Case]) -> tuple[Variable, ...]:
    every, runs = scene.run.record_every, [case.run for case in cases]
    steps = max((len(each.steps) for each in runs if each is not None), default=0)
    time = np.arange(steps + 1) * scene.run.dt_s
    com_x = np.full((len(cases), steps + 1), np.nan)
    cost = np.full((len(cases), steps), np.nan)
    for number, each in enumerate(runs):
        if each is not None:
            x = each.com[:, 0]
            com_x[number, : len(x)] = x
            cost[number, : len(x) - 1] = cumulative_cost(each.ledger.work_contract_p11, x)
    stored = com_x[:, ::every]
    return (
        Variable("time", ("time",), time[::every], "s", "time"),
        Variable("com_x", ("case", "time"), stored, "m", "centre of mass along the ground; NaN after a case's end"),
        Variable("step_time", ("step",), time[1:], "s", "end of each time step"),
        Variable("cumulative_cost", ("case", "step"), cost, "J/m", "cumulative |cost of transport|, (P12)"),
    )


def _shown(scene: StudyScene, cases: Sequence[Case]) -> tuple[Variable, ...]:
    """Return the states of the case that is animated: the last of those that went furthest in time."""
    steps = [0 if case.run is None else len(case.run.steps) for case in cases]
    number = len(steps) - 1 - int(np.argmax(steps[::-1]))
    result = cases[number].run
    if result is None:
        return ()
    ground = () if result.ground is None else (Variable("ground", (), 0.0, "m", "height of the ground"),)
    shown = (v for v in states_of(result, scene.run.record_every) if v.name != "time")
    return (Variable("shown_case", (), number, "1", "case whose states are stored"), *shown, *ground)


def _vary(record: Record) -> str:
    return str(record.summary["vary"])


def _curves_by_case(record: Record, name: str) -> dict[str, FloatArray]:
    labelled = zip(record["value"], record[name], strict=True)
    return {f"{_vary(record)} = {value:g}": curve for value, curve in labelled if np.isfinite(curve).any()}


def _draw_com(record: Record) -> tuple[Figure, Axes]:
    from planar import figures

    title = f"{record.title}: centre of mass by case"
    return figures.centre_of_mass(record["time"], _curves_by_case(record, "com_x"), title=title)


def _draw_cumulative_cost(record: Record) -> tuple[Figure, Axes]:
    from planar import figures

    title = f"{record.title}: cumulative cost of transport by case, sum of |work / dx|"
    return figures.cumulative_cost(record["step_time"], _curves_by_case(record, "cumulative_cost"), title=title)


def _draw_cost(record: Record) -> tuple[Figure, Axes]:
    panels = {
        "sum of |work / dx|, (P12) [J/m]": record["cumulative_cot"],
        "work / (weight x distance)": record["cost_of_transport"],
    }
    return _panels(record, panels, "cost of transport")


def _draw_distance(record: Record) -> tuple[Figure, Axes]:
    panels = {"distance [m]": record["distance"], "speed [body lengths per period]": record["speed"]}
    return _panels(record, panels, "distance and speed")


def _overview(record: Record) -> Image:
    panels = {"distance [m]": record["distance"], "work / (weight x distance)": record["cost_of_transport"]}
    return overview.of_cases(record, _vary(record), panels)


def _panels(record: Record, panels: dict[str, FloatArray], what: str) -> tuple[Figure, Axes]:
    from planar import figures

    return figures.by_case(record["value"], panels, _vary(record), title=f"{record.title}: {what} by case")


COLUMNS = {
    "distance [m]": "distance_m",
    "work [J]": "work_contract_J",
    "cost of transport": "cost_of_transport",
    "speed [BL/period]": "speed_BL_per_period",
}


def _table(record: Record) -> list[str]:
    """Return the cases, a line each, and why a figure has no value."""
    vary, rows = _vary(record), record.summary["cases"]
    assert isinstance(rows, list)
    lines = ["  ".join((vary, *COLUMNS))]
    for row in rows:
        cells = [_cell(row[name], len(title)) for title, name in {vary: vary, **COLUMNS}.items()]
        lines.append("  ".join(cells) + (f"  ({row['reason']})" if row["reason"] else ""))
    return lines


def _cell(figure: Cell, width: int) -> str:
    return f"{'none' if figure is None else f'{figure:.6g}':>{width}}"


MODEL = Model(
    name="planar_study",
    title="the corrected planar worm case by case, one number of it varied",
    schema=StudyScene,
    checks=CHECKS,
    run=run,
    figures={
        "centre_of_mass_by_case": _draw_com,
        "cumulative_cost_by_case": _draw_cumulative_cost,
        "cost_of_transport_by_case": _draw_cost,
        "distance_and_speed_by_case": _draw_distance,
    },
    overview=_overview,
    animate=animate,
    advice=ADVICE,
    table=_table,
)
