"""Studies: each case is the run of its own scene, a case that fails does not spoil the others."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from scenes import models
from scenes.commands import runner
from scenes.commands.runner import simulate
from scenes.language.errors import SceneError
from scenes.models.loading import load_scene, parse_scene
from scenes.models.planar.study import NOT_RUN
from scenes.records import drawing
from scenes.records.record import Record
from scenes.records.store import load, save

BRIEF = ("run.duration_s=0.4", "gait.period_s=0.2")
HEAVY = ("study.vary=worm.mass_kg", "study.values=[0.07, 5.0, 0.08]")
REQUIRED = [
    "status", "duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J",
    "work_friction_J", "cost_of_transport", "energy_balance_error", "newton_iterations_mean",
]  # fmt: skip


def options(*overrides: str) -> list[str]:
    return [part for each in overrides for part in ("-o", each)]


def line_about(*overrides: str) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene("planar_segments", overrides)
    (line,) = caught.value.lines
    return line


@pytest.fixture(scope="module")
def segments() -> Record:
    return simulate(load_scene("planar_segments", BRIEF))


def test_each_case_is_the_run_of_its_scene(segments: Record) -> None:
    for number, n in enumerate((3, 4, 5, 6, 7)):
        alone = simulate(load_scene("planar_wave", [*BRIEF, f"worm.segments={n}"]))
        assert_array_equal(segments["com_x"][number], alone["com"][:, 0])
        assert_array_equal(segments["cumulative_cost"][number], alone["cumulative_cot_contract"])
        row = segments.summary["cases"][number]  # type: ignore[index]
        assert row["worm.segments"] == n
        for name in ("distance_m", "work_contract_J", "cost_of_transport", "speed_BL_per_period"):
            assert row[name] == alone.summary[name]
        assert_array_equal(segments["distance"][number], alone.summary["distance_m"])


def test_the_shipped_studies_say_what_they_find() -> None:
    by_segments, by_period = (simulate(load_scene(name)) for name in ("planar_segments", "planar_periods"))
    assert_allclose(by_segments["distance"], [0.11637, 0.19837, -0.00745, 0.03431, -0.03676], atol=2e-5)
    assert "four segments go furthest, 0.198 m in ten seconds" in load_scene("planar_segments").settings.says
    assert np.isnan(by_segments["cost_of_transport"][[2, 4]]).all()
    assert by_segments.summary["cases"][2]["reason"] == "the worm made no way forward (-0.007448 m)"  # type: ignore[index]
    work, distance, says = by_period["work_contract"], by_period["distance"], load_scene("planar_periods").settings.says
    assert f"falls from {work[0]:.2f} J to {work[-1]:.3f} J" in says
    assert f"the distance from {distance[0]:.3f} m to {distance[-1]:.3f} m" in says


def test_the_summary_has_the_agreed_figures(segments: Record, tmp_path: Path) -> None:
    summary = segments.summary
    assert set(REQUIRED) <= set(summary.metrics)
    assert summary["status"] == "done"
    assert_allclose(summary["duration_s"], 5 * 0.4)
    assert summary["distance_m"] is None
    assert summary.reasons["distance_m"] == "a study has one for each case: see 'cases'"
    assert_allclose(summary["newton_iterations_mean"], segments["newton_iterations"].mean())
    save(segments, tmp_path / "result.nc")
    assert load(tmp_path).summary == summary


def test_a_study_ends_with_its_table(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_segments", *options(*BRIEF), "--out", "x")
    assert ended.code == 0
    assert ended.err == "planar_segments: 200 steps\n"
    first, header, *rows, title, files = ended.out.splitlines()
    assert first.startswith("planar_segments: 5 of 5 cases reached their end (2 s simulated, ")
    assert header.split("  ")[1:3] == ["worm.segments", "distance [m]"]
    assert [row.split()[0] for row in rows] == ["3", "4", "5", "6", "7"]
    assert title.split(maxsplit=1) == ["title", "Distance and cost of transport by number of segments"]
    assert files.split() == ["files", "x"]
    drawn = {path.name for path in (tmp_path / "x").iterdir()}
    assert {"result.nc", "summary.json", "animation.gif", "overview.png"} == drawn


def test_a_refused_case_is_marked_and_the_others_run(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_segments", *options(*BRIEF, *HEAVY), "--out", "x")
    assert ended.code == 5
    said = ended.complaints[-1]
    assert said.startswith("incomplete: 2 of 3 cases reached their end; worm.mass_kg = 5: segment 0 would be pressed ")
    first, light, heavy, heavier = json.loads((tmp_path / "x" / "summary.json").read_text())["cases"], *range(3)
    assert first[heavy]["distance_m"] is None
    assert first[heavy]["reason"].startswith("segment 0 would be pressed flat: it carries ")
    assert first[light]["distance_m"] is not None
    assert first[heavier]["distance_m"] is not None
    record = load(tmp_path / "x")
    assert_array_equal(np.isnan(record["com_x"]).all(axis=1), [False, True, False])
    assert int(record["shown_case"]) == 2


def test_a_diverging_case_keeps_its_curve_but_has_no_figures() -> None:
    study = ("study.vary=gait.amplitude", "study.values=[0.95, 0.2]", "run.duration_s=0.4")
    record = simulate(load_scene("planar_periods", study))
    assert record.status == "incomplete"
    finished = np.isfinite(record["com_x"]).sum(axis=1)
    assert 1 < finished[0] < 41
    assert finished[1] == 41
    assert_array_equal(np.isnan(record["distance"]), [True, False])
    assert "a joint came down to the ground" in record.sentence
    assert "(step " in record.summary["cases"][0]["reason"]  # type: ignore[index]


def test_all_cases_failing_is_3(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_segments", *options("study.vary=worm.mass_kg", "study.values=[5, 6]"), "--out", "x")
    assert ended.code == 3
    assert {path.name for path in (tmp_path / "x").iterdir()} == {"result.nc", "summary.json"}
    assert worm3d("plot", "x").complaints == ["planar_segments: no step was finished, there is nothing to draw"]


def test_a_study_that_fails_half_way_everywhere_can_be_drawn(worm3d, tmp_path: Path) -> None:
    study = options("study.vary=gait.amplitude", "study.values=[0.99, 0.97]")
    assert worm3d("run", "planar_periods", *study, "--out", "x", "--quiet").code == 3
    assert (tmp_path / "x" / "animation.gif").is_file()


def test_ctrl_c_keeps_the_finished_cases(worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def impatient(title: str, steps: int, *, quiet: bool) -> Iterator[Callable[[int], None]]:
        assert steps == 5 * 40
        yield lambda done: os.kill(os.getpid(), signal.SIGINT) if done == 100 else None

    monkeypatch.setattr(runner, "progress", impatient)
    ended = worm3d("run", "planar_segments", *options(*BRIEF), "--out", "x")
    assert ended.code == 130
    assert "2 of 5 cases reached their end" in ended.out
    record = load(tmp_path / "x")
    assert record.status == "interrupted"
    assert_array_equal(np.isfinite(record["distance"]), [True, True, False, False, False])
    assert_array_equal(np.isfinite(record["com_x"]).sum(axis=1), [41, 41, 21, 0, 0])
    reasons = [row["reason"] for row in json.loads((tmp_path / "x" / "summary.json").read_text())["cases"]]
    assert reasons[2].startswith("the run was interrupted")
    assert reasons[3:] == [NOT_RUN, NOT_RUN]
    assert (tmp_path / "x" / "overview.png").is_file()
    whole = simulate(load_scene("planar_segments", BRIEF))
    assert_array_equal(record["com_x"][:2], whole["com_x"][:2])


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (
            ("study.vary=gait.kind",),
            "override study.vary: got 'gait.kind': must be a number of worm, friction, ground, gait, "
            "such as worm.segments or gait.period_s",
        ),
        (
            ("study.vary=run.dt_s",),
            "override study.vary: got 'run.dt_s': must be a number of worm, friction, ground, gait, "
            "such as worm.segments or gait.period_s",
        ),
        (
            ("study.values=[3, 0]",),
            "override study.values: with worm.segments = 0: worm.segments: got 0: input should be greater than or "
            "equal to 1, 1 <= … <= 200 (default 6)",
        ),
        (
            ("study.values=[3.5]",),
            "override study.values: with worm.segments = 3.5: worm.segments: got 3.5: input should be a valid "
            "integer, 1 <= … <= 200 (default 6)",
        ),
        (
            ("worm.spring_N=[1, 2, 3]",),
            "override worm.spring_N: study.values: with worm.segments = 4: worm.spring_N: got a list of 3: must be "
            "one number for all or 4 numbers, one for each of the 4 segments",
        ),
        (
            ("study.values=[]",),
            "override study.values: got []: list should have at least 1 item after validation, not 0 "
            "(default [3, 4, 5, 6, 7])",
        ),
    ],
)
def test_cases_that_make_no_scene_are_told_before_the_study(overrides: tuple[str, ...], line: str) -> None:
    assert line_about(*overrides).removeprefix("line 9: ") == line.removeprefix("override worm.spring_N: ")


def test_a_studys_own_value_of_what_is_varied_does_not_matter() -> None:
    text = 'model = "planar_study"\n[worm]\nmass_kg = 5.0\n[study]\nvary = "worm.mass_kg"\nvalues = [0.1]\n'
    parse_scene(text, "test")


def test_figures_are_pictures_with_labelled_axes(segments: Record, tmp_path: Path) -> None:
    model = models.get("planar_study")
    for path in drawing.plot(segments, model, tmp_path):
        with Image.open(path) as picture:
            assert len(picture.convert("RGB").getcolors(200_000) or []) > 20
    for stem, draw in model.figures.items():
        figure, _ = draw(segments)
        panels = figure.axes
        assert all(axes.get_xlabel() in ("time [s]", "worm.segments") and axes.get_ylabel() for axes in panels), stem
    labels = [text.get_text() for text in model.figures["centre_of_mass_by_case"](segments)[1].get_legend().get_texts()]
    assert labels == [f"worm.segments = {n}" for n in (3, 4, 5, 6, 7)]
