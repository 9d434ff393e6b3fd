"""Studies: what they say follows from the figures of their cases, and the shipped ones are right and possible."""

from __future__ import annotations

import csv
import re
import tomllib
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

from scenes.language.errors import SceneError
from scenes.models.loading import Scene, parse_scene
from scenes.studies.study.command import shipped_studies, with_accuracy
from scenes.studies.study.figure import draw
from scenes.studies.study.lessons import answers, lessons
from scenes.studies.study.report import document, numbers, together
from scenes.studies.study.study import IMAGE, Grid
from scenes.sweep.case_file import CaseResult
from scenes.sweep.plan import Source, planned
from scenes.sweep.table import Table

STUDY = """
model = "worm"
title = "Tried"
[gait]
period_s = 2.0
[sweep]
vary = { "worm.segments" = [4, 5, 6], "gait.period_s" = [1.0, 2.0, 4.0] }
[sweep.choices.body]
thin = {}
thick = { "worm.half_height_m" = 0.08 }
[study]
question = "More?"
held = "the rest"
measures = { speed_bl_s = "more", cost_of_transport = "less" }
yes = { cost_of_transport = "falls" }
by = "gait.period_s"
equal = { speed_bl_s = 0.3 }
marked = { "it tips" = "= roll_margin_deg < 0" }
"""


def grid(
    speed: Callable[[int, float, str], float],
    cost: Callable[[int, float, str], float | None],
    text: str = STUDY,
    off: float | None = None,
) -> Grid:
    scene: Scene = parse_scene(text, "tried")
    plan = planned(Source(text, "tried"))
    results = []
    for number, case in enumerate(plan.cases):
        n, period, body = (case.values[key] for key in ("worm.segments", "gait.period_s", "body"))
        figures = {"speed_bl_s": speed(n, period, body), "cost_of_transport": cost(n, period, body)}
        figures["roll_margin_deg"] = 5.5 - n if body == "thin" else 1.0
        errors = {} if off is None else {name: off for name, value in figures.items() if value is not None}
        results.append(CaseResult(str(number), "tried", "worm", "done", "ran", number, summary=figures, errors=errors))
    return Grid(scene, Table.of(plan.design, results))


def test_figures_stand_along_their_axes_at_the_scenes_own_value() -> None:
    tried = grid(lambda n, period, body: n / period, lambda n, period, body: float(body == "thick"))
    assert (tried.x.words, tried.curves, tried.own) == ("segments", ["thin", "thick"], "period 2 s")
    assert_allclose(tried.values("speed_bl_s"), [[2, 2], [2.5, 2.5], [3, 3]])
    assert_allclose(tried.values("cost_of_transport"), [[0, 1]] * 3)


def test_costs_at_equal_speed_lie_on_straight_lines_and_the_best_counts() -> None:
    tried = grid(
        lambda n, period, body: 0.1 * period if body == "thin" else 0.2, lambda n, period, body: 2.0 * n * period
    )
    equal, off = tried.equal_values("cost_of_transport", "speed_bl_s", 0.3)
    assert_allclose(equal[:, 0], [24.0, 30.0, 36.0])
    assert np.isnan(equal[:, 1]).all()
    assert np.isnan(off).all()
    twice = grid(lambda n, period, body: abs(period - 2.0), lambda n, period, body: period)
    assert_allclose(twice.equal_values("cost_of_transport", "speed_bl_s", 0.5)[0][0], 1.5)


def test_the_error_at_equal_speed_bounds_what_errors_of_cost_and_speed_do() -> None:
    def cost(n: int, period: float, body: str) -> float:
        return n * period**2

    def speed(n: int, period: float, body: str) -> float:
        return 0.1 * period

    value, off = grid(speed, cost, off=0.001).equal_values("cost_of_transport", "speed_bl_s", 0.3)
    moved = [
        grid(lambda *at, s=s: speed(*at) + s, lambda *at, c=c: cost(*at) + c)
        for s in (-0.001, 0.001)
        for c in (-0.001, 0.001)
    ]
    others = [each.equal_values("cost_of_transport", "speed_bl_s", 0.3)[0] for each in moved]
    most = np.max(np.abs(np.array(others) - value), axis=0)
    assert (most <= off * (1.0 + 1e-9)).all()
    assert (off <= 4.0 / 3.0 * most).all()


