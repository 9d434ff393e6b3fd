"""Parts of a user's own of every kind, by name in scenes: checked, listed, varied, run, stored, shown without code."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from scenes import models
from scenes.language import toml
from scenes.language.errors import SceneError
from scenes.language.toml import path_of
from scenes.models.control.build import controller_of, faults_of, parts_of, sensors_of
from scenes.models.control.reference import path_of as tracked
from scenes.models.loading import load_scene, parse_scene
from scenes.models.worlds.build import world_of
from scenes.models.worm.build import friction_of, gait_of, measures_of, worm_of

pytestmark = pytest.mark.usefixtures("zoo")


WORM = {
    "gait.kind=zoo:Kick": ("gait.share", 0.4, 1.5),
    "world.kind=zoo:Ripples": ("world.ripple_m", 0.003, -1),
    "actuator.kind=zoo:Late": ("actuator.tau_s", 0.1, 0),
    "hysteresis.kind=zoo:Sticky": ("hysteresis.give_J", 2e-4, 0),
    "medium.kind=zoo:Mud": ("medium.grow", 0.7, -1),
    "segment.kind=zoo:Blob": ("segment.bulge", 0.4, -1),
    "load.kind=zoo:Kite": ("load.lift_N", 0.04, -1),
    "friction.law=zoo:Slime": ("friction.thick_s_m", 4.0, -1),
    "reflexes.zoo:Shy=true": ("reflexes.zoo:Shy.less", 0.2, 1),
    'measures.parts=["zoo:lift"]': ("measures.parts", ["zoo:lift"], ["zoo:Kick"]),
}
CONTROL = {
    "controller.kind=zoo:Blind": ("controller.stride", 0.25, 0.5),
    "reference.kind=zoo:Ring": ("reference.radius_m", 0.8, 0),
    "fault.zoo:Weak=true": ("fault.zoo:Weak.share", 0.7, 2),
    "sensor.zoo:tail=true": ("sensor.zoo:tail.noise_m", 0.002, -1),
    'cost.parts=["speed", "zoo:Thrift"]': ("cost.zoo:Thrift.tolerance_Hz", 0.3, 0),
}
"""Override that names a part, and a key of it with a right and a wrong value."""
CASES = [("flat", name, *key) for name, key in WORM.items()] + [
    ("path_line", name, *key) for name, key in CONTROL.items()
]
MUD = "worm.drag_N_s_m=0.05"


def asked(scene: str, *overrides: str):
    return load_scene(scene, ("run.duration_s=0.5", *([MUD] if scene == "flat" else []), *overrides))


@pytest.mark.parametrize(("scene", "name", "key", "right", "wrong"), CASES)
def test_its_parameters_are_keys_of_its_section(scene: str, name: str, key: str, right, wrong) -> None:
    found = asked(scene, name, f"{key}={json.dumps(right)}")
    data = tomllib.loads(found.to_toml())
    for part in path_of(key):
        data = data[part]
    assert data == right
    again = parse_scene(found.to_toml(), "again")
    assert again.to_toml() == found.to_toml()
    with pytest.raises(SceneError, match=r"got -?[\d\.\[]|zoo:Kick is the class Kick, not marked as a measure"):
        asked(scene, name, f"{key}={json.dumps(wrong)}")
    misspelt = key[:-1]
    if key != "measures.parts":
        with pytest.raises(SceneError, match=r"unknown key; did you mean"):
            asked(scene, name, f"{misspelt}={json.dumps(right)}")


def test_the_parts_get_their_parameters() -> None:
    given = [f"{key}={json.dumps(right)}" for key, right, _ in WORM.values()]
    scene = asked("flat", *WORM, *given).settings
    worm = worm_of(scene)
    assert (worm.actuator.tau, worm.hysteresis.give, worm.medium.grow, worm.load.lift) == (0.1, 2e-4, 0.7, 0.04)
    assert worm.segment.bulge == 0.4
    gait = gait_of(scene)
    assert (gait.gait.share, gait.reflexes[0].less) == (0.4, 0.2)
    assert (world_of(scene.world).height_m, friction_of(scene).law.thick) == (0.003, 4.0)
    assert [measure.name for measure in measures_of(scene)] == ["lift_m"]
    planned = {name: keys for name, keys in CONTROL.items() if not name.startswith("controller")}
    given = [f"{key}={json.dumps(right)}" for key, right, _ in planned.values()]
    scene = asked("path_line", *planned, *given).settings
    assert (tracked(scene).radius, faults_of(scene)[0].share) == (0.8, 0.7)
    assert sensors_of(scene).channels["tail"].noise == 0.002
    assert parts_of(scene)["terms"][1].tolerance == 0.3
    usual = [each for each in CONTROL if not each.startswith("cost")]
    assert controller_of(asked("path_line", *usual, "controller.stride=0.25").settings).guest.stride == 0.25


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("gait.kind=zoo:Bare", "zoo:Bare has the parameter share, but is no dataclass: write @dataclass(frozen=True"),
        (
            "gait.kind=zoo:Slime",
            "zoo:Slime is the class Slime, not marked as a gait: derive it from control.gaits.Gait",
        ),
        ("actuator.kind=zoo:Lat", "the module 'zoo' has no 'Lat'; did you mean 'Late'?"),
        ("friction.law=zoo:Mud", "not marked as a law of friction: derive it from worm3d.physics.friction_laws"),
        ("reflexes.zoo:Weak=true", "zoo:Weak is the class Weak, not marked as a reflex"),
        ("reflexes.zoo:Shy=3", "reflexes.zoo:Shy: got 3: must be a section of keys"),
        ("gait.kind=zoo:Fails", "zoo:Fails: raised ZeroDivisionError: nothing (zoo.py, line "),
        ("reflexes._zoo:Shy=true", "there is no module '_zoo'"),
    ],
)
def test_mistakes_give_one_sentence(override: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        asked("flat", override)
    (sentence,) = caught.value.lines
    assert said in sentence


def test_a_key_of_another_kind_is_refused_and_one_that_is_taken() -> None:
    with pytest.raises(SceneError, match=r"gait\.wavelength: only for gait\.kind = 'travelling_wave' or 'steered'"):
        asked("flat", "gait.kind=zoo:Kick", "gait.wavelength=2")
    with pytest.raises(
        SceneError, match="zoo:Taken: the key speed_m_s of its parameter is taken; rename the parameter"
    ):
        asked("path_line", "reference.kind=zoo:Taken")


def test_a_world_may_be_an_object() -> None:
    world = world_of(asked("flat", "world.kind=zoo:HILL").settings.world)
    assert type(world).__name__ == "SampledWorld"


def test_init_lists_the_keys_of_a_part(worm3d, tmp_path: Path) -> None:
    ended = worm3d("init", "my.toml", "-o", "gait.kind=zoo:Kick", "-o", "reflexes.zoo:Shy=true")
    assert ended.code == 0, ended.err
    text = (tmp_path / "my.toml").read_text()
    assert "# share of the period in which it kicks, 0 < … < 1\nshare = 0.5\n" in text
    assert '[reflexes."zoo:Shy"]  # A segment that is loaded contracts a little less\n' in text
    assert worm3d("check", "my.toml").code == 0
    ended = worm3d("init", "more.toml", "-o", "gait.kind=zoo:Kick", "-o", "gait.shar=0.3")
    assert (ended.code, "did you mean 'share'?" in ended.err) == (2, True)


@pytest.mark.parametrize(("scene", "name", "key", "right", "wrong"), CASES)
def test_each_kind_is_checked_and_written_by_the_command_line(worm3d, scene: str, name: str, key: str, right, wrong):
    mud = ("-o", MUD) if scene == "flat" else ()
    assert worm3d("check", scene, *mud, "-o", name).code == 0
    ended = worm3d("check", scene, *mud, "-o", name, "-o", f"{key}={json.dumps(wrong)}")
    assert (ended.code, f"{key}: got" in ended.err or "zoo:Kick is" in ended.err) == (2, True)
    model = ("--model", "worm_control") if scene == "path_line" else ()
    ended = worm3d("init", "my.toml", *model, *mud, "-o", name, "-o", f"{key}={json.dumps(right)}")
    assert ended.code == 0, ended.err
    assert f"\n{path_of(key)[-1]} = {toml.value(right)}\n" in Path("my.toml").read_text()
    assert worm3d("check", "my.toml").code == 0


def test_init_tells_of_sections_that_there_are_not_and_of_keys_to_fill_in(worm3d, tmp_path: Path) -> None:
    ended = worm3d("init", "my.toml", "-o", "gat.period_s=2")
    assert (ended.code, ended.complaints) == (
        2,
        ["override gat.period_s: gat: unknown section; did you mean 'gait'?"],
    )
    assert not (tmp_path / "my.toml").exists()
    ended = worm3d("init", "my.toml", "-o", "load.kind=zoo:Kite")
    assert ended.out.startswith("wrote my.toml; ")
    text = (tmp_path / "my.toml").read_text()
    assert (" = ?  must be given" in text) == ("fill in its" in ended.out)


def test_every_check_reads_keys_that_its_model_has() -> None:
    from scenes.language.schema import key_at

    for model in map(models.get, models.names()):
        for check in model.checks:
            assert all(key_at(model.schema, path) for path in check.paths), (model.name, check.needs)


LOOK = """
import sys
import worm3d

