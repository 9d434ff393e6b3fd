"""The first scene: the paper's row for six segments, and what its record and summary say."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planar import published
from scenes.kinds.planar_published import gait_of, parameters_of
from scenes.kinds.planar_published_schema import PublishedScene
from scenes.loader import load_scene
from scenes.record import Record
from scenes.runner import simulate

FIGURES = [
    "status", "duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J",
    "work_friction_J", "cost_of_transport", "energy_balance_error", "newton_iterations_mean",
]  # fmt: skip


@pytest.fixture(scope="module")
def paper_run() -> Record:
    return simulate(load_scene("planar_published"))


def test_the_papers_row(paper_run: Record) -> None:
    summary = paper_run.summary
    assert_allclose(summary["reported_distance_m"], 0.739210, rtol=0, atol=1.5e-6)
    assert_allclose(summary["reported_work_J"], 4.547915, rtol=0, atol=1.5e-6)
    assert_allclose(summary["reported_total_cot_J_per_m"], 6.1524, rtol=0, atol=1e-4)
    assert_allclose(summary["true_displacement_m"], 1.250650, rtol=0, atol=1.5e-6)
    assert summary["unconverged_steps"] == 0


def test_the_summary_has_the_agreed_figures(paper_run: Record) -> None:
    summary = paper_run.summary
    assert list(summary.figures)[: len(FIGURES)] == FIGURES
    assert summary["status"] == "done"
    assert_allclose(summary["distance_m"], paper_run["com"][-1, 0] - paper_run["com"][0, 0])
    assert_allclose(summary["work_contract_J"], paper_run["work_contract"].sum())
    assert_allclose(summary["mean_speed_m_s"], 1.250650 / 10.0, rtol=0.03)
    assert summary["cost_of_transport"] is None
    assert summary.reasons["cost_of_transport"].startswith("the net work of the contraction is negative (-0.8994 J)")
    assert float(summary["energy_balance_error"] or 0.0) < 1e-12


def test_the_record_is_laid_out_as_its_names_say(paper_run: Record) -> None:
    assert paper_run.sizes == {"time": 1001, "joint": 7, "axis": 2, "segment": 6, "step": 1000}
    assert_array_equal(paper_run["time"][1:], paper_run["step_time"])
    assert (paper_run["top_node"][..., 1] > 0).all()
    assert (paper_run["bottom_node"][..., 1] < 0).all()
    assert_array_equal(paper_run["main_node"][..., 1], 0.0)
    assert (np.diff(paper_run["main_node"][..., 0], axis=1) > 0).all()  # tail first
    assert paper_run["bottom_node"][..., 1].min() >= paper_run["ground"] - 1e-12


def test_a_scene_without_keys_is_the_program() -> None:
    scene = PublishedScene(model="planar_published")
    program, ours = published.Parameters(), parameters_of(scene)
    assert {f.name: getattr(ours, f.name) for f in fields(ours)} == {
        f.name: getattr(program, f.name) for f in fields(program)
    }
    wave = published.travelling_wave(6, 2.0, program)
    for t in (0.0, 0.37, 1.9):
        assert_allclose(gait_of(scene).activation(t, 6), wave(t), atol=1e-15)


def test_the_wave_is_as_long_as_the_scene_says_whatever_the_worms_length() -> None:
    scene = load_scene("planar_published", ["worm.length_m=2", "gait.wavelength_m=0.5"]).settings
    assert isinstance(scene, PublishedScene)
    expected = published.travelling_wave(6, 2.0, parameters_of(scene))
    assert_allclose(gait_of(scene).activation(0.3, 6), expected(0.3), atol=1e-13)


def test_directions_are_told_apart() -> None:
    direct, back = (
        simulate(load_scene("planar_published", ["run.duration_s=2", f"gait.direction={direction}"]))
        for direction in ("direct", "retrograde")
    )
    first_peak = [np.argmax(record["activation"][:, 2:5], axis=0) for record in (direct, back)]
    assert (np.diff(first_peak[0]) > 0).all()
    assert (np.diff(first_peak[1]) < 0).all()


def test_the_segment_driven_gait_reaches_the_program() -> None:
    overrides = ["gait.kind=segment_driven", "gait.pulse=dirac", "run.duration_s=2", "gait.contract_time_s=0.3"]
    activation = simulate(load_scene("planar_published", overrides))["activation"]
    assert_array_equal((activation != 0).sum(axis=0), 1)  # each segment once in a period, for one step
    assert_array_equal(activation.sum(axis=0), [1, -1, 1, -1, 1, -1])


def test_record_every_thins_the_states_but_not_the_figures() -> None:
    every, tenth = (
        simulate(load_scene("planar_published", ["run.duration_s=0.5", "gait.period_s=0.2", f"run.record_every={n}"]))
        for n in (1, 10)
    )
    assert tenth.sizes["time"] == 6
    assert tenth.sizes["step"] == 50
    assert_array_equal(tenth["com"], every["com"][::10])
    assert tenth.summary == every.summary


def test_without_friction_or_weight_there_is_a_reason() -> None:
    overrides = ["run.duration_s=0.5", "friction.gravity_m_s2=0", "gait.force_N=0"]
    summary = simulate(load_scene("planar_published", overrides)).summary
    assert summary.reasons["cost_of_transport"] == "the worm made no way forward (0 m)"
    assert summary.reasons["mean_speed_m_s"].startswith("the run is shorter than one period of the gait")