def test_the_answer_turns_with_the_numbers() -> None:
    falling = list(answers(grid(lambda *at: 0.1, lambda n, period, body: 1.0 / n)))
    rising = list(answers(grid(lambda *at: 0.1, lambda n, period, body: 1.0 * n)))
    dipping = list(answers(grid(lambda *at: 0.1, lambda n, period, body: abs(n - 5.0) + 1.0)))
    assert [a.split(" (")[0] for a in (falling[1], rising[1], dipping[1])] == ["Yes", "No", "Up to a point"]
    assert falling[1] == (
        "Yes (thick; period 2 s): the cost of transport falls with the segments, from 0.25 at 4 to 0.167 at 6 "
        "(the range ends there) (-33%)."
    )
    assert "to 0.2 at 5 (the values end there)" in falling[0]  # at 6 it tips
    assert falling[2].startswith("Not known (thin; at equal speed of 0.3 BL/s, by the period)")


def test_lessons_name_who_is_ahead_and_what_is_marked() -> None:
    told = list(
        lessons(grid(lambda n, period, body: n * (2.0 if body == "thin" else 1.0), lambda n, period, body: None))
    )
    assert "By speed (period 2 s), 'thin' is ahead at 4 to 5; best of all is 10 BL/s at 5 with 'thin'." in told
    assert "The errors of the speed and cost of transport that the time steps cause are not known." in told
    assert "In 1 of 6 cases, it tips: at segments 6 (thin). These cases cannot be best." in told


def test_the_report_has_question_sentences_figure_and_table(tmp_path: Path) -> None:
    tried = grid(lambda n, period, body: n / period, lambda n, period, body: period / n)
    text = document(tried)
    assert "±" not in text
    for part in (
        "# Tried",
        "More?",
        "Held constant: the rest.",
        "With period 2 s:",
        "![tried](study.png)",
        "| 6 | thick | 3 | 0.333 |",
    ):
        assert part in text
    assert "## More?" in together({"tried": tried})
    draw(tried).savefig(tmp_path / "a.png")
    colours = Image.open(tmp_path / "a.png").convert("RGB").getcolors(1 << 20)
    assert colours is not None
    assert {(31, 119, 180), (255, 127, 14)} <= {colour for _, colour in colours}  # a curve for each body


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("speed_bl_s =", "sped_bl_s ="), "no case has a figure 'sped_bl_s'; did you mean 'speed_bl_s'?"),
        (('by = "gait.period_s"', 'by = "gait.period"'), "study.by: got 'gait.period', must be one of the varied keys"),
        (('by = "gait.period_s"', ""), "a study is a grid over one or two keys"),
    ],
)
def test_mistakes(change: tuple[str, str], complaint: str) -> None:
    with pytest.raises(SceneError) as error:
        document(grid(lambda *at: 1.0, lambda *at: 1.0, STUDY.replace(*change)))
    assert complaint in str(error.value)


@pytest.mark.parametrize("name", shipped_studies())
def test_shipped_studies_can_be_and_say_what_they_ask(name: str) -> None:
    plan = planned(Source.of(shipped_studies()[name]))
    assert not [case.refused for case in plan.cases if case.refused]
    assert len({case.key for case in plan.cases}) == len(plan.cases)
    assert all((plan.base.study["question"], plan.base.study["held"], plan.base.settings.title))


