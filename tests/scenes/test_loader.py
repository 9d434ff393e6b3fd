from __future__ import annotations

import re
from pathlib import Path

import pytest

from control.gaits import GAITS
from scenes.language.errors import SceneError
from scenes.language.loader import SHIPPED_FOLDER, shipped_scenes
from scenes.models.loading import load_scene, parse_scene
from scenes.models.sections import gait_from
from worm3d.values.parameters import parameters_of

EIGHT = """\
model = "planar_published"
seed = -1

[run]
duration_s = "10 s"
dt_s = 0.5

[worm]
length_m = true
segments = 6.5
connector_mass_kg = 1.0

[gait]
lamda_m = 1.0
kind = "traveling_wave"

[frictoin]
forward = 0.03
"""


NAMES = map(repr, ("travelling_wave", *(kind for kind in GAITS if kind != "travelling_wave")))
GAIT_KINDS = f"one of {', '.join(NAMES)}, or module:NAME"


def lines_about(text: str, *overrides: str) -> tuple[str, ...]:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, "test", overrides)
    assert caught.value.exit_code == 2
    return caught.value.lines


def test_eight_mistakes_give_eight_lines() -> None:
    assert lines_about(EIGHT.replace("seed = -1\n", "\n")) == (
        "line 5: run.duration_s: got '10 s': input should be a valid number [s], 0 < … (default 10.0)",
        "line 6: run.dt_s: got 0.5 s, must be at most a 10th of the gait's period, 2 s, or the wave falls between the "
        "steps",
        "line 9: worm.length_m: got true: input should be a valid number [m], 0 < … <= 100 (default 1.0)",
        "line 10: worm.segments: got 6.5: input should be a valid integer, 1 <= … <= 200 (default 6)",
        "line 11: worm.connector_mass_kg: got 1.0 kg, must lie between 0 and mass (1e-08 kg)",
        "line 14: gait.lamda_m: unknown key; did you mean 'wavelength_m'?",
        f"line 15: gait.kind: got 'traveling_wave': input should be {GAIT_KINDS}; did you mean 'travelling_wave'? "
        "(default 'travelling_wave')",
        "line 17: frictoin: unknown section; did you mean 'friction'?",
    )


def test_the_same_eight_with_an_unknown_model() -> None:
    text = EIGHT.replace("seed = -1\n", "\n").replace('"planar_published"', '"planar_publised"')
    first, *others = lines_about(text)
    assert first == (
        "line 1: model: got 'planar_publised': must be one of 'worm', 'worm_control', 'load_frame', 'worm_planar', "
        "'planar_published', 'planar_linkage'; did you mean 'planar_published'? "
        "(the rest is checked as 'planar_published')"
    )
    assert len(others) == 8


def test_a_missing_model_does_not_hide_the_rest() -> None:
    assert lines_about("worm = 3\n") == (
        "line 1: model: missing: must be one of 'worm', 'worm_control', 'load_frame', 'worm_planar', "
        "'planar_published', 'planar_linkage' (the rest is checked as 'worm')",
        "line 1: worm: got 3: must be a section of keys under the header [worm]",
    )


def test_a_misspelt_key_silences_the_checks_of_the_key_it_was_meant_to_be() -> None:
    text = 'model = "planar_published"\n[run]\ndt_s = 0.4\n[gait]\nperiod = 4.0\n'
    assert lines_about(text) == ("line 5: gait.period: unknown key; did you mean 'period_s'?",)


