"""Parameters of a user's own parts, varied in sweeps and found by fits; runs that go on; faults of own channels."""

from __future__ import annotations

import csv
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.sensing.sensors import QUANTITIES
from control.tracking.obstacles import Disc
from scenes.language.errors import SceneError
from scenes.language.toml import path_of
from scenes.models.control.build import faults_of
from scenes.models.control.reference import reference_of
from scenes.models.loading import load_scene, parse_scene
from scenes.models.worm.view import scene_of
from scenes.records.record import Record
from scenes.records.store import load, save
from scenes.running.runner import lengthened, simulate
from scenes.studies.fit.fitting import fit
from scenes.studies.fit.varied import varied_of
from scenes.sweep.plan import Source, planned
from worm3d.measures import MEASURES

pytestmark = pytest.mark.usefixtures("zoo")

WORM = ("worm.segments=3", "worm.mass_kg=0.03", "run.dt_s=0.02", "run.duration_s=0.4")
DRIVEN = ("controller.kind=zoo:Blind", "controller.map=default", "run.duration_s=0.4")
FELT = ("controller.kind=zoo:Feels", "sensor.zoo:tail=true", "run.duration_s=0.4")
STEERED = ("controller.kind=pi_los", "run.duration_s=0.4")
NOT_DRAWN = ("--vary", "run.integrator=bdf2", "--vary", "seed=1")
"""Further keys: sweeps of more than two keys have no figures; with the same seed no noise tells cases apart."""
SWEPT = {
    "actuator": ("flat", (*WORM, "actuator.kind=zoo:Late"), "actuator.tau_s", (0.05, 0.2)),
    "channel": ("path_line", FELT, 'sensor."zoo:tail".noise_m', (0.001, 0.1)),
    "fault": ("path_line", (*DRIVEN, "fault.zoo:Weak=true"), 'fault."zoo:Weak".share', (0.3, 0.7)),
    "path": ("path_line", (*STEERED, "reference.kind=zoo:Ring"), "reference.radius_m", (0.3, 2.0)),
    "controller": ("path_line", DRIVEN, "controller.stride", (0.1, 0.3)),
    "hinge_actuator": (
        "turn",
        ("hinge_actuator.kind=zoo:Hinged", "run.duration_s=0.4"),
        "hinge_actuator.tau_s",
        (0.02, 0.3),
    ),
    "world": ("flat", (*WORM, "world.kind=zoo:Ripples"), "world.ripple_m", (0.001, 0.004)),
    "hysteresis": ("flat", (*WORM, "hysteresis.kind=zoo:Sticky"), "hysteresis.hold_N_m", (0.001, 0.01)),
    "medium": ("flat", (*WORM, "medium.kind=zoo:Mud", "worm.drag_N_s_m=0.05"), "medium.grow", (0.0, 5.0)),
    "segment": ("flat", (*WORM, "segment.kind=zoo:Blob"), "segment.bulge", (0.2, 0.9)),
    "load": ("flat", (*WORM, "load.kind=zoo:Kite"), "load.lift_N", (0.01, 0.05)),
    "law": ("flat", (*WORM, "friction.law=zoo:Slime"), "friction.thick_s_m", (0.0, 9.0)),
    "reflex": ("flat", (*WORM, "reflexes.zoo:Shy=true"), 'reflexes."zoo:Shy".less', (0.0, 0.9)),
}
"""Scene, overrides that name a part of each kind, a key of it, and values of the key that make runs differ."""


def options(overrides: tuple[str, ...]) -> list[str]:
    return [word for each in overrides for word in ("-o", each)]