def test_the_command_lists_and_runs_studies(worm3d, tmp_path: Path) -> None:
    listed = worm3d("study")
    programs = ["paper", "validate", "technologies", "identify", "control", "gait"]
    assert [line.split("  ")[0] for line in listed.out.splitlines()] == [*shipped_studies(), *programs]
    short = ("-o", 'sweep.vary={"gait.wavelength"=[0.4,0.5,1.0]}', "-o", "sweep.set={}", "-o", "study.by=''")
    ended = worm3d("study", "wavelength", *short, "-o", "run.duration_s=10", "--out", "few")
    assert ended.code == 0, ended.err
    rises = (
        r"period 2 s: the speed rises with the wavelength, from 0.010\d+ ± 0.00\d+ BL/s at 0.5 body lengths to 0.050"
    )
    assert re.search(rises, ended.out)
    assert f"In 1 of 3 cases, {IMAGE}: at wavelength 0.4 body lengths." in ended.out
    assert {"study.md", "study.png", "study.csv", "sweep.csv"} <= {path.name for path in (tmp_path / "few").iterdir()}
    rows = list(csv.DictReader((tmp_path / "few" / "study.csv").read_text().splitlines()))
    assert [row["marked"] for row in rows] == [IMAGE, "", ""]
    assert all(0.0 < float(row["speed_bl_s_off"]) < 0.01 * float(row["speed_bl_s"]) for row in rows[1:])
    assert worm3d("study", "flat", "--all").complaints == [
        "study: --all runs all studies without changes; leave out the name and -o"
    ]


def test_a_map_hatches_what_is_marked_and_the_best_is_looked_for_elsewhere(tmp_path: Path) -> None:
    text = """
model = "worm"
[sweep]
vary = { "gait.amplitude" = [0.1, 0.2, 0.3], "gait.wavelength" = [0.5, 0.7, 1.0, 1.5, 2.0, 3.0] }
[study]
measures = { speed_bl_s = "more" }
marked = { "it tips" = "= roll_margin_deg < 0" }
"""
    plan = planned(Source(text, "map"))
    results = []
    for number, case in enumerate(plan.cases):
        amplitude, wavelength = case.values["gait.amplitude"], case.values["gait.wavelength"]
        figures = {"speed_bl_s": amplitude * wavelength, "roll_margin_deg": 10.0 - 40.0 * amplitude}
        results.append(CaseResult(str(number), "map", "worm", "done", "ran", number, summary=figures))
    tried = Grid(parse_scene(text, "map"), Table.of(plan.design, results))
    assert tried.is_map
    told = list(lessons(tried))
    assert any(line.startswith("In 6 of 18 cases, it tips: at amplitude 0.3 (every wavelength).") for line in told)
    best = "By speed (period 2 s), 'wavelength 3 body lengths' is ahead at 0.1 to 0.2; best of all is 0.6 BL/s at 0.2"
    assert any(line.startswith(best) for line in told)
    axes = draw(tried).axes[0]
    hatched = [mesh for mesh in axes.collections if mesh.get_hatch()]
    assert len(hatched) == 1
    assert np.ma.count(hatched[0].get_array()) == 6


def test_a_lead_within_the_errors_is_a_tie() -> None:
    def speed(n: int, period: float, body: str) -> float:
        return n + (0.1 if body == "thick" else 0.0)

    def cost(n: int, period: float, body: str) -> float:
        return 1.0 + 0.1 * n

    text = STUDY.replace("marked = ", "# ")
    ahead = list(lessons(grid(speed, cost, text, off=0.01)))
    assert any("By speed (period 2 s), 'thick' is ahead at every segments; best" in line for line in ahead)
    tied = list(lessons(grid(speed, cost, text, off=0.06)))
    assert any("'thin' is level with others at every segments; best" in line for line in tied)
    each = next(line for line in tied if " of each: " in line)
    assert each.endswith("'=' joins cases whose values differ by no more than their errors.")
    best = "6.10 ± 0.06 BL/s at 6 with 'thick', level with 6 with 'thin'; the range of the segments ends there"
    assert any(best in line for line in tied)
    near = grid(lambda n, period, body: 5.0 + 0.02 * (n == 5), cost, text, off=0.03)
    level = next(line for line in lessons(near) if line.startswith("By speed (period 2 s)"))
    assert "level with 4 with 'thin', 4 with 'thick', 5 with 'thick' and 2 more" in level