@pytest.mark.parametrize(
    ("sections", "line"),
    [
        ("[run]\nduration_s = 0.001", "run.duration_s: got 0.001 s: must be at least run.dt_s (0.01 s)"),
        (
            "[run]\ndt_s = 1e-12",
            "run.dt_s: got 1e+13 steps of 6 segments, about 4.65e+07 GB of memory: must be at most 4 GB; use a "
            "shorter run.duration_s, a longer run.dt_s or fewer worm.segments",
        ),
        (
            "[run]\nrecord_every = 7",
            "run.record_every: got 7: must divide the 1000 steps of the run (run.duration_s / run.dt_s), or its last "
            "state is not stored; 5 does",
        ),
        (
            "[run]\nduration_s = 9.99\n[gait]\nrectified = true\n[worm]\nsegments = 6\n[solver]\nelastic_sign = true",
            "solver.elastic_sign: got true: input should be -1 or 1 (default -1)",
        ),
        ("[solver]\nelastic_sign = 1.0", "solver.elastic_sign: got 1.0: input should be -1 or 1 (default -1)"),
        ('[solver]\nelastic_sign = "1"', "solver.elastic_sign: got '1': input should be -1 or 1 (default -1)"),
        (
            "[gait]\nperiod_s = 0.05",
            "gait.period_s: run.dt_s: got 0.01 s, must be at most a 10th of the gait's period, 0.05 s, "
            "or the wave falls between the steps",
        ),
        (
            '[gait]\nkind = "segment_driven"\nperiod_s = 0.2',
            "gait.period_s: gait.contract_time_s: got 0.25 s, must be at most gait.period_s (0.2 s): a segment must "
            "end its contraction before it is activated again",
        ),
        (
            "[worm]\nmass_kg = 1e-12",
            "worm.mass_kg: worm.connector_mass_kg: got 1e-11 kg, must lie between 0 and mass (1e-12 kg)",
        ),
        (
            "[gait]\ncontract_time_s = 0.3",
            "gait.contract_time_s: only for gait.kind = 'segment_driven', but this scene has 'travelling_wave': "
            "leave it out (default 0.25), or change gait.kind",
        ),
        (
            "[gait]\nalternating = false",
            "gait.alternating: only for gait.kind = 'segment_driven', but this scene has 'travelling_wave': "
            "leave it out (default true), or change gait.kind",
        ),
        (
            '[gait]\nkind = "segment_driven"\nwavelength_m = 0.5',
            "gait.wavelength_m: only for gait.kind = 'travelling_wave', but this scene has 'segment_driven': "
            "leave it out (default 1.0), or change gait.kind",
        ),
        (
            "[run]\nrecord_every = 1002",
            "run.record_every: got 1002: must be at most run.duration_s / run.dt_s, the 1000 steps of the run",
        ),
        (
            '[gait]\nkind = "segment_driven"\ncontract_time_s = 2.5',
            "gait.contract_time_s: got 2.5 s, must be at most gait.period_s (2.0 s): a segment must end its "
            "contraction before it is activated again",
        ),
        (
            '[gait]\nkind = "segment_driven"\ncontract_time_s = 0.005',
            "gait.contract_time_s: run.dt_s: got 0.01 s, must be at most gait.contract_time_s, 0.005 s, or the steps "
            "miss the contraction",
        ),
        (
            '[gait]\nkind = "segment_driven"\ndirection = "standing"',
            "gait.direction: got 'standing': not for gait.kind = 'segment_driven'; allowed here: 'direct', "
            "'retrograde'",
        ),
    ],
)
def test_keys_that_do_not_go_together(sections: str, line: str) -> None:
    found = lines_about(f'model = "planar_published"\n{sections}\n')
    assert [re.sub(r"line \d: ", "", each) for each in found] == [line]


def test_one_slip_in_the_time_step_gives_one_line() -> None:
    assert len(lines_about('model = "planar_published"\n[run]\ndt_s = 20.0\n')) == 1


def test_independent_mistakes_on_one_key_give_a_line_each() -> None:
    """Another step mends neither without the other's limit: each has a key of its own that was written."""
    text = 'model = "planar_published"\n[run]\ndt_s = 0.5\nduration_s = 0.1\n[gait]\nperiod_s = 0.01\n'
    assert [line[: line.index(" s") + 2] for line in lines_about(text)] == ["line 3: run.dt_s: got 0.5 s"] * 2
    assert "run.duration_s (0.1 s)" in "".join(lines_about(text))
    assert "the gait's period, 0.01 s" in "".join(lines_about(text))


def test_a_check_fails_at_its_limit_and_not_by_rounding() -> None:
    def scene(dt: float) -> str:
        return f'model = "planar_published"\n[run]\ndt_s = {dt!r}\nduration_s = 0.7\n[gait]\nperiod_s = 0.7\n'

    assert 0.07 * 10 > 0.7
    parse_scene(scene(0.07), "test")
    assert len(lines_about(scene(0.0701))) == 1
    one_step = f'model = "planar_published"\n[run]\ndt_s = {3 * 0.1!r}\nduration_s = 0.3\n[gait]\nperiod_s = 4.0\n'
    assert 3 * 0.1 > 0.3
    parse_scene(one_step, "test")