def rows(folder: str) -> list[dict[str, str]]:
    with (Path(folder) / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def case_of(folder: str, row: dict[str, str]) -> dict:
    return json.loads((Path(folder) / "cases" / f"{row['case']}.json").read_text())["scene"]


def at(data: dict, key: str):
    for name in path_of(key):
        data = data[name]
    return data


def asked(scene: str, *overrides: str):
    return load_scene(scene, ("seed=1", *overrides))


@pytest.mark.parametrize("kind", SWEPT)
def test_a_sweep_varies_a_parameter_of_a_part(worm3d, kind: str) -> None:
    scene, overrides, key, values = SWEPT[kind]
    vary = f"{key}={','.join(map(str, values))}"
    ended = worm3d("sweep", scene, *options(overrides), "--vary", vary, *NOT_DRAWN, "--out", "x")
    assert ended.code == 0, ended.err
    found = rows("x")
    assert tuple(float(row[key]) for row in found) == values
    assert tuple(at(case_of("x", row), key) for row in found) == values
    assert len({(row["distance_m"], row["work_contract_J"]) for row in found}) == len(values)


def test_a_run_of_a_case_is_that_of_the_scene_with_the_value(worm3d) -> None:
    scene, overrides, key, values = SWEPT["fault"]
    ended = worm3d("sweep", scene, *options(overrides), "--vary", f"{key}=0.3:0.7:2", *NOT_DRAWN, "--out", "x")
    assert ended.code == 0, ended.err
    for row, value in zip(rows("x"), values, strict=True):
        assert float(row["distance_m"]) == simulate(asked(scene, *overrides, f"{key}={value}")).summary["distance_m"]


SCENE = """
model = "worm_control"
seed = 1
run.duration_s = 0.3
controller.kind = "zoo:Blind"
fault."zoo:Weak" = true

[sweep]
vary = { 'fault."zoo:Weak".share' = [0.3, 0.7], slower = "0:1:2" }
set = { "controller.stride" = "= 0.3 - 0.1 * slower" }
"""
CHOSEN = """
model = "worm"
seed = 1
run.duration_s = 0.3
actuator.kind = "zoo:Late"

[sweep]
vary = { "actuator.tau_s" = "0.05:0.2:2" }
set = { "friction.forward" = "= actuator.tau_s / 5" }

[sweep.choices.gait]
kicks = { "gait.kind" = "zoo:Kick", "gait.share" = 0.4 }
waves = { "gait.kind" = "travelling_wave" }
"""


@pytest.mark.slow
def test_a_section_of_a_scene_varies_them_by_formulas_and_by_choices(worm3d) -> None:
    for name, text in (("driven", SCENE), ("chosen", CHOSEN)):
        Path(f"{name}.toml").write_text(text)
        assert "4 cases" in worm3d("check", f"{name}.toml").out
        ended = worm3d("run", f"{name}.toml", "--out", name)
        assert ended.code == 0, ended.err
        assert len({row["distance_m"] for row in rows(name)}) == 4
    for row in rows("driven"):
        case = case_of("driven", row)
        assert case["controller"]["stride"] == pytest.approx(0.3 - 0.1 * float(row["slower"]))
        assert case["fault"]["zoo:Weak"]["share"] == float(row['fault."zoo:Weak".share'])
    for row in rows("chosen"):
        case = case_of("chosen", row)
        assert case["friction"]["forward"] == pytest.approx(float(row["actuator.tau_s"]) / 5)
        assert case["gait"].get("share") == (0.4 if row["gait"] == "kicks" else None)


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ('fault."zoo:Weak".share=0.3,2', "fault.zoo:Weak.share: got 2"),
        ('fault."zoo:Weak".shar=0.3,0.4', "unknown key; did you mean 'share'?"),
        ("controller.stride=0.1,0.9", "controller.stride: got 0.9"),
        ("controller.strid=0.1,0.2", "controller.strid: unknown key; did you mean 'stride'?"),
    ],
)
def test_a_sweep_over_a_wrong_value_or_key_gives_one_sentence(worm3d, vary: str, said: str) -> None:
    ended = worm3d("sweep", "path_line", *options((*DRIVEN, "fault.zoo:Weak=true")), "--vary", vary, "--out", "x")
    assert (ended.code, len(ended.complaints)) == (2, 2), ended.err
    assert "runs code of the module zoo" in ended.complaints[0]
    assert said in ended.complaints[1]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("-o", "fault.zoo:Weak.share=0.5"), 'fault."zoo:Weak".share: both varied and fixed by an override (-o)'),
        (("--vary", "fault.zoo:Weak.share=0.5"), "--vary fault.zoo:Weak.share: given twice; write all values"),
        (("--list", "cases.csv"), "vary fault.zoo:Weak.share: varied twice"),
    ],
)
def test_a_key_is_the_same_with_quotes_and_without(worm3d, more: tuple[str, ...], said: str) -> None:
    Path("cases.csv").write_text("fault.zoo:Weak.share\n0.3\n")
    vary = ("--vary", 'fault."zoo:Weak".share=0.3,0.7')
    ended = worm3d("sweep", "path_line", *options(DRIVEN), *vary, *more, "--out", "x")
    assert (ended.code, said in ended.complaints[-1]) == (2, True), ended.err
    with pytest.raises(SceneError, match=r"--vary fault\.zoo:Weak\.share: given twice"):
        varied_of(asked("path_line", "fault.zoo:Weak=true"), ('fault."zoo:Weak".share', "fault.zoo:Weak.share"))