run, driven, planned = map(worm3d.load, "abd")
assert run.summary()["lift_m"] is not None
assert run.worm.load.lift == 0.04 and "load_height" in run.actuator_states
assert (run.worm.hysteresis.give, run.worm.medium.grow) == (2e-4, 0.7)
assert planned.joints.shape == driven.joints.shape
assert driven.worm.actuator.tau == 0.1 and driven.actuator_states.keys() == {"tank"}
worm3d.draw(run, "a.png")
assert "zoo" not in sys.modules
print(run.summary()["distance_m"], run.world.distance(run.joints[-1]).min())
"""


@pytest.mark.slow
def test_runs_are_varied_and_shown_where_the_module_is_not(worm3d, tmp_path: Path, zoo: Path) -> None:
    first = ("gait.kind=zoo:Kick", "world.kind=zoo:Ripples", "friction.law=zoo:Slime", 'measures.parts=["zoo:lift"]')
    first += ("reflexes.zoo:Shy.less=0.2", "load.kind=zoo:Kite", "load.lift_N=0.04", "friction.thick_s_m=4.0")
    first += ("hysteresis.kind=zoo:Sticky", "hysteresis.give_J=2e-4", "medium.kind=zoo:Mud", "medium.grow=0.7", MUD)
    flat = ("run.duration_s=1.2", *first)
    vary = ("--vary", "gait.share=0.4,0.6", "--vary", "world.ripple_m=0.002,0.004", "--out", "s")
    ended = worm3d("sweep", "flat", *(word for each in flat for word in ("-o", each)), *vary)
    assert ended.code == 0, ended.err
    assert worm3d("run", "flat", *(word for each in flat for word in ("-o", each)), "--out", "a").code == 0
    usual = [each for each in CONTROL if not each.startswith("cost")]
    second = ("run.duration_s=0.5", "actuator.kind=zoo:Late", "actuator.tau_s=0.1", *usual)
    second += ("fault.sensor=true", "fault.sensor_channel=tail")
    assert worm3d("run", "path_line", *(word for each in second for word in ("-o", each)), "--out", "b").code == 0
    third = ("run.duration_s=0.5", 'cost.parts=["speed", "zoo:Thrift"]', "cost.zoo:Thrift.tolerance_Hz=0.3")
    assert worm3d("run", "path_line", *(word for each in third for word in ("-o", each)), "--out", "d").code == 0
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    zoo.unlink()
    sys.modules.pop("zoo")
    for command in (
        ("view", "a", "--no-open"),
        ("plot", "a"),
        ("plot", "b"),
        ("plot", "d"),
        ("compare", "a", "b", "--out", "c"),
    ):
        ended = worm3d(*command)
        assert ended.code == 0, (command, ended.err)
    seen = subprocess.run([sys.executable, "-c", LOOK], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert seen.returncode == 0, seen.stderr
    distance, clearance = map(float, seen.stdout.split())
    assert distance == summary["distance_m"]
    assert 0.0 < clearance < 0.2
