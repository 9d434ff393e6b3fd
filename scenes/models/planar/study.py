"""The model `planar_study`: the corrected planar worm case by case, one number of it varied."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from planar import linkage
from planar.linkage.simulate import bytes_per_step
from scenes.language.checks import Check, Found, cross_mistakes
from scenes.language.mistakes import dotted, schema_mistakes
from scenes.language.schema import Numbers, Section, field_at, is_number, quantity, setting
from scenes.models.base import Model, Observer, Outcome, Status, pictures
from scenes.models.checks import RUN_CHECKS, in_keys, too_much_memory
from scenes.models.planar.linkage import ADVICE, animate, cumulative_cost, merits, reasons
from scenes.models.planar.linkage import states as states_of
from scenes.models.planar.linkage_scene import KEYS, RULES, LinkageScene, LinkageSettings, simulate
from scenes.models.planar.merit import status_word, varied
from scenes.records import overview
from scenes.records.record import Cell, Record
from worm3d.values.variable import Variable

if TYPE_CHECKING:
    from PIL.Image import Image

VARIABLE = ("worm", "friction", "ground", "gait")
"""Sections whose numbers may be varied; all cases share the time steps."""


class Study(Section):
    """Number that is varied, and its values."""

    vary: str = setting("worm.segments", title="the number that is varied, such as gait.period_s", aka=("key",))
    values: Numbers = quantity((3, 4, 5, 6, 7), title="its value in each case, in place of the scene's own")


class StudyScene(LinkageSettings):
    """A whole scene."""

    model: Literal["planar_study"] = setting(title="which simulation the scene is for")
    study: Study = Study()

    @property
    def steps(self) -> int:
        """Number of time steps of all cases."""
        return self.run.steps * len(self.study.values)

    def case(self, value: float) -> LinkageScene:
        """Return the scene of one case."""
        sections = self.model_dump(include={"run", *VARIABLE}, exclude_none=True)
        return LinkageScene.model_validate(case_data(sections, self.study.vary, value))


def case_data(sections: Mapping[str, Any], vary: str, value: float) -> dict[str, Any]:
    """Return the scene of one case as data."""
    section, key = vary.split(".")
    field = field_at(LinkageScene, (section, key))
    assert field is not None
    number = int(value) if field.annotation is int and float(value).is_integer() else value
    return {"model": "planar_linkage", **sections, section: {**sections[section], key: number}}


def _is_a_number(vary: str) -> str | None:
    path = tuple(vary.split("."))
    field = field_at(LinkageScene, path) if len(path) == 2 and path[0] in VARIABLE else None
    if field is not None and is_number(field):
        return None
    return f"got '{vary}': must be a number of {', '.join(VARIABLE)}, such as worm.segments or gait.period_s"


def _cases_are_right(values: tuple[float, ...], vary: str, *sections: Mapping[str, Any]) -> str | None:
    data = dict(zip(("run", *VARIABLE), sections, strict=True))
    return next((text for value in values for text in _case_mistakes(data, vary, value)), None)


def _case_mistakes(sections: Mapping[str, Any], vary: str, value: float) -> Iterator[str]:
    case = case_data(sections, vary, value)
    found = schema_mistakes(LinkageScene, case)
    for mistake in (*found, *cross_mistakes(RULES, LinkageScene, case, found)):
        yield f"with {vary} = {value:g}: {dotted(mistake.path)}: {mistake.text}"


def _fits_into_memory(dt_s: float, duration_s: float, values: tuple[float, ...], vary: str, segments: int) -> Found:
    numbers = [int(value) for value in values] if vary == "worm.segments" else [segments] * len(values)
    steps = duration_s / dt_s
    needed = sum(steps * bytes_per_step(number) for number in numbers)
    return too_much_memory(needed, steps * len(numbers), max(numbers))


CHECKS = (
    *RUN_CHECKS,
    Check(("run.dt_s", "run.duration_s", "study.values", "study.vary", "worm.segments"), _fits_into_memory),
    Check(("study.vary",), _is_a_number),
    Check(("study.values", "study.vary", "run", *VARIABLE), _cases_are_right),
)

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
    """One case of a study."""

    value: float
    """Value of the number that is varied."""
    run: linkage.Run | None
    """Run of the case; None if it was refused or not run."""
    figures: dict[str, float | None]
    """Figures of `MERITS`; all None unless the case came to its end."""
    why: dict[str, str]
    """Why a figure has no value."""
    sentence: str
    """How the case ended."""

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


def _overview(record: Record) -> Image:
    panels = {"distance [m]": record["distance"], "work / (weight x distance)": record["cost_of_transport"]}
    return overview.of_cases(record, varied(record), panels)


COLUMNS = {
    "distance [m]": "distance_m",
    "work [J]": "work_contract_J",
    "cost of transport": "cost_of_transport",
    "speed [BL/period]": "speed_BL_per_period",
}


def _table(record: Record) -> list[str]:
    """Return the cases, a line each, and why a figure has no value."""
    vary, rows = varied(record), record.summary["cases"]
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
    figures=pictures(
        "scenes.models.planar.figures",
        centre_of_mass_by_case="study_com",
        cumulative_cost_by_case="study_cumulative_cost",
        cost_of_transport_by_case="study_cost",
        distance_and_speed_by_case="study_distance",
    ),
    overview=_overview,
    animate=animate,
    advice=ADVICE,
    table=_table,
)