def test_keys_of_a_part_that_is_varied_too_have_units_and_meanings() -> None:
    plan = planned(Source.of("flat", WORM), {"actuator.kind": ["zoo:Late"], "actuator.tau_s": [0.1, 0.2]})
    assert [each.unit for each in plan.design.varied] == ["", "s"]
    assert plan.design.varied[1].title == "time constant of the tank"


FITTED = {
    "actuator": ("flat", (*WORM, "actuator.kind=zoo:Late"), "actuator.tau_s", 0.1),
    "fault": ("path_line", (*DRIVEN, "fault.zoo:Weak=true"), 'fault."zoo:Weak".share', 0.7),
    "controller": ("path_line", DRIVEN, "controller.stride", 0.2),
}
"""Scene, overrides that name a part, a key of it, and the value that is to be found again."""


def seen(record: Record, file: Path) -> Path:
    """Write what a camera would have seen of the tail and the head."""
    ends = record["joints"][:, [0, -1], 0]
    ends = ends + 1e-5 * np.random.default_rng(0).standard_normal(ends.shape)
    head = f"time_s,joints_0_x_m,joints_{record['joints'].shape[1] - 1}_x_m"
    np.savetxt(file, np.column_stack([record["time"], ends]), delimiter=",", header=head, comments="")
    return file


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["fault", "controller"])
def test_a_fit_finds_a_parameter_of_a_part(kind: str, tmp_path: Path) -> None:
    scene, overrides, key, truth = FITTED[kind]
    to = seen(simulate(asked(scene, *overrides, f"{key}={truth}")), tmp_path / "seen.csv")
    (found,) = fit(scene, to, [key], ("seed=1", *overrides)).keys
    assert found.value == pytest.approx(truth, rel=5e-3)
    assert found.varied.start != truth


@pytest.mark.slow
def test_the_command_fits_a_parameter_within_a_range(worm3d, tmp_path: Path) -> None:
    scene, overrides, key, truth = FITTED["actuator"]
    to = seen(simulate(asked(scene, *overrides, f"{key}={truth}")), tmp_path / "seen.csv")
    ended = worm3d("fit", scene, *options(overrides), "--to", to, "--vary", f"{key}=0.02:0.3", "--out", "f")
    assert ended.code == 0, ended.err
    (found,) = json.loads(Path("f/fit.json").read_text())["keys"]
    assert (found["key"], found["unit"], found["start"]) == (key, "s", 0.05)
    assert at(tomllib.loads(Path("f/fit.toml").read_text()), key) == found["value"] == pytest.approx(truth, rel=5e-3)
    assert worm3d("check", "f/fit.toml").code == 0
    ended = worm3d("fit", scene, *options(overrides), "--to", to, "--vary", "actuator.tau=0.02:0.3", "--out", "g")
    assert (ended.code, "did you mean 'actuator.tau_s'?" in ended.err) == (2, True)


RESUMED = {
    "actuator": ("actuator.kind=zoo:Late", "actuator.tau_s=0.1"),
    "load": ("load.kind=zoo:Kite", "load.lift_N=0.04"),
    "hysteresis": ("hysteresis.kind=zoo:Sticky",),
    "all": (
        *("actuator.kind=zoo:Late", "load.kind=zoo:Kite", "hysteresis.kind=zoo:Sticky", "gait.kind=zoo:Kick"),
        *("world.kind=zoo:Ripples", "friction.law=zoo:Slime", "medium.kind=zoo:Mud", "worm.drag_N_s_m=0.05"),
        *("reflexes.zoo:Shy=true", 'measures.parts=["zoo:lift"]'),
    ),
}