def test_numbers_stand_with_their_errors(tmp_path: Path) -> None:
    tried = grid(lambda n, period, body: n / period, lambda n, period, body: period / n, off=0.004)
    assert "| 6 | thick | 3.000 ± 0.004 | 0.333 ± 0.004 |  |" in document(tried)
    rows = list(csv.DictReader(numbers(tried).decode().splitlines()))
    assert len(rows) == 18
    assert {row["speed_bl_s_off"] for row in rows} == {"0.004"}
    assert [row["marked"] for row in rows].count("it tips") == 3


def test_a_best_place_is_told_for_the_other_values_of_by_too() -> None:
    told = list(lessons(grid(lambda n, period, body: n * (3.0 - period), lambda *at: 1.0, off=0.003)))
    elsewhere = next(line for line in told if line.startswith("By speed elsewhere"))
    assert "at period 1 s best of all is 12.000 ± 0.003 BL/s at 6 with 'thick'; the range" in elsewhere
    assert "at period 4 s best of all is -4.000 ± 0.003 BL/s at 4 with 'thin', level with 4" in elsewhere


def test_cases_without_an_error_are_no_best_ones_where_others_have_one() -> None:
    tried = grid(lambda n, period, body: float(n), lambda *at: 1.0, off=0.01)
    tried.table.errors["speed_bl_s"][-9:] = np.nan  # the cases of 6 segments, and half of those of 5
    told = list(lessons(tried))
    assert any(line.startswith("The error of the speed (period 2 s) is not known in ") for line in told)
    assert not any("6.00" in line for line in told if line.startswith("By speed"))


@pytest.mark.parametrize(("wavelength", "aliased"), [(0.33, True), (0.4, True), (0.42, False), (1.0, False)])
def test_waves_of_two_segments_or_less_are_marked_and_no_best_ones(wavelength: float, aliased: bool) -> None:
    text = f"""
model = "worm"
[sweep]
vary = {{ "gait.wavelength" = [{wavelength}, 2.0] }}
[sweep.choices.pattern]
wave = {{}}
"in unison" = {{ "gait.kind" = "breathing" }}
[study]
measures = {{ speed_bl_s = "more" }}
"""
    plan = planned(Source(text, "waves"))
    results = []
    for case in plan.cases:
        settings = tomllib.loads(zlib.decompress(case.packed).decode())
        figures = {"speed_bl_s": 1.0 / case.values["gait.wavelength"]}
        results.append(CaseResult(case.key, "waves", "worm", "done", "ran", 0, summary=figures, scene=settings))
    tried = Grid(parse_scene(text, "waves"), Table.of(plan.design, results))
    marked = tried.marked().get(IMAGE, np.zeros((2, 2), dtype=bool))
    assert marked.tolist() == [[aliased, False], [False, False]]
    assert any("wave (0.5 BL/s at 2 body lengths" in line for line in lessons(tried)) == aliased


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("[run]\nduration_s = 2.0", True),
        ("[run]\naccuracy = 0.05", False),
        ("[run]\nintegrator = 'implicit_euler'", False),
        ("[sweep.set]\n'run.accuracy' = '= 0.01 * gait.period_s'", False),
        ("[sweep.choices.steps]\nold = { 'run.integrator' = 'implicit_euler' }\nnew = {}", False),
    ],
)
def test_cases_of_a_study_know_their_errors_unless_the_scene_chooses_the_steps(
    text: str, asked: bool, tmp_path: Path
) -> None:
    path = tmp_path / "own.toml"
    path.write_text(f'model = "worm"\n[sweep]\nvary = {{ "gait.period_s" = [1.0, 2.0] }}\n{text}\n')
    assert ("run.accuracy=0.01" in with_accuracy(path, ())) == asked
    assert with_accuracy(path, ("run.accuracy=0.02",)) == ("run.accuracy=0.02",)


def test_a_model_without_an_accuracy_is_studied_as_it_is() -> None:
    assert not with_accuracy("planar_periods", ())
