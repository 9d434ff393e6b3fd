"""The corrected worm from a scene: the model's own numbers, what is refused, and what the record holds."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from control import gaits
from planar import linkage
from planar.linkage.ledger import Ledger
from scenes import models
from scenes.language.errors import SceneError
from scenes.language.reading import trusted
from scenes.models.loading import load_scene, parse_scene
from scenes.models.planar.linkage import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from scenes.models.planar.linkage_scene import LinkageScene, gait_of, worm_of
from scenes.records.record import Record
from scenes.records.store import load, save
from scenes.running import drawing
from scenes.running.runner import simulate

REQUIRED = [
    "status", "duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J",
    "work_friction_J", "cost_of_transport", "energy_balance_error", "newton_iterations_mean",
]  # fmt: skip
BRIEF = ("run.duration_s=0.4", "gait.period_s=0.2")

EIGHT = """\
model = "planar_linkage"

[run]
dt_s = 0.5

[worm]
spring_N = [13.0, 13.0, -13.0]
torsion_J = [1e4, 1e4]
k_apex = 0.12
apex_mass_fraction = 1.5

[friction]
law = "anchord"

[gait]
amplitude = 1.0
"""


def lines_about(text: str, *overrides: str) -> list[str]:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, "test", overrides)
    assert caught.value.exit_code == 2
    return list(caught.value.lines)


def linkage_scene(*overrides: str) -> LinkageScene:
    settings = load_scene("planar_wave", overrides).settings
    assert isinstance(settings, LinkageScene)
    return settings


@pytest.fixture(scope="module")
def wave() -> Record:
    """The shipped scene."""
    return simulate(load_scene("planar_wave"))


@pytest.fixture(scope="module")
def brief() -> Record:
    return simulate(load_scene("planar_wave", BRIEF))


@pytest.fixture(scope="module")
def clamped() -> Record:
    return simulate(load_scene("planar_wave", [*BRIEF, "ground.kind=clamped"]))


def test_the_scene_gives_the_models_own_numbers(wave: Record) -> None:
    pattern = gaits.TravellingWave(direction="direct")
    run = linkage.simulate(linkage.Linkage(), lambda t: 0.2 * pattern.activation(t, 6))
    assert_allclose(wave["joint"], run.joints, rtol=0, atol=1e-12)
    assert_allclose(wave.summary["work_contract_J"], run.work_contract)
    assert_allclose(wave.summary["cost_of_transport"], run.cost_of_transport)


def test_the_scene_says_what_it_does(wave: Record) -> None:
    back = simulate(load_scene("planar_wave", ["gait.direction=retrograde"])).summary
    said = load_scene("planar_wave").settings.says
    assert f"{wave.summary['distance_m']:.4f} m in ten seconds" in said
    assert f"{wave.summary['work_contract_J']:.3f} J of work" in said
    assert f"gait.direction=retrograde makes it {back['distance_m']:.3f} m" in said


def test_the_summary(wave: Record) -> None:
    summary = wave.summary
    assert list(summary.metrics)[: len(REQUIRED)] == REQUIRED
    assert all(summary[name] is not None for name in REQUIRED)
    assert_allclose(summary["distance_m"], wave["com"][-1, 0] - wave["com"][0, 0])
    assert_allclose(summary["work_contract_positive_J"], np.maximum(0.0, wave["work_contract"]).sum())
    assert_allclose(summary["work_contract_p11_J"], wave["work_contract_p11"].sum())
    assert summary["work_friction_J"] > 0.0 > summary["work_friction_p13_J"]
    assert_allclose(
        summary["cost_of_transport"], summary["work_contract_J"] / (summary["mass_kg"] * 9.81 * summary["distance_m"])
    )
    assert_allclose(summary["speed_BL_per_period"], 2.0 * summary["mean_speed_m_s"])
    assert summary["energy_balance_error"] < 1e-9
    assert summary["halved_steps"] == (wave["parts"] > 1).sum()
    assert_allclose(summary["cumulative_cot_J_per_m"], wave["cumulative_cot_contract"][-1])


def test_the_ledger_of_the_record_closes(wave: Record) -> None:
    def total(names: dict[str, str]) -> float:
        return sum(float(wave[name].sum()) for name in names)

    assert_allclose(total(SUPPLIED_ENERGY), total(STORED_ENERGY) + total(LOST_ENERGY), rtol=1e-9)
    assert_allclose(wave["residual"], 0.0, atol=1e-9)
    assert {f.name for f in fields(Ledger)} <= {variable.name for variable in wave.variables}


def test_the_record_is_laid_out_as_its_names_say(brief: Record, clamped: Record, tmp_path: Path) -> None:
    assert brief.sizes == {"time": 41, "joint": 7, "axis": 2, "segment": 6, "step": 40, "side": 2}
    assert (np.diff(brief["joint"][..., 0], axis=1) > 0).all()  # tail first
    assert (brief["top_apex"][..., 1] > brief["bottom_apex"][..., 1]).all()
    assert_allclose(np.linalg.norm(np.diff(brief["joint"], axis=1), axis=-1), brief["length"])
    assert_array_equal(brief["normal_load"][..., 1], 0.0)  # top apexes touch nothing
    weight = float(brief.summary["mass_kg"]) * 9.81
    assert_allclose(brief["normal_load"][0].sum(), weight, rtol=1e-6)
    assert_allclose(clamped["joint_load"].sum(axis=1), weight, rtol=1e-6)
    assert clamped["joint_friction"].shape == (40, 7)
    assert "side" not in clamped.sizes
    for record in (brief, clamped):
        save(record, tmp_path / "result.nc")
        assert load(tmp_path).summary == record.summary


def test_record_every_thins_the_states_but_not_the_figures(brief: Record) -> None:
    tenth = simulate(load_scene("planar_wave", [*BRIEF, "run.record_every=10"]))
    assert (tenth.sizes["time"], tenth.sizes["step"]) == (5, 40)
    for name in ("joint", "normal_load", "contraction"):
        assert_array_equal(tenth[name], brief[name][::10])
    assert tenth.summary == brief.summary


def test_a_scene_without_keys_is_the_model() -> None:
    scene = LinkageScene(model="planar_linkage")
    ours, models = worm_of(scene.worm), linkage.Linkage()
    for field in fields(models):
        assert_array_equal(getattr(ours, field.name), getattr(models, field.name))
    wave = gaits.TravellingWave()
    assert_array_equal(gait_of(scene)(0.37), wave.amplitude * wave.activation(0.37, 6))


def test_every_key_reaches_the_model() -> None:
    each = {"segments": 2, "length_m": 2.0, "half_height_m": 0.3, "density_kg_m3": 5.0, "depth_m": 0.2, "mass_kg": 0.3}
    each |= {"apex_mass_fraction": 0.25, "spring_N": 11.0, "torsion_J": 7.0, "cross0": 0.1, "apex_hinge_N_m_rad": 0.2}
    each |= {"kelvin_voigt_time_s": 0.06, "drag_N_s_m": 0.4}
    scene = trusted(LinkageScene, {"model": "planar_linkage", "worm": each})
    assert set(each) == set(dict(scene.worm))
    worm = worm_of(scene.worm)
    expected = linkage.Linkage(2, 2.0, 0.3, 5.0, 0.2, 0.3, 0.25, 11.0, 7.0, 0.1, 0.2, 0.06, 0.4)
    for field in fields(expected):
        assert_array_equal(getattr(worm, field.name), getattr(expected, field.name))


def test_ground_and_friction_reach_the_model() -> None:
    def distance(*overrides: str) -> float:
        return float(simulate(load_scene("planar_wave", ["run.duration_s=2", *overrides])).summary["distance_m"])  # type: ignore[arg-type]

    plain = distance()
    assert distance("ground.kind=clamped") > 3.0 * plain
    assert distance("friction.law=threshold") > 1.2 * plain
    assert distance("ground.slope_deg=30") < -0.5  # slides down towards the tail
    assert distance("friction.forward=0.2", "friction.backward=0.03") < -abs(plain)


def test_lists_reach_the_model_and_a_stiff_segment_hardly_shortens() -> None:
    springs = "worm.spring_N=[13, 13, 13, 13, 13, 1000]"
    scene = linkage_scene(springs, "worm.torsion_J=[1, 2, 3, 4, 5]")
    assert_array_equal(worm_of(scene.worm).k_spring, [13, 13, 13, 13, 13, 1000])
    assert_array_equal(worm_of(scene.worm).k_torsion, [1, 2, 3, 4, 5])
    assert "spring_N = [13.0, 13.0, 13.0, 13.0, 13.0, 1000.0]" in load_scene("planar_wave", [springs]).to_toml()


def test_eight_mistakes_give_eight_lines() -> None:
    assert lines_about(EIGHT, "ground.slope_deg=90") == [
        "line 4: run.dt_s: got 0.5 s, must be at most a 10th of the gait's period, 2 s, or the wave falls between "
        "the steps",
        "line 7: worm.spring_N[2]: got -13.0: input should be greater than 0 [N], 0 < …, a number or one for "
        "each segment (default 13.0)",
        "line 8: worm.torsion_J: got 2 values, must be a number or 5 of them",
        "line 9: worm.k_apex: unknown key; did you mean 'apex_hinge_N_m_rad'?",
        "line 10: worm.apex_mass_fraction: got 1.5: input should be less than or equal to 1, 0 <= … <= 1 (default 0.5)",
        "line 13: friction.law: got 'anchord': input should be 'anchored' or 'threshold'; did you mean 'anchored'? "
        "(default 'anchored')",
        "line 16: gait.amplitude: got 1.0: input should be less than 1, 0 <= … < 1 "
        "(default that of its kind: 0.2 for travelling_wave, two_anchor, 11 others; 0.3 for planned_turn)",
        "override ground.slope_deg: got 90: input should be less than 90 [deg], -90 < … < 90 (default 0.0)",
    ]


@pytest.mark.parametrize("key", ["half_height_m", "spring_N", "apex_hinge_N_m_rad"])
def test_lists_need_a_number_for_each_segment(key: str) -> None:
    assert lines_about(f'model = "planar_linkage"\n[worm]\nsegments = 4\n{key} = [0.1, 0.1]\n') == [
        f"line 4: worm.{key}: got 2 values, must be a number or 4 of them"
    ]
    parse_scene(f'model = "planar_linkage"\n[worm]\nsegments = 2\nmass_kg = 0.01\n{key} = [0.1, 0.1]\n', "test")


def test_a_worm_that_its_weight_would_flatten_is_refused_with_the_limit_point() -> None:
    text = 'model = "planar_linkage"\n[worm]\nmass_kg = 5.0\n'
    (line,) = lines_about(text)
    assert line.startswith("line 3: worm.mass_kg: segment 0 would be pressed flat: it carries ")
    assert "its limit point is " in line
    lightest = float(line.split("lighter than ")[1].split(" kg")[0])
    assert line.endswith(" kg, or spring_N or half_height_m larger")
    parse_scene(text, "test", [f"worm.mass_kg={0.99 * lightest}"])
    assert len(lines_about(text, f"worm.mass_kg={1.01 * lightest}")) == 1
    parse_scene(text, "test", ["ground.kind=clamped"])  # held up by its joints
    parse_scene(text, "test", ["ground.slope_deg=80"])  # the slope takes most of the weight


@pytest.mark.parametrize("overrides", [("gait.rectified=false",), ("gait.kind=segment_driven",)])
def test_a_gait_must_not_stretch_a_segment_beyond_its_links(overrides: tuple[str, ...]) -> None:
    text = 'model = "planar_linkage"\n'
    (line,) = lines_about(text, "gait.amplitude=0.33", *overrides)
    assert line == (
        "override gait.amplitude: got 0.33: the gait lengthens a segment to 0.2217 m, but its links end at 0.2205 m; "
        "keep gait.amplitude below 0.3229, or let the gait only contract"
    )
    parse_scene(text, "test", ["gait.amplitude=0.32", *overrides])
    parse_scene(text, "test", ["gait.amplitude=0.33"])


@pytest.mark.parametrize("override", ["worm.length_m=1e-300", "worm.density_kg_m3=5e-324", "ground.gravity_m_s2=1e300"])
def test_absurd_numbers_are_a_line_and_no_traceback(override: str) -> None:
    assert len(lines_about('model = "planar_linkage"\n', override)) == 1


def test_without_way_forward_or_weight_there_is_a_reason() -> None:
    still = simulate(load_scene("planar_wave", ["run.duration_s=0.1", "gait.amplitude=0"])).summary
    assert still["cost_of_transport"] is None
    assert still.reasons["cost_of_transport"].startswith("the worm did not move forward (")
    assert still.reasons["mean_speed_m_s"].startswith("the run is shorter than one period of the gait")
    back = simulate(load_scene("planar_wave", [*BRIEF, "friction.forward=0.2", "friction.backward=0.03"])).summary
    assert back["cost_of_transport"] is None
    assert f"({back['distance_m']:.4g} m)" in back.reasons["cost_of_transport"]
    weightless = simulate(load_scene("planar_wave", [*BRIEF, "ground.gravity_m_s2=0"])).summary
    assert weightless["cost_of_transport"] is None


def test_a_run_that_fails_keeps_what_it_has_and_says_what_to_try(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_wave", "-o", "gait.amplitude=0.95", "--out", "x", "--quiet")
    assert ended.code == 3
    (line,) = ended.complaints
    assert line.startswith("diverged: a joint came down to the ground, where only apexes can stand; the steps before")
    assert "try a smaller run.dt_s or gait.amplitude" in line
    steps = load(tmp_path / "x").sizes["step"]
    assert 1 <= steps < 100
    assert json.loads((tmp_path / "x" / "summary.json").read_text())["status"] == "diverged"


def test_a_run_that_fails_at_once_has_a_record_too(worm3d, tmp_path: Path) -> None:
    folds = ("worm.torsion_J=0", "worm.mass_kg=1.4", "gait.amplitude=0.6")
    ended = worm3d("run", "planar_wave", *(part for each in folds for part in ("-o", each)), "--out", "x", "--quiet")
    assert ended.code == 3
    assert "folded by 90 degrees" in ended.complaints[0]
    record = load(tmp_path / "x")
    assert (record.sizes["step"], record.sizes["time"]) == (0, 1)
    assert record.summary.reasons["newton_iterations_mean"] == "no step was finished"


def test_every_figure_is_a_picture_with_labelled_axes(brief: Record, clamped: Record, tmp_path: Path) -> None:
    model = models.get("planar_linkage")
    for record in (brief, clamped):
        for path in drawing.plot(record, model, tmp_path):
            with Image.open(path) as picture:
                assert len(picture.convert("RGB").getcolors(200_000) or []) > 20
        for draw in model.figures.values():
            _, axes = draw(record)
            assert axes.get_xlabel() == "time [s]"
            assert axes.get_ylabel()


def test_the_movie_shows_the_worm_on_its_ground(brief: Record, clamped: Record) -> None:
    model = models.get("planar_linkage")
    movie = model.animate(brief)
    assert_array_equal(movie.corners[:, :, 3], brief["bottom_apex"])  # type: ignore[attr-defined]
    assert movie.activation.max() == 1.0  # type: ignore[attr-defined]
    grey, none = (len(model.animate(record).figure.axes[0].patches) for record in (brief, clamped))  # type: ignore[attr-defined]
    assert (grey, none) == (1, 0)
