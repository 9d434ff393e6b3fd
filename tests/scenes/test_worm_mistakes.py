"""Scenes of the 3D worm that are wrong: a line for each mistake, and no traceback."""

from __future__ import annotations

import pytest

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene, parse_scene

ELEVEN = """\
model = "worm"

[run]
dt_s = 0.5
gravity_m_s2 = [0.0, -9.81]

[worm]
chamber_offset_m = 0.0
yaw_J = [0.5, 0.5]
k_twist = 0.5
stroke = [0.1, 0.4]

[world]
kind = "plain"

[[world.patches]]
gripp = 1.0

[[world.patches]]
grip = 2.0
along_m = [1.0]

[friction]
lateral = [0.2, -0.2]

[gait]
bias = 1.5

[push]
joint = 7
"""


def lines_about(text: str, *overrides: str) -> list[str]:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, "test", overrides)
    assert caught.value.exit_code == 2
    return list(caught.value.lines)


def test_every_mistake_gives_its_line() -> None:
    assert lines_about(ELEVEN, "start.lift_m=-1") == [
        "line 4: run.dt_s: got 0.5 s, must be at most a 10th of the gait's period, 2 s, or the wave falls between "
        "the steps",
        "line 5: run.gravity_m_s2: got a list of 2: must be one number (g, downwards) or a list of three (x, y, z)",
        "line 8: worm.chamber_offset_m: got 0.0: input should be greater than 0 [m], 0 < … (default 0.03)",
        "line 9: worm.yaw_J: got 2 values, must be a number or 5 of them",
        "line 10: worm.k_twist: unknown key; did you mean 'twist_J'?",
        "line 11: worm.stroke: got (0.1, 0.4), must be finite and (c_min, c_max) with c_min <= 0 <= c_max < 1",
        "line 14: world.kind: got 'plain': input should be one of 'plane', 'pipe', 'slope_into_pipe', 'heightfield', "
        "'mesh', 'clamped', 'groove', 'none', or module:NAME; did you mean 'plane'? "
        "(default 'plane')",
        "line 16: world.patches[0].grip: missing: multiplier of the friction coefficients, 0 <= …",
        "line 17: world.patches[0].gripp: unknown key; did you mean 'grip'?",
        "line 21: world.patches[1].along_m: got [1.0]: input should be a list of 2 items, not 1 [m] "
        "(default everywhere)",
        "line 24: friction.lateral[1]: got -0.2: input should be greater than or equal to 0, 0 <= … <= 1e+06, "
        "a number or one for each segment (default 0.2)",
        "line 27: gait.bias: got 1.5: input should be less than or equal to 1, -1 <= … <= 1 (default 0.0)",
        "line 30: push.joint: got 7: the last joint, the head, is 6 (worm.segments)",
        "override start.lift_m: got -1: input should be greater than or equal to 0 [m], 0 <= … (default 0.0)",
    ]


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("world.patches=3", "override world.patches: got 3: must be sections of keys under headers [[world.patches]]"),
        (
            "world.patches=[3]",
            "override world.patches: world.patches[0]: got 3: must be sections of keys under headers [[world.patches]]",
        ),
        (
            "world.patches=[{grip=1, across_m=[2, 1]}]",
            "override world.patches: across_m of patch 0: got [2, 1]: must be [from, to] with from < to",
        ),
        ("world.slope_rad=0.1", "override world.slope_rad: unknown key; did you mean 'slope_deg'?"),
        (
            "world.velocity_threshold_m_s=1e-5",
            "override world.velocity_threshold_m_s: only for world.kind = 'clamped', but this scene has "
            "'plane': leave it out (default 1e-06), or change world.kind",
        ),
        ("push.duration_s=0.001", "override push.duration_s: got 0.001 s: must be at least run.dt_s (0.01 s), or the "),
        ("run.gravity_m_s2=-9.81", "override run.gravity_m_s2: got -9.81 m/s^2: g is at least 0; a list of x, y, z"),
        ("run.integrator=bdf", "override run.integrator: got 'bdf': input should be 'bdf2' or 'implicit_euler'; did"),
        ("friction.forward=[0.1]", "override friction.forward: got 1 values, must be a number or 6 of them"),
        ("worm.length_m=1e-300", "override worm.length_m: "),
        ("worm.half_height_m=1e-200", "override worm.half_height_m: "),
        ("run.gravity_m_s2=1e300", "override run.gravity_m_s2: "),
    ],
)  # fmt: skip
def test_one_mistake_is_one_line(override: str, line: str) -> None:
    found = lines_about('model = "worm"\n', override)
    assert len(found) == 1
    assert found[0].startswith(line)


def test_keys_of_a_plane_are_not_for_another_world() -> None:
    (line,) = lines_about('model = "worm"\n[world]\nkind = "none"\nslope_deg = 3.0\npatches = []\n')
    assert line.startswith("line 4: world.slope_deg: only for world.kind = 'plane' or 'slope_into_pipe', but this ")


@pytest.mark.parametrize("model", ["worm", "worm_planar"])
def test_a_worm_that_its_weight_would_flatten_is_refused_with_the_limit_point(model: str) -> None:
    text = f'model = "{model}"\n[worm]\nmass_kg = 5.0\n'
    (line,) = lines_about(text)
    assert line.startswith("line 3: worm.mass_kg: segment 0 would be pressed flat: it carries ")
    assert line.endswith(" kg, or spring_N or half_height_m larger")
    lightest = float(line.split("lighter than ")[1].split(" kg")[0])
    parse_scene(text, "test", [f"worm.mass_kg={0.99 * lightest}"])
    assert len(lines_about(text, f"worm.mass_kg={1.01 * lightest}")) == 1
    parse_scene(text, "test", ["world.kind=clamped"])  # held up by its joints
    parse_scene(text, "test", ["world.kind=none"])
    parse_scene(text, "test", ["run.gravity_m_s2=0.1"])