@pytest.mark.parametrize("kind", RESUMED)
def test_a_run_with_a_part_that_has_a_state_goes_on_bit_for_bit(kind: str, tmp_path: Path) -> None:
    half, whole = (simulate(asked("flat", *WORM, *RESUMED[kind], f"run.duration_s={t}")) for t in (0.4, 0.8))
    save(half, tmp_path / "result.nc")
    stored = load(tmp_path)
    rest = simulate(lengthened(stored, 0.4), earlier=stored)
    for ours, theirs in ((rest.variables, whole.variables), (rest.checkpoint, whole.checkpoint)):
        assert [each.name for each in ours] == [each.name for each in theirs]
        for mine, yours in zip(ours, theirs, strict=True):
            assert_array_equal(mine.values, yours.values, strict=True, err_msg=mine.name)
    assert (rest.summary, rest.scene) == (whole.summary, whole.scene)
    states = {"actuator": "tank", "load": "load_height", "all": "tank"}
    if kind in states:
        assert np.ptp(rest[f"actuator_{states[kind]}"]) > 0.0


@pytest.mark.slow
def test_the_command_goes_on_with_a_run_where_the_module_is(worm3d, zoo: Path) -> None:
    overrides = options((*WORM, *RESUMED["actuator"]))
    assert worm3d("run", "flat", *overrides, "--out", "half").code == 0
    assert worm3d("run", "flat", *overrides, "-o", "run.duration_s=0.8", "--out", "whole").code == 0
    ended = worm3d("resume", "half", "--duration", "0.4", "--out", "both")
    assert ended.code == 0, ended.err
    for name in ("joints", "actuator_tank", "work_contract"):
        assert_array_equal(load(Path("both"))[name], load(Path("whole"))[name], err_msg=name)
    ended = worm3d("resume", "half", "--duration", "0.4", "--out", "x", "--no-code")
    assert (ended.code, "zoo:Late is code of a module, refused here (--no-code)" in ended.err) == (2, True)
    zoo.unlink()
    sys.modules.pop("zoo")
    ended = worm3d("resume", "half", "--duration", "0.4", "--out", "x")
    assert (ended.code, len(ended.complaints)) == (2, 1)
    assert "actuator.kind: there is no module 'zoo'" in ended.err
    assert not Path("x").exists()


def distance(*overrides: str) -> float:
    record = simulate(asked("path_line", *FELT, *overrides))
    assert record.summary.faults == []
    return float(record.summary["distance_m"])


def test_a_fault_that_ships_acts_on_a_channel_of_ones_own() -> None:
    well = distance()
    fault = ("fault.sensor=true", "fault.sensor_channel=tail")
    lost, off, frozen = (
        distance(*fault, f"fault.sensor_mode={mode}", *more)
        for mode, more in (
            ("lost", ()),
            ("off", ("fault.sensor_error=0.1",)),
            ("frozen", ("fault.sensor_begin_s=0.1",)),
        )
    )
    assert lost < off < well
    assert frozen not in (well, lost, off)
    assert distance("fault.zoo:Off=true") == off, "one's own that does the same"
    assert distance("fault.zoo:Off=true", "fault.zoo:Off.error_m=0.0") == well
    assert off < distance("fault.zoo:Off=true", "fault.zoo:Off.begin_s=0.2") < well


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (("fault.sensor_channel=tial",), "channel: got 'tial', must be one of .*, tail; did you mean 'tail'?"),
        (("fault.sensor_channel=colour",), 'must be one of .*; for a channel of your own set sensor."my_module:NAME"'),
        (("fault.sensor_channel=tail", "fault.sensor_segment=1"), "segment: got 1, must be left out: tail is of the"),
    ],
)
def test_a_fault_of_a_channel_that_there_is_not_is_refused(overrides: tuple[str, ...], said: str) -> None:
    with pytest.raises(SceneError, match=said) as caught:
        asked("path_line", *FELT, "fault.sensor=true", *overrides)
    assert len(caught.value.lines) == 1


def test_a_channel_of_ones_own_is_known_by_its_name_once_a_scene_has_it() -> None:
    assert "tail" not in QUANTITIES
    scene = asked("path_line", *FELT, "fault.sensor=true", "fault.sensor_channel=tail")
    assert QUANTITIES["tail"] is sys.modules["zoo"].tail
    (fault,) = faults_of(scene.settings)
    assert fault.channel == "tail"


