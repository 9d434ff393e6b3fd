"""The 3D worm from a scene: the plant's own numbers, and what the record holds."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass, replace
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import worm3d
from control import gaits
from planar.linkage import Linkage
from scenes import models
from scenes.language.errors import SceneError
from scenes.language.parts import keys_by_parameter
from scenes.language.reading import trusted
from scenes.language.schema import keys_in
from scenes.models.loading import load_scene
from scenes.models.worlds.build import WORLDS, world_of
from scenes.models.worlds.schema import World
from scenes.models.worm import build as worm_build
from scenes.models.worm import view as worm_view
from scenes.models.worm.build import (
    WORM_KEYS,
    force_of,
    friction_of,
    gait_of,
    gravity_of,
    start_of,
    worm_of,
)
from scenes.models.worm.schema import PlanarWorm, PlanarWormScene, Push, WormScene
from scenes.records.record import Record
from scenes.records.store import load, save
from scenes.running import drawing, terminal
from scenes.running.runner import simulate
from worm3d.recorded.energy import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from worm3d.recorded.series import Recorded, Steps, series_of
from worm3d.results import pictures
from worm3d.values.variable import Variable
from worm3d.viewer import Frames

REQUIRED = [
    "status", "duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J",
    "work_friction_J", "cost_of_transport", "energy_balance_error", "newton_iterations_mean",
]  # fmt: skip
BRIEF = ("run.duration_s=0.4", "gait.period_s=0.2")
TURNING = (*BRIEF, "gait.bias=0.5", "gait.hinge_deg=20", "gait.rectified=false", "worm.cross0=0.01")
WEIGHT = 0.1 * 9.81


def worm_scene(*overrides: str) -> WormScene:
    settings = load_scene("flat", overrides).settings
    assert isinstance(settings, WormScene)
    return settings


@pytest.fixture(scope="module")
def flat() -> Record:
    """The shipped scene."""
    return simulate(load_scene("flat"))


@pytest.fixture(scope="module")
def brief() -> Record:
    return simulate(load_scene("flat", BRIEF))


def test_the_scene_gives_the_plants_own_numbers(flat: Record) -> None:
    run = worm3d.simulate(worm3d.Worm(), worm3d.Plane(), worm3d.Friction(), gaits.TravellingWave())
    for variable in run.variables():
        assert_array_equal(flat[variable.name], variable.values)
    for name, figure in run.summary().items():
        if name != "real_time_factor":
            assert flat.summary[name] == figure


def test_every_array_of_a_result_is_in_the_record() -> None:
    arrays = {field.name for field in fields(worm3d.Result) if "Array" in str(field.type)}
    assert arrays - {"gravity", "actuator_states"} <= set(series_of(Recorded) | series_of(Steps))
    assert {field.name for field in fields(worm3d.Energy)} < set(series_of(worm3d.Energy))


def test_python_loads_what_the_command_line_wrote(brief: Record, tmp_path: Path) -> None:
    save(brief, tmp_path / "result.nc")
    found = worm3d.load(tmp_path)
    run = worm3d.simulate(
        worm3d.Worm(), worm3d.Plane(), worm3d.Friction(), gaits.TravellingWave(period=0.2), duration=0.4
    )
    for name in series_of(Recorded) | series_of(Steps):
        assert_array_equal(getattr(found, name), getattr(run, name), err_msg=name)
    assert found.world == run.world
    assert repr(found.worm) == repr(run.worm)
    assert found.summary() | {"real_time_factor": None} == run.summary() | {"real_time_factor": None}
    for name, memory in run.state.memory.items():
        assert_array_equal(found.state.memory[name], memory)


def test_flat_says_what_it_does(flat: Record) -> None:
    said, turned = load_scene("flat").settings.says, simulate(load_scene("flat", ["gait.hinge_deg=30"])).summary
    assert f"crawls {flat.summary['distance_m']:.2f} m in ten seconds, straight ahead" in said
    assert abs(flat.summary["heading_change_deg"]) < 1e-6  # type: ignore[arg-type]
    assert f"gait.hinge_deg=30 turns it by {turned['heading_change_deg']:.0f} degrees" in said


def test_slope_says_what_it_does() -> None:
    said, climbed = load_scene("slope").settings.says, simulate(load_scene("slope"))
    assert f"climbs {climbed.summary['distance_m']:.2f} m in ten seconds up a slope of 0.1 rad" in said
    rise = climbed["com"][-1, 2] - climbed["com"][0, 2]
    assert rise > 0.9 * np.sin(0.1) * float(climbed.summary["distance_m"])  # type: ignore[arg-type]
    assert simulate(load_scene("slope", ["world.slope_deg=10"])).summary["distance_m"] < 0.0  # type: ignore[operator]
    assert simulate(load_scene("slope", ["world.slope_deg=9"])).summary["distance_m"] > 0.0  # type: ignore[operator]


def test_planar_case_is_the_planar_worm_to_a_nanometre() -> None:
    ours, theirs = simulate(load_scene("planar_case")), simulate(load_scene("planar_wave"))
    assert_allclose(ours["joints"][..., [0, 2]], theirs["joint"], rtol=0, atol=1e-9)
    assert_array_equal(ours["joints"][..., 1], 0.0)
    said = load_scene("planar_case").settings.says
    assert f"{ours.summary['distance_m']:.4f} m in ten seconds for {ours.summary['work_contract_J']:.3f} J" in said
    assert_allclose(ours.summary["cost_of_transport"], theirs.summary["cost_of_transport"], rtol=1e-6)


def test_free_fall_falls_lands_and_rests_where_it_landed() -> None:
    record = simulate(load_scene("free_fall"))
    time, height, speed = record["time"], record["com"][:, 2], np.abs(record["joint_velocity"]).max(axis=(1, 2))
    load = record["normal_load"].sum(axis=(1, 2)) + record["joint_load"].sum(axis=1)
    falls = time < 0.2
    assert_array_equal(load[falls], 0.0)
    assert_allclose(height[falls], height[0] - 0.5 * 9.81 * time[falls] ** 2, atol=0.2 * 9.81 * 0.002)
    assert load[np.argmax(load > 0.0)] > WEIGHT  # an impact
    assert speed[time > 0.31].max() < 1e-3
    assert speed[-1] < 1e-7
    assert_allclose(load[-1], WEIGHT, rtol=1e-6)
    assert abs(float(record.summary["distance_m"])) < 1e-9  # type: ignore[arg-type]


def test_the_summary(flat: Record) -> None:
    summary = flat.summary
    assert list(summary.metrics)[: len(REQUIRED)] == REQUIRED
    without = {name for name, figure in summary.metrics.items() if figure is None}
    errors = {"distance_error_m", "heading_error_deg", "work_error_J"}
    loads = {"distance_with_load_m", "cost_of_transport_with_load"}
    spread = {"law_spread_N", "law_spread_share", "law_spread_m"}
    inputs = {"work_input_J", "cost_of_transport_input", "peak_pressure_Pa", "peak_cable_N"}
    assert without == {"turning_radius_bl", *inputs, *errors, *loads, *spread}
    assert "straight" in summary.reasons["turning_radius_bl"]
    assert_allclose(summary["distance_m"], flat["com"][-1, 0] - flat["com"][0, 0])
    assert_allclose(summary["work_friction_J"], flat["friction_loss"].sum())
    assert_allclose(
        summary["cost_of_transport"], summary["work_contract_J"] / (WEIGHT * summary["distance_m"])  # type: ignore[operator]
    )  # fmt: skip
    assert_allclose(summary["speed_BL_per_period"], 2.0 * summary["mean_speed_m_s"])  # type: ignore[operator]


def test_the_ledger_of_the_record_closes(flat: Record) -> None:
    def total(names: tuple[str, ...]) -> float:
        return sum(float(flat[name].sum()) for name in names)

    assert_allclose(total(SUPPLIED_ENERGY), total(STORED_ENERGY) + total(LOST_ENERGY), rtol=1e-9)
    assert_allclose(flat["residual"], 0.0, atol=1e-9)


def test_the_record_is_laid_out_as_its_names_say(brief: Record, tmp_path: Path) -> None:
    sizes = {"time": 41, "step": 40, "joint": 7, "inner_joint": 5, "segment": 6, "chamber": 2, "apex": 6, "point": 8}
    assert brief.sizes == {**sizes, "axis": 3}
    assert (np.diff(brief["joints"][..., 0], axis=1) > 0).all()  # tail first
    assert (brief["points"][:, :, 1, 2] > brief["points"][:, :, 0, 2]).all()  # L-above over L-below
    assert (brief["points"][:, :, 2, 1] > brief["points"][:, :, 5, 1]).all()  # L-outward left of R-outward
    assert_allclose(brief["normal_load"][0].sum() + brief["joint_load"][0].sum(), WEIGHT, rtol=1e-6)
    assert_array_equal(brief["step_time"], brief["time"][1:])
    assert all(variable.units and variable.long_name for variable in (*brief.variables, *brief.checkpoint))
    save(brief, tmp_path / "result.nc")
    assert load(tmp_path).summary == brief.summary


def test_record_every_thins_the_states_but_not_the_steps(brief: Record) -> None:
    tenth = simulate(load_scene("flat", [*BRIEF, "run.record_every=10"]))
    assert (tenth.sizes["time"], tenth.sizes["step"]) == (5, 40)
    for name in ("joints", "normal_load", "contraction"):
        assert_array_equal(tenth[name], brief[name][::10])
    for name in ("work_contract", "friction_loss", "slip"):
        assert_allclose(tenth[name].sum(axis=0), brief[name].sum(axis=0), rtol=1e-9, atol=1e-15)


def test_a_scene_names_its_law_of_friction_with_its_parameters(brief: Record) -> None:
    given = ("friction.law=viscous", "friction.viscosity_s_m=40")
    assert friction_of(worm_scene(*given)).law == worm3d.Viscous(40.0)
    record = simulate(load_scene("flat", [*BRIEF, *given]))
    assert abs(record["com"][-1, 0] - brief["com"][-1, 0]) > 1e-5
    for override, message in (
        (given[1], "only for friction.law = 'viscous'"),
        ("friction.law=mucus", "input should be one of 'coulomb', 'viscous', or module:NAME"),
    ):
        with pytest.raises(SceneError, match=message):
            load_scene("flat", [override])


@pytest.mark.slow
def test_one_segment_has_no_inner_joints(tmp_path: Path) -> None:
    single = ("worm.segments=1", "worm.length_m=0.17", "worm.mass_kg=0.02")
    record = simulate(load_scene("flat", [*BRIEF, *single]))
    assert record["hinge"].shape == (41, 0)
    save(record, tmp_path / "result.nc")
    assert load(tmp_path)["hinge"].shape == (41, 0)
    drawing.plot(record, models.get("worm"), tmp_path)


def test_a_scene_without_keys_is_the_plant() -> None:
    scene = WormScene(model="worm")
    assert_equal_fields(worm_of(scene), worm3d.Worm())
    assert_equal_fields(friction_of(scene), worm3d.Friction())
    assert gait_of(scene) == gaits.TravellingWave()
    assert world_of(scene.world) == worm3d.Plane()
    defaults = {name: given.default for name, given in signature(worm3d.simulate).parameters.items()}
    assert (scene.run.duration_s, scene.run.dt_s) == (defaults["duration"], defaults["dt"])
    assert (scene.run.integrator, scene.run.record_every) == (defaults["integrator"], defaults["record_every"])
    assert_array_equal(gravity_of(scene), defaults["gravity"])
    assert scene.start.settle is defaults["settle_first"]
    planar = PlanarWormScene(model="worm_planar")
    assert_equal_fields(worm_of(planar), worm3d.Worm.planar())
    assert gait_of(planar) == gaits.TravellingWave()


def assert_equal_fields(ours: object, theirs: object) -> None:
    assert type(ours) is type(theirs)
    for field in fields(theirs):  # type: ignore[arg-type]
        mine, other = getattr(ours, field.name), getattr(theirs, field.name)
        if is_dataclass(other):
            assert_equal_fields(mine, other)
        else:
            assert_array_equal(mine, other)


def test_every_key_of_the_worm_reaches_the_plant() -> None:
    each = {"segments": 2, "length_m": 0.5, "mass_kg": 0.2, "joint_mass_fraction": 0.4, "chamber_offset_m": 0.02}
    each |= {"half_height_m": [0.04, 0.06], "spring_N": [14.0, 15.0], "torsion_J": [9.0], "yaw_J": 0.6, "twist_J": 0.7}
    each |= {"cross0": 0.1, "apex_hinge_N_m_rad": [0.1, 0.2], "kelvin_voigt_time_s": 0.06, "drag_N_s_m": 0.4}
    each |= {"actuator_lag_s": 0.2, "stroke": [-0.2, 0.3], "rate_limit_per_s": 5.0}
    each |= {"payload_kg": 0.02, "outward_apexes": False, "end_faces": False}
    scene = trusted(WormScene, {"model": "worm", "worm": each})
    assert set(each) == set(WORM_KEYS.values()) == set(dict(scene.worm))
    assert_equal_fields(
        worm_of(scene), worm3d.Worm(**{parameter: each[key] for parameter, key in WORM_KEYS.items()})  # type: ignore[arg-type]
    )  # fmt: skip


def test_an_actuator_is_found_by_name_and_has_its_parameters_as_keys() -> None:
    scene = worm_scene("actuator.lag_s=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]", "hinge_actuator.lag_s=0.05")
    worm = worm_of(scene)
    assert isinstance(worm.actuator, worm3d.FirstOrder)
    assert_allclose(worm.actuator.lag, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert_allclose(worm.hinge_actuator.lag, 0.05)  # type: ignore[attr-defined]
    with pytest.raises(SceneError, match=r"actuator\.kind: got 'first': input should be one of .*'first_order'"):
        worm_scene("actuator.kind=first")
    with pytest.raises(SceneError, match=r"hinge_actuator\.lag_s: got 2 values, must be a number or 5 of them"):
        worm_scene("hinge_actuator.lag_s=[1, 2]")


def test_every_key_of_the_planar_worm_reaches_the_plant() -> None:
    # Scenes of `planar` have no payload, and the section [segment] describes the segment law.
    of_the_planar_model = set(signature(worm3d.Worm.planar).parameters) - {"payload", "segment"}
    assert set(keys_by_parameter(Linkage, PlanarWorm)) == of_the_planar_model
    scene = load_scene("planar_case", ["worm.segments=2", "worm.half_height_m=[0.1, 0.2]", "worm.density_kg_m3=3"])
    expected = worm3d.Worm.planar(segments=2, half_height=np.array([0.1, 0.2]), density=3.0)
    assert isinstance(scene.settings, PlanarWormScene)
    assert_equal_fields(worm_of(scene.settings), expected)


def test_every_kind_of_world_is_built() -> None:
    assert set(WORLDS) | set(worm3d.WORLDS) == set(keys_in(World)["kind"].choices)
    scene = worm_scene("world.slope_deg=10", "world.heading_deg=-30", "world.patches=[{grip=2, across_m=[-1, 0.5]}]")
    plane = world_of(scene.world)
    assert isinstance(plane, worm3d.Plane)
    assert_allclose([plane.slope, plane.heading], np.deg2rad([10.0, -30.0]))
    assert plane.patches == (worm3d.Patch(2.0, across=(-1.0, 0.5)),)
    clamped = world_of(worm_scene("world.kind=clamped", "world.velocity_threshold_m_s=1e-5").world)
    assert clamped == worm3d.ClampedGround(1e-5)
    assert world_of(worm_scene("world.kind=none").world) is None


def test_the_gait_turns() -> None:
    gait = gait_of(worm_scene("gait.bias=-0.3", "gait.hinge_deg=45", "gait.force_N=0.2", "gait.amplitude=0.1"))
    assert gait == gaits.TravellingWave(amplitude=0.1, bias=-0.3, hinge=np.deg2rad(45.0), force=0.2)
    pulses = gait_of(worm_scene("gait.kind=segment_driven", "gait.bias=0.5", "gait.pulse=dirac", "run.dt_s=0.02"))
    assert isinstance(pulses, gaits.ContractionEngine_segmentdriven)
    assert (pulses.bias, pulses.impulse, pulses.contractType) == (0.5, 0.02, "dirac")


@pytest.mark.parametrize("name", sorted(gaits.GAITS))
def test_every_gait_is_found_by_name(name: str) -> None:
    gait = gait_of(worm_scene(f"gait.kind={name}", "gait.period_s=3"))
    assert type(gait) is gaits.GAITS[name]
    if not isinstance(gait, gaits.FeedbackGait):  # those with memory have noise, or senses
        assert_allclose(gait.activation(3.4, 6), gait.activation(6.4, 6), atol=1e-12)
    assert gaits.Breathing(contracting=0.3, period=3.0) == gait_of(
        worm_scene("gait.kind=breathing", "gait.contracting=0.3", "gait.period_s=3")
    )


def test_the_start() -> None:
    scene = worm_scene("start.position_m=[1, 2]", "start.azimuth_deg=90", "start.lift_m=0.1")
    joints = start_of(scene, worm3d.Worm(), worm3d.Plane()).joints
    assert_allclose(joints[0], [1.0, 2.0, 0.15])
    assert_allclose(joints[-1], [1.0, 3.0, 0.15])
    record = simulate(load_scene("flat", ["run.duration_s=0.1", "start.lift_m=0.1", "start.settle=false"]))
    assert_array_equal(record["normal_load"], 0.0)
    assert record["com"][-1, 2] < record["com"][0, 2]


def test_gravity_is_a_number_or_a_vector() -> None:
    assert_array_equal(gravity_of(worm_scene("run.gravity_m_s2=1.6")), [0.0, 0.0, -1.6])
    assert_array_equal(gravity_of(worm_scene("run.gravity_m_s2=[1, 0, -9]")), [1.0, 0.0, -9.0])


def test_a_push_lasts_as_long_as_it_says() -> None:
    push = Push(joint=6, force_N=(0.0, 2.0, 0.0), begin_s=0.1, duration_s=0.2)
    force = force_of(push, 6, 0.01)
    assert force is not None
    pushed = [k for k in range(1, 100) if force(k * 0.01).any()]
    assert pushed == list(range(11, 31))  # the steps that end in (0.1, 0.3]
    assert_array_equal(force(0.2)[6], [0.0, 2.0, 0.0])
    assert force_of(Push(), 6, 0.01) is None
    forever = force_of(Push(force_N=(1.0, 0.0, 0.0)), 6, 0.01)
    assert forever is not None
    assert forever(1e6)[0, 0] == 1.0


def test_a_push_in_free_flight_gives_its_impulse() -> None:
    floats = ("world.kind=none", "run.gravity_m_s2=0", "gait.amplitude=0")
    push = ("push.force_N=[0, 0.1, 0]", "push.joint=3", "push.begin_s=0.05", "push.duration_s=0.1")
    record = simulate(load_scene("flat", ["run.duration_s=0.3", "run.integrator=implicit_euler", *floats, *push]))
    assert_allclose(record["momentum"][-1], [0.0, 0.1 * 0.1, 0.0], atol=1e-12)
    assert record["work_external"].sum() > 0.0


def test_ground_and_friction_reach_the_plant() -> None:
    def distance(*overrides: str) -> float:
        return float(simulate(load_scene("flat", ["run.duration_s=2", *overrides])).summary["distance_m"])  # type: ignore[arg-type]

    plain = distance()
    assert plain > 0.05
    assert distance("friction.forward=0.2", "friction.backward=0.03") < 0.0
    assert distance("friction.forward=[0.2, 0.2, 0.2, 0.2, 0.2, 0.2]") < 0.7 * plain
    assert distance("world.slope_deg=30", "world.heading_deg=180") > 1.0  # slides down, ahead
    ice = "world.patches=[{grip=0.01}, {grip=1.0, along_m=[-9, -8]}]"
    assert abs(distance(ice)) < 0.7 * plain


@pytest.mark.parametrize(
    ("scene", "overrides"),
    [
        ("flat", BRIEF),
        ("flat", (*TURNING, 'world.patches=[{grip=2, along_m=[0, 1]}]', "world.slope_deg=3")),
        ("flat", (*BRIEF, "world.kind=clamped")),
        ("flat", (*BRIEF, "world.kind=none", "run.gravity_m_s2=0")),
        ("flat", (*BRIEF, "run.record_every=40")),
        ("planar_case", BRIEF),
    ],
)  # fmt: skip
def test_every_figure_is_a_picture_with_labelled_axes(scene: str, overrides: tuple[str, ...], tmp_path: Path) -> None:
    record = simulate(load_scene(scene, overrides))
    model = models.get(record.model)
    for stem, draw in model.figures.items():
        figure, axes = draw(record)
        assert axes.get_xlabel()
        assert axes.get_ylabel()
        drawing.save_figure(figure, tmp_path / stem)
        with Image.open(tmp_path / stem) as picture:
            assert len(picture.convert("RGB").getcolors(1_000_000) or []) > 20


def test_a_run_of_one_stored_state_can_be_drawn(brief: Record, tmp_path: Path) -> None:
    """Such as one that ended before the second."""
    first = tuple(
        Variable(v.name, v.dims, v.values[:1], v.units, v.long_name) if v.dims[:1] == ("time",) else v
        for v in brief.variables
    )
    assert drawing.plot(replace(brief, variables=first), models.get("worm"), tmp_path)


def test_the_movie_shows_the_first_half_minute(brief: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawing.animate(brief, models.get("worm"), tmp_path / "a.gif", fps=10)
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames == round(10 * float(brief["time"][-1])) + 1
    assert drawing.cut_short(brief) is None
    monkeypatch.setattr(worm_view, "MOVIE_S", 0.1)
    drawing.animate(brief, models.get("worm"), tmp_path / "a.gif", fps=10)
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames == 2


def test_a_stored_run_shows_what_the_run_itself_shows(brief: Record) -> None:
    scene = load_scene("flat", BRIEF).settings
    result = worm_build.simulate(scene, lambda done: True)
    stored, direct = worm_view.frames_of(brief), pictures.frames_of(result)
    for field in fields(Frames):
        if field.name != "world":
            assert_array_equal(getattr(stored, field.name), getattr(direct, field.name), err_msg=field.name)
    for one, other in zip(stored.world, direct.world, strict=True):
        assert_array_equal(one.vertices, other.vertices)


def test_a_run_ends_with_what_became_of_the_work() -> None:
    record = simulate(load_scene("flat", ["run.duration_s=2"]))
    line = next(
        line
        for line in terminal.ending(record, drawing.model_of(record), Path()).splitlines()
        if line.strip().startswith("uses of the")
    )
    shares = [float(part) for part in re.findall(r"(-?[\d.]+)%", line)]
    names = re.findall(r"([a-z]+) -?[\d.]+%", line)
    assert names == ["friction", "damping", "impact", "numerical", "gained"]
    assert_allclose(sum(shares), 100.0, atol=0.05)
    assert shares[1] > 80.0


def test_a_record_says_whether_the_worm_was_settled() -> None:
    laid, dropped = (
        simulate(load_scene("flat", ["run.duration_s=0.02", f"start.lift_m={lift}"])) for lift in (0, 0.05)
    )
    assert laid["settling"] == laid.summary["settling_m"]
    assert 0.0 < float(laid["settling"]) < 0.01
    assert np.isnan(dropped["settling"])
    assert "touched nothing" in dropped.summary.reasons["settling_m"]