def test_a_gait_must_not_stretch_a_chamber_beyond_its_links() -> None:
    text, flat = 'model = "worm"\n', "worm.half_height_m=0.03"
    (line,) = lines_about(text, flat, "gait.rectified=false")
    assert line == (
        "override worm.half_height_m: got 0.03: the gait lengthens a chamber to 0.1833 m, but its links end at "
        "0.1771 m; keep one of gait.amplitude and -worm.stroke[0] below 0.06283, or let the gait only contract"
    )
    parse_scene(text, "test", [flat])
    parse_scene(text, "test", [flat, "gait.rectified=false", "worm.stroke=[-0.06, 0.45]"])
    parse_scene(text, "test", [flat, "gait.rectified=false", "gait.amplitude=0.06"])
    assert len(lines_about(text, flat, "gait.rectified=false", "gait.amplitude=0.06", "gait.bias=0.2")) == 1


def test_the_planar_worm_has_the_keys_of_the_planar_model() -> None:
    text = 'model = "worm_planar"\n'
    assert "unknown key" in lines_about(text, "worm.chamber_offset_m=0.03")[0]
    assert "unknown key" in lines_about(text, "gait.bias=0.3")[0]
    assert "unknown key" in lines_about(text, "start.azimuth_deg=3")[0]
    assert "got 1 values, must be a number or 6 of them" in lines_about(text, "worm.half_height_m=[0.1]")[0]
    (line,) = lines_about(text, "gait.amplitude=0.33", "gait.rectified=false")
    assert "lengthens a segment to 0.2217 m, but its links end at 0.2205 m" in line


def test_scenes_that_do_not_fit_into_memory_are_refused_unless_less_is_stored() -> None:
    (line,) = lines_about('model = "worm"\n[run]\nduration_s = 5000\n')
    assert line.startswith("line 3: run.duration_s: got 5e+05 steps of 6 segments, about 6.92 GB of memory: must be ")
    assert "use a larger run.record_every, a shorter run.duration_s" in line
    parse_scene('model = "worm"\n[run]\nduration_s = 5000\nrecord_every = 10\n', "test")


def test_patches_survive_the_resolved_scene() -> None:
    patches = "world.patches=[{grip=2.0, along_m=[0.0, 1.0]}, {grip=0.5}]"
    scene = load_scene("flat", [patches])
    text = scene.to_toml()
    assert text.count("[[world.patches]]") == 2
    again = parse_scene(text, "flat")
    assert again.settings == scene.settings
    assert again.to_toml() == text
    line = text.splitlines().index("grip = 0.5") + 1
    assert lines_about(text.replace("grip = 0.5", "grip = -0.5"))[0].startswith(f"line {line}: world.patches[1].grip: ")


def test_a_text_in_the_place_of_a_list_and_a_name_twice() -> None:
    text = load_scene("path_line").to_toml()
    (line,) = lines_about(text, "cost.parts=speed")
    assert line.startswith("override cost.parts: got 'speed': input should be a valid list (default ")
    (line,) = lines_about(text, 'cost.parts=["speed", "speed"]')
    assert "input should be a list that has each name once" in line


def test_a_gait_takes_pairs_for_each_segment() -> None:
    pairs = [[0.1 * k, 0.1 * k + 0.05] for k in range(6)]
    scene = parse_scene('model = "worm"\n[gait]\nkind = "periodic"\n', "test", [f"gait.phase={pairs}"])
    assert scene.settings.gait.phase[1] == (0.1, 0.15000000000000002)


def test_a_refusal_of_a_default_leaves_the_other_mistakes_to_be_told() -> None:
    wrong = ("medium.kind=strain_drag", "friction.viscosity_s_m=3", "reflexes.reach_most=3", "push.joint=99")
    found = lines_about('model = "worm"\n', *wrong)
    keys = ("medium.kind", "friction.viscosity_s_m", "reflexes.reach_most", "push.joint")
    assert {line.split(":")[0] for line in found} == {f"override {key}" for key in keys}
    assert found[0].startswith("override medium.kind: worm.drag_N_s_m: got 0.0 N s/m, must be above 0 with a medium")


def test_mistakes_with_equal_words_at_two_keys_are_two() -> None:
    found = lines_about('model = "worm"\n', "worm.half_height_m=[1,2]", "friction.forward=[1,2]")
    assert found == [
        f"override {key}: got 2 values, must be a number or 6 of them"
        for key in ("worm.half_height_m", "friction.forward")
    ]


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (
            ("hinge_actuator.lag_s=1e26", "actuator.lag_s=0.2"),
            "override hinge_actuator.lag_s: got 1e+26, must be",
        ),
        (("hinge_actuator.rate_limit_per_s=1e300",), "override hinge_actuator.rate_limit_per_s: got 1e+300, must be"),
        (
            ("world.kind=clamped", "friction.law=viscous"),
            "override friction.law: got 'viscous': with world.kind = 'clam",
        ),
        (
            ("run.gravity_m_s2=[1e300,0,0]",),
            "override run.gravity_m_s2: got [1e+300, 0, 0] m/s^2: must",
        ),
    ],
)
def test_a_refusal_is_told_at_the_key_that_is_wrong(overrides: tuple[str, ...], line: str) -> None:
    (found,) = lines_about('model = "worm"\n', *overrides)
    assert found.startswith(line)