@pytest.mark.parametrize(
    ("scene", "overrides", "said"),
    [
        (
            "path_line",
            ("controller.kind=zoo:Feels",),
            "controller: zoo:Feels senses 'tail', and there is no such sensor",
        ),
        ("flat", ("reflexes.zoo:Ducks=true",), "tail: got a channel of this name, must be one of strain, com"),
    ],
)
def test_who_senses_a_channel_that_there_is_not_is_told_how_to_add_it(scene: str, overrides: tuple, said: str) -> None:
    with pytest.raises(SceneError, match=f'{said}.*; for a channel of your own set sensor."my_module:NAME" = true'):
        simulate(asked(scene, *overrides, "run.duration_s=0.1"))


DUCKING = (*WORM, "reflexes.zoo:Ducks=true", "sensor.zoo:tail=true")


def test_a_sweep_varies_the_errors_of_a_channel_that_a_reflex_senses(worm3d) -> None:
    vary = ("--vary", 'sensor."zoo:tail".noise_m=0,0.05', "--vary", 'reflexes."zoo:Ducks".gain_per_m=1,5')
    ended = worm3d("sweep", "flat", *options(DUCKING), *vary, "--vary", "seed=1", "--out", "x")
    assert ended.code == 0, ended.err
    assert len({row["distance_m"] for row in rows("x")}) == 4


def test_a_reflex_of_ones_own_feels_with_the_errors_of_a_channel_that_ships() -> None:
    crawls = (*WORM, "reflexes.zoo:Shy.less=0.9", "sensor.contact_load_noise_N={}")
    exact, noisy = (
        simulate(asked("flat", *(each.format(noise) for each in crawls))).summary["distance_m"] for noise in (0, 5)
    )
    assert exact != noisy


def test_a_channel_that_nothing_senses_is_refused() -> None:
    with pytest.raises(SceneError, match="neither the gait 'travelling_wave' nor a reflex senses anything"):
        asked("flat", *WORM, "sensor.zoo:tail=true")


def test_an_actuator_that_drives_no_hinges_is_refused_for_them() -> None:
    with pytest.raises(SceneError, match=r"hinge_actuator: got Late, which acts on chambers alone") as caught:
        asked("turn", "hinge_actuator.kind=zoo:Late")
    assert len(caught.value.lines) == 1


def test_a_fault_that_begins_after_the_run_is_refused() -> None:
    with pytest.raises(SceneError, match=r"Weak: got a beginning at 9 s: must be before the end of the run"):
        asked("path_line", *DRIVEN, "fault.zoo:Weak.begin_s=9")


LOG = 'kind = "zoo:Log", x_m = 2.0, y_m = 0.1, radius_m = 0.2'


def test_an_obstacle_of_a_table_has_the_parameters_of_its_class() -> None:
    disc = "{x_m = 3.0, y_m = 0.2, radius_m = 0.1}"
    settings = asked("obstacles", f"reference.obstacles=[{{{LOG}, half_m = 0.3}}, {disc}]").settings
    log, other = reference_of(settings).obstacles
    assert (type(log).__name__, log.half, type(other)) == ("Log", 0.3, Disc)
    assert_allclose(log.distances([[2.5, 0.1], [2.0, 0.4]]), [0.0, 0.1], atol=1e-15)
    again = parse_scene(asked("obstacles", f"reference.obstacles=[{{{LOG}, half_m = 0.3}}]").to_toml(), "again")
    assert again.settings.reference.obstacles[0].half_m == 0.3


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        (f"{{{LOG}, half_m = -1.0}}", r"obstacles\[0\]\.half_m: got -1.0: input should be greater than 0"),
        (f"{{{LOG}, hlaf_m = 1.0}}", r"obstacles\[0\]\.hlaf_m: unknown key; did you mean 'half_m'"),
        (
            f"{{{LOG}}}, {{x_m = 3, y_m = 1, radius_m = 0.2, half_m = 1}}",
            r"obstacles\[1\]\.half_m: only for kind = 'zoo:Log'",
        ),
        (f"{{{LOG.replace('Log', 'Lgo')}}}", "the module 'zoo' has no 'Lgo'; did you mean 'Log'"),
        (f"{{{LOG.replace('Log', 'Kick')}}}", "zoo:Kick is the class Kick, not marked as an obstacle"),
    ],
)
def test_mistakes_in_obstacles_of_ones_own_are_lines(tables: str, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence) as caught:
        asked("obstacles", f"reference.obstacles=[{tables}]")
    assert len(caught.value.lines) == 1


