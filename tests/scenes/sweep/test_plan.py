from __future__ import annotations

import pickle
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from scenes.language.errors import SceneError
from scenes.language.loader import find_scene
from scenes.models.loading import load_scene, parse_scene, trusted_scene
from scenes.running import packages
from scenes.sweep import key as keys
from scenes.sweep.engine import Sweep
from scenes.sweep.key import key_of
from scenes.sweep.plan import LARGEST_SEED, Plan, Source, _seeded, planned

SHORT = ("run.duration_s=0.5",)


def plan(vary: dict[str, Any] | None = None, *overrides: str, scene: str = "planar_wave", **options: Any) -> Plan:
    return planned(Source.of(scene, (*SHORT, *overrides)), vary, **options)


def refused(*arguments: Any, **options: Any) -> list[str]:
    with pytest.raises(SceneError) as error:
        plan(*arguments, **options)
    return list(error.value.lines)


def test_each_case_is_the_scene_with_its_values_and_a_seed_of_its_own() -> None:
    found = plan({"gait.period_s": [2, 3], "gait.direction": "direct,retrograde"})
    assert len(found.cases) == 4
    for case in found.cases:
        job = Sweep(found, Path("/x"))._job(case)
        written = tomllib.loads(job.scene)
        assert written["gait"]["period_s"] == case.values["gait.period_s"]
        assert written["gait"]["direction"] == case.values["gait.direction"]
        assert written["run"]["duration_s"] == 0.5
        assert 0 < written["seed"] == case.seed <= LARGEST_SEED
        assert job.path == f"/x/cases/{job.key}.json"
        assert pickle.loads(pickle.dumps(job)) == job
        assert key_of(trusted_scene(tomllib.loads(job.scene), job.name)) == job.key
    assert len({case.seed for case in found.cases}) == 4


def test_a_seed_does_not_depend_on_the_order_in_which_keys_are_named() -> None:
    """Keys come as a set, whose order differs from process to process; a seed is a whole number that a double holds."""
    scene, keys = load_scene("planar_wave"), ["gait.amplitude", "gait.period_s", "worm.segments"]
    seeds = {_seeded(scene, 7, order, {}).settings.seed for order in (keys, keys[::-1], [*keys[1:], keys[0]])}
    assert len(seeds) == 1
    assert _seeded(scene, 8, keys, {}).settings.seed not in seeds
    assert float(LARGEST_SEED) == LARGEST_SEED
    assert float(LARGEST_SEED + 2) != LARGEST_SEED + 2


def test_a_seed_depends_on_base_seed_and_values_not_on_order_nor_on_other_cases() -> None:
    one = {
        tuple(sorted(case.values.items())): case
        for case in plan({"gait.period_s": "2,3", "gait.amplitude": "0.1,0.2"}).cases
    }
    other = plan({"gait.amplitude": "0.2", "gait.period_s": "3.0,2.5,2"}).cases
    for case in (other[0], other[2]):
        earlier = one[tuple(sorted(case.values.items()))]
        assert (earlier.seed, earlier.key) == (case.seed, case.key), "3 and 3.0 seconds are the same"
    text = (
        find_scene("planar_wave").read_text().replace('model = "planar_linkage"', 'model = "planar_linkage"\nseed = 1')
    )
    based = planned(Source(text, "planar_wave", None, SHORT), {"gait.amplitude": "0.2", "gait.period_s": "3"}).cases[0]
    assert based.seed != other[0].seed


def test_a_seed_that_is_varied_or_fixed_is_taken_as_given() -> None:
    assert [case.seed for case in plan({"seed": "0:3:4"}).cases] == [0, 1, 2, 3]
    assert [case.seed for case in plan({"gait.period_s": "2,3"}, "seed=7").cases] == [7, 7]


def test_the_key_is_of_scene_programs_files_and_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = key_of(load_scene("planar_wave"))
    assert key_of(load_scene("planar_wave", ["run.dt_s=0.01"])) == now
    assert key_of(load_scene("planar_wave", ["seed=1"])) != now
    with monkeypatch.context() as patch:
        patch.setattr(keys, "sources", lambda: "other")
        assert key_of(load_scene("planar_wave")) != now
    mesh = (packages.HOME / "scenes" / "mesh_tunnel.stl").read_bytes()
    (tmp_path / "tunnel.stl").write_bytes(mesh)
    of_file = [f"world.file={tmp_path / 'tunnel.stl'}"]
    before = key_of(load_scene("mesh_tunnel", of_file))
    (tmp_path / "tunnel.stl").write_bytes(mesh[:70] + b"x" + mesh[71:])  # of its title
    assert key_of(load_scene("mesh_tunnel", of_file)) != before
    controlled = load_scene("path_line")
    with_map = key_of(controlled)
    monkeypatch.setattr(sys.modules["scenes.models.control.build"], "loaded", lambda scene, wave: None)
    assert key_of(controlled) != with_map


def test_the_key_is_of_the_code_of_a_users_own_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = "from control.parts import part\nfrom control.tracking.paths import Line\n\n\n@part('path')\ndef own():\n"
    (tmp_path / "keyed_path.py").write_text(own + "    return Line(azimuth=0.5)\n")
    monkeypatch.syspath_prepend(tmp_path)
    scene = load_scene("path_line", ["reference.kind=keyed_path:own"])
    before = key_of(scene)
    assert key_of(scene) == before
    (tmp_path / "keyed_path.py").write_text(own + "    return Line(azimuth=0.25)\n")
    assert key_of(scene) != before
    monkeypatch.delitem(sys.modules, "keyed_path")


