"""Studies: what they say follows from the figures of their cases, and the shipped ones are right and possible."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

from scenes.language.errors import SceneError
from scenes.models.loading import Scene, parse_scene
from scenes.studies.command import shipped_studies
from scenes.studies.figure import draw
from scenes.studies.lessons import answers, lessons
from scenes.studies.report import document, together
from scenes.studies.study import Grid
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
    speed: Callable[[int, float, str], float], cost: Callable[[int, float, str], float | None], text: str = STUDY
) -> Grid:
    scene: Scene = parse_scene(text, "tried")
    plan = planned(Source(text, "tried"))
    results = []
    for number, case in enumerate(plan.cases):
        n, period, body = (case.values[key] for key in ("worm.segments", "gait.period_s", "body"))
        figures = {"speed_bl_s": speed(n, period, body), "cost_of_transport": cost(n, period, body)}
        figures["roll_margin_deg"] = 5.5 - n if body == "thin" else 1.0
        results.append(CaseResult(str(number), "tried", "worm", "done", "ran", number, summary=figures))
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
    equal = tried.equal_values("cost_of_transport", "speed_bl_s", 0.3, "less")
    assert_allclose(equal[:, 0], [24.0, 30.0, 36.0])
    assert np.isnan(equal[:, 1]).all()
    twice = grid(lambda n, period, body: abs(period - 2.0), lambda n, period, body: period)
    assert_allclose(twice.equal_values("cost_of_transport", "speed_bl_s", 0.5, "less")[0], 1.5)
    assert_allclose(twice.equal_values("cost_of_transport", "speed_bl_s", 0.5, "more")[0], 2.5)


def test_the_answer_turns_with_the_numbers() -> None:
    falling = list(answers(grid(lambda *at: 0.1, lambda n, period, body: 1.0 / n)))
    rising = list(answers(grid(lambda *at: 0.1, lambda n, period, body: 1.0 * n)))
    dipping = list(answers(grid(lambda *at: 0.1, lambda n, period, body: abs(n - 5.0) + 1.0)))
    assert [a.split(" (")[0] for a in (falling[0], rising[0], dipping[0])] == ["Yes", "No", "Up to a point"]
    assert falling[0] == (
        "Yes (thin; period 2 s): the cost of transport falls with the segments, from 0.25 at 4 to 0.167 at 6 (-33%)."
    )
    assert falling[2].startswith("Not known (thin; at equal speed of 0.3 BL/s, by the period)")


def test_lessons_name_who_is_ahead_and_what_is_marked() -> None:
    told = list(
        lessons(grid(lambda n, period, body: n * (2.0 if body == "thin" else 1.0), lambda n, period, body: None))
    )
    assert "By speed (period 2 s), 'thin' is ahead at 4 to 5; best of all is 10 BL/s at 5 with 'thin'." in told
    assert "In 1 of 6 cases, it tips: at segments 6 (thin). The best is looked for among the others." in told


def test_the_report_has_question_sentences_figure_and_table(tmp_path: Path) -> None:
    tried = grid(lambda n, period, body: n / period, lambda n, period, body: period / n)
    text = document(tried)
    for part in ("# Tried", "More?", "Held constant: the rest.", "![tried](study.png)", "| 6 | thick | 3 | 0.333 |"):
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
    assert [line.split("  ")[0] for line in listed.out.splitlines()] == list(shipped_studies())
    short = ("-o", 'sweep.vary={"gait.wavelength"=[0.5,1.0]}', "-o", "sweep.set={}")
    ended = worm3d("study", "wavelength", *short, "--out", "few")
    assert ended.code == 0, ended.err
    assert "The speed rises with the wavelength, from 0.0102 BL/s at 0.5 body lengths to 0.05 BL/s" in ended.out
    assert {"study.md", "study.png", "sweep.csv"} <= {path.name for path in (tmp_path / "few").iterdir()}
    assert worm3d("study", "flat", "--all").complaints == [
        "study: --all runs the studies as they are; leave out the name and -o"
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
    assert any(
        line.startswith("In 6 of 18 cases, it tips: at amplitude 0.3 (wavelength 0.5 body lengths)") for line in told
    )
    best = "By speed, 'wavelength 3 body lengths' is ahead at 0.1 to 0.2; best of all is 0.6 BL/s at 0.2"
    assert any(line.startswith(best) for line in told)
    axes = draw(tried).axes[0]
    hatched = [mesh for mesh in axes.collections if mesh.get_hatch()]
    assert len(hatched) == 1
    assert np.ma.count(hatched[0].get_array()) == 6