@pytest.mark.parametrize("model", ["planar_published", "planar_linkage"])
def test_scenes_that_do_not_fit_into_memory_are_refused(model: str) -> None:
    (line,) = lines_about(f'model = "{model}"\n[run]\nduration_s = 200000\n')
    assert line.startswith("line 3: run.duration_s: got ")
    assert line.endswith(
        " GB of memory: must be at most 4 GB; use a shorter run.duration_s, a longer run.dt_s or fewer worm.segments"
    )
    parse_scene(f'model = "{model}"\n[run]\nduration_s = 500\n', "test")


def test_a_key_of_the_other_kind_at_its_default_does_nothing_and_passes() -> None:
    """Templates and resolved scenes hold every key."""
    parse_scene('model = "planar_published"\n[gait]\ncontract_time_s = 0.25\n', "test")


@pytest.mark.parametrize("key", ["run", "a.b"])
def test_a_section_written_twice_is_named_as_it_is_written(key: str) -> None:
    assert lines_about(f"[{key}]\n[{key}]\n")[0].startswith("line 2, ")
    assert f"cannot declare '{key}' twice" in lines_about(f"[{key}]\n[{key}]\n")[0]


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("gait.period_s=0", "override gait.period_s: got 0: input should be greater than 0 [s], 0 < … (default that"),
        ("gait.period_s=2 s", "override gait.period_s: got '2 s': input should be a valid number [s], 0 < …"),
        ("gait.perido_s=3", "override gait.perido_s: unknown key; did you mean 'period_s'?"),
        ("gaits.period_s=3", "override gaits.period_s: gaits: unknown section; did you mean 'gait'?"),
        (
            "controller.kind=mpc",
            "override controller.kind: controller: unknown section; known here: model, title, says, seed, run, worm, "
            "friction, gait, ground, solver; scenes with model = 'worm_control' have it",
        ),
        ("worm=3", "override worm: got 3: must be a section of keys under the header [worm]"),
        ("seed.x=3", "override seed.x: seed: got {x = 3}: input should be a valid integer"),
        ("gait.period_s", "override gait.period_s: must be written as section.key=value"),
        ("=3", "override : must be written as section.key=value"),
        (
            "gait.period_s=0.05",
            "override gait.period_s: run.dt_s: got 0.01 s, must be at most a 10th of the gait's period, 0.05 s",
        ),
    ],
)  # fmt: skip
def test_overrides_are_checked_like_the_file(override: str, line: str) -> None:
    found = lines_about('model = "planar_published"\n', override)
    assert len(found) == 1
    assert found[0].startswith(line)


def test_override_below_a_plain_value() -> None:
    text = 'model = "planar_published"\n[worm]\nlength_m = 1.0\n'
    assert lines_about(text, "worm.length_m.x=3") == (
        "override worm.length_m.x: worm.length_m is not a section, it has no keys",
    )


def test_overrides_are_toml_or_bare_words() -> None:
    overrides = ("gait.direction=retrograde", "gait.rectified=false", "run.duration_s=1", 'title="a = b"', "seed=0x10")
    settings = load_scene("planar_published", overrides).settings
    assert settings.gait.direction == "retrograde"  # type: ignore[attr-defined]
    assert settings.gait.rectified is False  # type: ignore[attr-defined]
    assert (settings.run.duration_s, settings.title, settings.seed) == (1.0, "a = b", 16)