def test_discs_and_obstacles_of_ones_own_need_their_own_keys_alone() -> None:
    tables = '{kind = "zoo:Post", girth_m = 0.1}, {x_m = 3.0, y_m = 0.3, radius_m = 0.2}'
    post, disc = reference_of(asked("obstacles", f"reference.obstacles=[{tables}]").settings).obstacles
    assert (post.girth, disc) == (0.1, Disc(3.0, 0.3, 0.2))
    with pytest.raises(SceneError, match=r"obstacles\[0\].girth_m: missing: zoo:Post only: circumference"):
        asked("obstacles", 'reference.obstacles=[{kind = "zoo:Post"}]')


@pytest.mark.parametrize("more", [(), ('friction.needed="x"',)])
def test_a_parameter_without_a_default_that_is_not_given_is_missed(zoo: Path, more: tuple[str, ...]) -> None:
    law = "class Bare(Slime):\n    needed: float = parameter(meaning='a number', gt=0)\n"
    zoo.write_text(f"{zoo.read_text()}\n\n@documented\n@dataclass(frozen=True, kw_only=True)\n{law}")
    with pytest.raises(SceneError, match=r"friction\.needed: (missing|got 'x')") as caught:
        asked("flat", "friction.law=zoo:Bare", *more)
    assert len(caught.value.lines) == 1


def test_a_part_of_a_module_in_a_package_is_told_at_its_own_key(tmp_path: Path) -> None:
    (tmp_path / "packed").mkdir()
    (tmp_path / "packed" / "inner.py").write_text((tmp_path / "zoo.py").read_text())
    with pytest.raises(SceneError, match=r"^override fault\.packed\.inner:Weak.begin_s: .*got a beginning at 9 s"):
        asked("path_line", "controller.kind=pi_los", "run.duration_s=0.4", 'fault."packed.inner:Weak".begin_s=9')
    del sys.modules["packed.inner"], sys.modules["packed"]


def test_a_run_round_an_obstacle_of_ones_own_is_shown_where_the_module_is_not(tmp_path: Path) -> None:
    record = simulate(asked("obstacles", f"reference.obstacles=[{{{LOG}}}]", "run.duration_s=0.4"))
    save(record, tmp_path / "result.nc")
    sys.modules.pop("zoo")
    (tmp_path / "zoo.py").unlink()
    shown = scene_of(load(tmp_path / "result.nc"))
    assert (shown.reference.kind, shown.reference.obstacles) == ("line", ())


def test_a_measure_that_raises_has_no_value_and_loses_no_run(zoo: Path, tmp_path: Path) -> None:
    zoo.write_text(
        f"{zoo.read_text()}\n\n@measure('nothing_m', 'nothing')\ndef nothing(result):\n    return result.nothing\n"
    )
    record = simulate(asked("flat", *WORM, "gait.kind=zoo:Kick", "gait.period_s=0.4"))
    MEASURES.pop("nothing_m")
    assert record.summary.metrics["nothing_m"] is None
    assert "nothing_m: raised AttributeError" in record.summary.reasons["nothing_m"]


def test_a_list_of_the_wrong_length_for_a_gait_names_the_gait_and_its_line(zoo: Path) -> None:
    zoo.write_text(
        zoo.read_text().replace(
            "return (phase % 1.0 < self.share)", "return np.ones((1, 7)) * (phase % 1.0 < self.share)"
        )
    )
    with pytest.raises(
        SceneError, match=r"zoo:Kick: raised operands could not be broadcast .*\(zoo\.py, line \d+\)"
    ) as caught:
        asked("flat", *WORM, "gait.kind=zoo:Kick", "gait.period_s=0.4")
    assert len(caught.value.lines) == 1


def test_a_gait_that_raises_in_a_run_keeps_the_steps_before(zoo: Path) -> None:
    late = "if times.max() > 0.2:\n            raise RuntimeError('late')\n        phase = np.multiply"
    zoo.write_text(zoo.read_text().replace("phase = np.multiply", late, 1))
    record = simulate(asked("flat", *WORM, "gait.kind=zoo:Kick", "gait.period_s=0.4"))
    assert (record.status, record.sizes["step"]) == ("diverged", 10)
    assert "RuntimeError: late" in record.sentence