def test_mistakes_are_told_once_with_the_values_of_the_first_case_that_has_them() -> None:
    wide = {"gait.period_s": "0.01,0.02", "gait.amplitude": "0.1,0.2"}
    assert refused(wide) == [
        "with gait.period_s = 0.01, gait.amplitude = 0.1 (and 3 cases more): gait.period_s: run.dt_s: got 0.01 s, "
        "must be at most a 10th of the gait's period, 0.01 s, or the wave falls between the steps"
    ]
    assert refused({"gait.perod_s": "1,2"}) == ["gait.perod_s: unknown key; did you mean 'period_s'?"]
    assert refused({"gait.perod_s": "1,2"}, "worm.sgments=3") == [
        "override worm.sgments: unknown key; did you mean 'segments'?"
    ]
    (line, last) = refused({"gait.period_s": "-2:-1:2000"})
    assert line.startswith("with gait.period_s = -2.0 (and 19 cases more): gait.period_s: got -2")
    assert last == "20 of the first 20 cases are invalid; the other 1980 were not checked"
    twice = {"worm.segments": 4, "gait.period_s": 4, "gait.amplitude": 0.2, "seed": 4, "gait.direction": "direct"}
    assert refused(dict.fromkeys(twice, "2,3"), *(f"{key}={value}" for key, value in twice.items())) == [
        "gait.amplitude: both varied and fixed by an override (-o); leave one of them out"
    ]


def test_a_case_with_two_mistakes_has_a_line_for_each_kind_with_its_own_words() -> None:
    lines = refused({"gait.period_s": "-1,-2", "worm.segments": "0"})
    assert [line.partition(": ")[2].partition(":")[0] for line in lines] == ["gait.period_s", "worm.segments"]
    assert all(line.startswith("with gait.period_s = -1, worm.segments = 0 (and 1 case more): ") for line in lines)
    assert ["got -1" in line for line in lines] == ["got 0" not in line for line in lines] == [True, False]


SWEPT = """
model = "planar_linkage"
[run]
duration_s = 0.5
"""


@pytest.mark.parametrize(
    ("section", "cases"),
    [
        ('[sweep]\nvary = { "worm.segments" = [3, 4], "gait.period_s" = "1:3:2" }', 4),
        ("[sweep.vary]\nworm.segments = [3, 4]\ngait.period_s = [1.0, 3.0]", 4),
        ("[sweep]\nrandom = 3\nvary.gait.period_s = '1:3'", 3),
    ],
)
def test_a_scene_may_say_itself_what_is_varied(section: str, cases: int) -> None:
    found = planned(Source(f"{SWEPT}\n{section}", "swept"))
    assert len(found.cases) == cases
    assert "sweep" not in found.base.to_toml()
    asked = planned(Source(f"{SWEPT}\n{section}", "swept"), {"gait.amplitude": "0.1,0.2"})
    assert [each.key for each in asked.design.varied] == ["gait.amplitude"], "the command line wins"
    listed = [{"gait.amplitude": 0.1}, {"gait.amplitude": 0.3}]
    tabled = planned(Source(f"{SWEPT}\n{section}", "swept"), listed=listed)
    assert [case.values for case in tabled.cases] == listed, "and so does a table of cases"


@pytest.mark.parametrize(
    ("section", "complaint"),
    [
        ("[sweep]\nvaried = 3", "line 6: sweep.varied: unknown key; did you mean 'vary'?"),
        ("[sweep]\nvary = 3", "line 6: sweep.vary: got 3: input should be a table"),
        ("sweep = 3", "line 5: run.sweep: unknown key"),
        ("[sweep]\nrandom = 0\nvary = {}", "line 6: sweep.random: got 0: input should be greater than or equal to 1"),
        ("[sweep]\nrandom = 3", "sweep.vary: missing"),
    ],
)
def test_a_wrong_section_is_told_by_its_line(section: str, complaint: str) -> None:
    with pytest.raises(SceneError) as error:
        parse_scene(f"{SWEPT}{section}", "swept")
    assert complaint in str(error.value)


def test_cases_that_only_their_combination_makes_impossible_are_refused_and_the_others_go_on() -> None:
    found = plan({"gait.period_s": "0.01,2", "gait.amplitude": "0.1,0.2"})
    assert [bool(case.refused) for case in found.cases] == [True, True, False, False]
    assert found.cases[0].refused.startswith("gait.period_s: run.dt_s: got 0.01 s, must be at most a 10th")
    lines = refused({"gait.period_s": "0.01,2,-1"})
    assert len(lines) == 1, "a value that is wrong for any scene stops all"
    assert lines[0].startswith("with gait.period_s = -1: gait.period_s: got -1: input should be greater than")
    strong = plan({"worm.spring_N": "1,800"}, "worm.mass_kg=2", scene="flat")
    assert [bool(case.refused) for case in strong.cases] == [True, False], (
        "the scene that is varied need not be possible"
    )
    controlled = plan({"worm.mass_kg": "2,0.1"}, scene="path_line")
    assert [bool(case.refused) for case in controlled.cases] == [True, False]


def test_what_cases_share_is_tested_again_where_a_case_changes_it() -> None:
    draft = Source.of("flat", ["run.duration_s=5"])
    draft.parse(["gait.period_s=3"])
    for wrong in ("worm.segments=2", "run.dt_s=6.0", "worm.mass_kg=100.0", "gait.period_s=0.01"):
        with pytest.raises(SceneError) as once:
            load_scene("flat", ["run.duration_s=5", wrong])
        with pytest.raises(SceneError) as again:
            draft.parse([wrong])
        assert again.value.lines == once.value.lines
    assert (
        draft.parse(["gait.period_s=3"]).to_toml()
        == load_scene("flat", ["run.duration_s=5", "gait.period_s=3"]).to_toml()
    )