def test_an_override_mends_the_file() -> None:
    text = 'model = "planar_published"\n[worm]\nsegments = 0\n'
    assert parse_scene(text, "test", ["worm.segments=4"]).settings.worm.segments == 4  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "first", "source", "column"),
    [
        ('a = 1\n[run]\n\tdt_s = = 3\n', "line 3, column 9: broken TOML: invalid value", " dt_s = = 3", 9),
        ("[run\n", "line 1, column 5: broken TOML: expected ']' at the end of a table declaration", "[run", 5),
        ("[run]\na = 1\na = 2\n", "line 3, column 6: broken TOML: cannot overwrite a value", "a = 2", 6),
        ("x = [1,\n\n", "line 1, column 8: broken TOML: invalid value", "x = [1,", 8),
    ],
)  # fmt: skip
def test_broken_toml_shows_the_place(text: str, first: str, source: str, column: int) -> None:
    assert lines_about(text) == (first, f"    {source}", f"    {' ' * (column - 1)}^")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"a = {'[' * 5000}", "broken TOML: the brackets are nested too deeply"),
        (f"a = {'9' * 5000}", "broken TOML: a number has thousands of digits"),
    ],
)
def test_absurd_toml(text: str, line: str) -> None:
    assert lines_about(text) == (line,)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("empty.toml", b" \n", "the file is empty; 'worm3d init FILE' writes a scene to start from"),
        ("latin.toml", b"title = '\xe9'", "not a text in UTF-8 (byte 10); save it as UTF-8"),
    ],
)
def test_files_that_are_no_scenes(tmp_path: Path, name: str, content: bytes, sentence: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SceneError, match=re.escape(f"{path}: {sentence}")):
        load_scene(path)


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "notepad.toml"
    path.write_bytes(b'\xef\xbb\xbfmodel = "planar_published"\r\n')
    assert load_scene(path).name == "notepad"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("planar_publised", "unknown scene 'planar_publised'; did you mean 'planar_published'? 'worm3d list' names"),
        ("zzz", "unknown scene 'zzz'; 'worm3d list' names all scenes"),
        ("zzz.toml", "zzz.toml: no such file; 'worm3d init zzz.toml' writes a scene to start from"),
        ("/", "/ is a folder; a scene is a TOML file or one of the names of 'worm3d list'"),
    ],
)  # fmt: skip
def test_scenes_that_are_not_there(name: str, sentence: str) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        load_scene(name)


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_are_right_and_say_what_to_see(name: str) -> None:
    assert load_scene(name).settings.says


@pytest.mark.parametrize("name", shipped_scenes())
def test_the_resolved_scene_is_a_scene_and_resolves_to_itself(name: str) -> None:
    scene = load_scene(SHIPPED_FOLDER / f"{name}.toml", ['title=quo"te \\ \x7f é'])
    again = parse_scene(scene.to_toml(), name)
    assert again.settings == scene.settings
    assert again.to_toml() == scene.to_toml()


@pytest.mark.parametrize("kind", GAITS)
def test_what_a_scene_leaves_out_is_the_default_of_its_gait(kind: str) -> None:
    scene = parse_scene(f'model = "worm"\n[gait]\nkind = "{kind}"\n', "mine")
    made, usual = gait_from(scene.settings.gait, 0.01), GAITS[kind]()
    for name in parameters_of(GAITS[kind]).keys() - {"impulse"}:
        assert getattr(made, name) == pytest.approx(getattr(usual, name)), name
    assert parse_scene(scene.to_toml(), "mine").settings == scene.settings


def test_checks_know_the_default_of_the_kind() -> None:
    """The period of `steered` is 1.25 s: a step of 0.16 s is too long for it, and not for one of 2 s."""
    written = 'model = "worm"\n[gait]\nkind = "{}"\n[run]\ndt_s = 0.16\n'
    with pytest.raises(SceneError, match=r"line 5: run.dt_s: got 0.16 s, must be at most a 10th .* 1.25 s"):
        parse_scene(written.format("steered"), "mine")
    assert parse_scene(written.format("travelling_wave"), "mine").settings.gait.period_s == 2.0
    with pytest.raises(SceneError, match=r"that of its kind: 2 for travelling_wave, .*; 1.25 for steered"):
        parse_scene('model = "worm"\n[gait]\nperiod_s = -1\n', "mine")


OWN_CONTROLLER = """
from control.parts import part


@part("controller")
class Own:
    @classmethod
    def of(cls, *given): ...
"""


@pytest.mark.parametrize(("written", "steers"), [("", "both"), ("pi_los", "hinge"), ("my_steered:Own", "hinge")])
def test_the_mechanism_that_is_left_out_is_that_of_the_controller(
    written: str, steers: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_steered.py").write_text(OWN_CONTROLLER)
    monkeypatch.syspath_prepend(tmp_path)
    kind = (f"controller.kind={written}",) if written else ()
    assert load_scene("path_line", kind).settings.controller.mechanism == steers
    assert load_scene("path_line", (*kind, "controller.mechanism=bias")).settings.controller.mechanism == "bias"
