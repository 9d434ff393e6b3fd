"""The first scene: the paper's row for six segments, and what its record and summary say."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import GAITS
from planar import published
from scenes.language.parts import key_of
from scenes.language.schema import keys_in
from scenes.models.loading import load_scene
from scenes.models.planar.published import PUBLISHED_MODEL, PublishedGait, PublishedScene, gait_of, parameters_of
from scenes.records.record import Record
from scenes.running.runner import simulate
from worm3d.values.parameters import Parameter
from worm3d.values.parameters import parameters_of as declared_in
from worm3d.values.period_means import path_length

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
    assert list(summary.metrics)[: len(FIGURES)] == FIGURES
    assert summary["status"] == "done"
    assert_allclose(summary["distance_m"], paper_run["com"][-1, 0] - paper_run["com"][0, 0])
    assert_allclose(summary["work_contract_J"], paper_run["work_contract"].sum())
    assert_allclose(summary["mean_speed_m_s"], 1.250650 / 10.0, rtol=0.03)
    assert summary["cost_of_transport"] is None
    assert summary.reasons["cost_of_transport"] == (
        f"the net work of the contraction is negative ({summary['work_contract_J']:.4g} J): the integrator, whose "
        "numerical loss is negative here, and the snaps to the ground supply that energy"
    )
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
    assert summary.reasons["cost_of_transport"] == "the worm did not move forward (0 m)"
    assert summary.reasons["mean_speed_m_s"].startswith("the run is shorter than one period of the gait")


WAVE = {
    "run.dt_s": "0.008", "worm.segments": 5, "worm.length_m": 1.1, "worm.spring_N": 14, "worm.link_N": 9e3,
    "worm.mass_kg": 2e-8, "worm.connector_mass_kg": 1e-9, "friction.forward": 0.05, "friction.backward": 0.1,
    "friction.gravity_m_s2": 5, "friction.velocity_threshold_m_s": 0.05, "gait.kind": "segment_driven",
    "gait.wavelength_m": 0.7, "gait.force_N": 9, "ground.clearance_m": 0.01, "solver.tolerance_N": 1e-3,
    "solver.max_iterations": 2, "solver.elastic_sign": 1,
}  # fmt: skip


TIMED = [kind for kind in GAITS if not getattr(GAITS[kind](), "senses", ())]
"""Gaits that are functions of time; the program has nothing to sense."""
STEERING = ("steering_wavelength", "bias_phase_deg", "hinge_phase_deg", "lead_s", "bend", "first")
FEEDBACK = ("feedback", "strain_gain", "strain_threshold", "load_gain", "load_threshold_N")
IDLE = {f"gait.{key}" for key in (*STEERING, *FEEDBACK, "pace_exponent")}
"""Keys of gaits that are of no use in a program that has one side and senses nothing, or at the default period."""
OTHERS = {"gait.nodes": "4", "gait.relaxed": "-0.5", "gait.steepness": "2.0"}
"""Values of keys of which the next to the default is refused."""


def gait_keys(kind: str) -> dict[str, str]:
    """Return each key that this kind of gait has, with a value that is not its default."""
    names = {key_of(known): known for known in declared_in(GAITS[kind]).values()}
    own = {key: each for key, each in keys_in(PublishedGait).items() if each.is_for(kind)}
    usual = {key: each.defaults_by_kind.get(kind, each.default) for key, each in own.items()}
    values = {f"gait.{key}": changed(names[key], usual[key]) for key in own if key in names}
    return {key: OTHERS.get(key, value) for key, value in values.items() if key not in IDLE}


def changed(known: Parameter, default: Any) -> str:
    """Return another value of a parameter than its default in a scene, as an override has it."""
    if known.choices:
        return known.choices[known.choices.index(default) - 1]
    if isinstance(default, bool):
        return str(not default).lower()
    if isinstance(default, list | tuple):
        return str([0.8 * each for each in default])
    return str(default + 1 if isinstance(default, int) else 0.8 * default or 0.1)


LENGTH = "run.duration_s=0.8"


def nodes(*overrides: str) -> np.ndarray:
    record = simulate(load_scene("planar_published", [LENGTH, *overrides]))
    return np.concatenate([record[name][:80].ravel() for name in ("main_node", "top_node", "bottom_node")])


@pytest.fixture(scope="module")
def references() -> dict[str, np.ndarray]:
    return {kind: nodes(f"gait.kind={kind}") for kind in TIMED}


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        *(("travelling_wave", key, value) for key, value in WAVE.items()),
        *((kind, key, value) for kind in TIMED for key, value in gait_keys(kind).items()),
    ],
)
def test_every_key_of_a_scene_changes_the_run(references, kind: str, key: str, value: object) -> None:
    overrides = [f"gait.kind={kind}", f"{key}={value}"]
    assert not np.array_equal(nodes(*overrides), references[kind])


def test_every_key_is_among_those_tested() -> None:
    """Except what does not change the motion."""
    sections = ("run", "worm", "friction", "gait", "ground", "solver")
    scene = PublishedScene(model="planar_published")
    keys = {f"{section}.{key}" for section in sections for key, _ in getattr(scene, section)}
    of_sensing = (
        set().union(*(gait_keys(kind) for kind in GAITS if kind not in TIMED)).difference(*map(gait_keys, TIMED))
    )
    assert keys - {"run.duration_s", "run.record_every"} - IDLE - of_sensing == set(WAVE).union(*map(gait_keys, TIMED))


def test_the_dirac_pulse_lasts_one_time_step() -> None:
    overrides = ["gait.kind=segment_driven", "gait.pulse=dirac", "run.dt_s=0.02"]
    gait = gait_of(load_scene("planar_published", overrides).settings)  # type: ignore[arg-type]
    assert gait.impulse == 0.02  # type: ignore[attr-defined]


def test_signs_and_values_of_the_summary(paper_run: Record) -> None:
    run = published.simulate()
    summary = paper_run.summary
    assert_allclose(summary["work_friction_J"], run.work_friction.sum())
    assert summary["work_friction_J"] < 0.0  # the friction takes energy from the worm
    assert_allclose(summary["work_contract_positive_J"], run.work_contract[run.work_contract > 0].sum())
    assert_allclose(summary["work_contract_p11_J"], run.work_contract_p11.sum())
    assert summary["work_contract_p11_J"] != summary["work_contract_J"]
    assert_allclose(summary["newton_iterations_mean"], run.newton_iterations.mean())
    assert_allclose(summary["path_length_m"], path_length(run.com[:, :1], run.time, 2.0))
    first, last = run.com[:200, 0].mean(), run.com[-200:, 0].mean()
    assert_allclose(summary["mean_speed_m_s"], (last - first) / 8.01)
    assert_allclose(summary["path_length_m"], summary["distance_m"], rtol=1e-4)  # averaged, it only goes on
    assert summary["unconverged_steps"] == run.unconverged_steps
    assert summary["inverted_steps"] == run.inverted_steps


def test_the_cost_of_transport_counts_the_weight() -> None:
    """With g of the scene, not 9.81; the mechanical sign, by which the contraction does positive work."""
    overrides = [LENGTH, "solver.elastic_sign=1", "friction.gravity_m_s2=5", "worm.mass_kg=2e-8"]
    summary = simulate(load_scene("planar_published", overrides)).summary
    assert_allclose(
        summary["cost_of_transport"], summary["work_contract_J"] / (2e-8 * 5.0 * summary["distance_m"]), rtol=1e-12
    )


def test_the_figures_draw_the_record(paper_run: Record) -> None:
    draw = {name: figure(paper_run)[1] for name, figure in PUBLISHED_MODEL.figures.items()}
    com = [line.get_ydata() for line in draw["centre_of_mass"].lines]
    assert_allclose(com[0], paper_run["com"][:, 0] - paper_run["com"][0, 0])
    assert_allclose(com[1], paper_run["reported_com"] - paper_run["reported_com"][0])
    assert draw["centre_of_mass"].get_title() == "The paper's worm: centre of mass"
    (cost,) = draw["cumulative_cost_of_transport"].lines
    assert_array_equal(cost.get_xdata(), paper_run["step_time"])
    assert_array_equal(cost.get_ydata(), paper_run["cumulative_cot"])
    peak = np.abs(paper_run["activation"]).max()
    for number, line in enumerate(draw["activation"].lines):
        assert_allclose(line.get_ydata(), number + 0.45 * paper_run["activation"][:, number] / peak)


def test_the_movie_has_its_ground_where_the_program_has_it(paper_run: Record) -> None:
    assert_allclose(paper_run["ground"], -np.sqrt(3.0) / 4.0 / 6.0 - 0.02, rtol=1e-12)
    movie = PUBLISHED_MODEL.animate(paper_run)
    (ground,) = movie.figure.axes[0].patches  # type: ignore[attr-defined]
    assert_allclose(ground.get_y() + ground.get_height(), paper_run["ground"])
    assert_array_equal(movie.corners[:, :, 1], paper_run["top_node"])  # type: ignore[attr-defined]
    assert_array_equal(movie.activation[0], paper_run["activation"][0])  # type: ignore[attr-defined]
