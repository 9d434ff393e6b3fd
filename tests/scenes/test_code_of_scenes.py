"""A scene with `module:NAME` is a program, and no other scene is: what is called, when, and what ends it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import strangers

import worm3d as package
from control.parts import PART_KINDS, part
from scenes import models
from scenes.language import toml
from scenes.language.errors import SceneError
from scenes.language.reading import read
from scenes.language.schema import keys_in
from scenes.models.control.record import tracked
from scenes.models.control.reference import reference_of
from scenes.models.control.view import path_seen, reference_seen
from scenes.models.loading import load_scene
from scenes.models.worm.view import scene_of
from scenes.records.store import load, save
from scenes.running.runner import simulate
from worm3d.values import named

STRANGERS = strangers.__file__
BRIEF = ("run.duration_s=3", "run.record_every=4")
MODULE = """
from pathlib import Path

from control.baselines import PiLineOfSight
from control.estimation.estimator import Estimator
from control.parts import part
from control.planning.terms import CostTerm
from control.tracking.paths import Circle, SCurve

with Path("imported").open("a") as file:
    file.write("x")

CIRCLE = Circle(0.6)
CURVE = SCurve(0.05, 1.0)


class Mine(PiLineOfSight):
    def _choose(self, t, estimate):
        if END == "never" and t > 0.5:
            while True:
                pass
        if END and t > 0.5:
            raise SystemExit(END)
        return super()._choose(t, estimate)


@part("controller")
class Ends:
    of = classmethod(lambda cls, *given: cls())

    def reset(self): ...

    def step(self, t, measurement):
        raise SystemExit(0)


class Leaves(Circle):
    def project(self, *given):
        raise SystemExit(0)


LEAVES = Leaves(1.0)


@part("controller")
class Unbuilt(Ends):
    @classmethod
    def of(cls, *given):
        Path("built").touch()
        raise SystemExit(0)


END = None
"""


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    file = tmp_path / "own_code.py"
    file.write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield file
    sys.modules.pop("own_code", None)


def tried(*arguments: object, before: str = "pass") -> dict[str, list[str]]:
    program = f"import strangers; {before}; strangers.main(*{arguments})"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=Path(STRANGERS).parent
    )
    found: dict[str, list[str]] = json.loads(done.stdout)
    return found


@pytest.mark.slow
def test_nothing_that_happens_to_be_installed_is_called() -> None:
    """200 classes and functions of installed distributions in each of the keys that take `module:NAME`."""
    assert tried(0, 200) == {"tried": 200, "called": [], "accepted": []}


@pytest.mark.slow
def test_a_call_would_be_noticed() -> None:
    """The same where all that there is counts as marked; a few names are refused for other reasons."""
    keys = "{key: kind for key, kind in strangers.KEYS.items() if kind in ('term', 'path', 'world', 'fault')}"
    ready = f"strangers.TRIED = {{'path_line': {keys}}}"
    marked = "from worm3d.values.named import Kind; Kind.marks = lambda *given: True"
    called = tried(0, 8, before=f"{ready}; {marked}")["called"]
    assert {call.partition("=")[0].partition('."')[0] for call in called} == {
        "cost.parts",
        "fault",
        "reference.kind",
        "world.kind",
    }


def test_each_key_that_takes_a_part_of_a_module_is_tried() -> None:
    for name, keys in strangers.TRIED.items():
        schema, takes = load_scene(name).model.schema, set()
        for section, known in keys_in(schema).items():
            for key, kind in getattr(known.section, "holds", {}).items():
                takes.add((f"{section}.{key}".rstrip("."), kind.name))
            for key, inner in keys_in(known.section).items() if known.section else ():
                takes |= {(f"{section}.{key}", kind.name) for kind in getattr(inner.table, "holds", {}).values()}
        tried_here = {(key.partition("=")[0].removesuffix('."{}"'), kind) for key, kind in keys.items()}
        assert tried_here <= takes
        others = {key.partition("=")[0].removesuffix('."{}"') for key in strangers.KEYS}
        assert {key for key, _ in takes} <= {key for key, _ in tried_here} | others
    asked = {kind for keys in strangers.TRIED.values() for kind in keys.values()}
    assert asked == {*PART_KINDS}


def test_only_keys_that_hold_parts_take_the_name_of_one() -> None:
    for model in map(models.get, models.names()):
        for name, declared in keys_in(model.schema).items():
            for key, known in keys_in(declared.section).items() if declared.section else ():
                for given in ("a:B", ("a:B",)):
                    _, wrong = read(declared.section, {key: given})
                    passes = (key,) not in {each.path[:1] for each in wrong}
                    assert not (passes and known.choices) or key in declared.section.holds, f"{name}.{key}"


@pytest.mark.parametrize("value", ["os:abort", "sys:exit", "http.server:test", "antigravity:fly_to", "pip.__main__:x"])
@pytest.mark.parametrize(("scene", "key"), [(scene, key) for scene, keys in strangers.TRIED.items() for key in keys])
def test_modules_of_python_and_programs_are_not_even_imported(scene: str, key: str, value: str) -> None:
    imported = {*sys.modules}
    with pytest.raises(SceneError, match=f"{value.partition(':')[0]}") as caught:
        load_scene(scene, [key.format(value)])
    assert len(caught.value.lines) == 1
    assert not {"antigravity", "pip.__main__", "http.server"} & ({*sys.modules} - imported)


@pytest.mark.slow
def test_what_ends_a_program_ends_none(console) -> None:
    for value in ("os:abort", "sys:exit", "http.server:test"):
        ended = console("check", "path_line", "-o", f'constraints.parts=["roll", "{value}"]')
        assert (ended.code, ended.out, len(ended.complaints)) == (2, "", 1)
        assert "is a module of Python itself" in ended.err


def test_a_check_builds_no_controller(worm3d, tmp_path: Path) -> None:
    ended = worm3d("check", "path_line", "-o", "controller.kind=own_code:Unbuilt")
    assert ended.code == 0
    assert not (tmp_path / "built").exists()
    ended = worm3d("run", "path_line", "-o", "controller.kind=own_code:Unbuilt", "--out", "x")
    assert (ended.code, ended.complaints[-1]) == (2, "controller: own_code:Unbuilt: SystemExit: 0")


@pytest.mark.parametrize("command", ["check", "run", "sweep"])
def test_scenes_that_name_a_module_are_refused_without_code(worm3d, tmp_path: Path, command: str) -> None:
    more = {"check": (), "run": ("--out", "x"), "sweep": ("--vary", "run.duration_s=1,2", "--out", "x")}[command]
    for scene, key in [(scene, key) for scene, keys in strangers.TRIED.items() for key in keys]:
        ended = worm3d(command, scene, "-o", key.format("own_code:CIRCLE"), *more, "--no-code")
        assert ended.code == 2
        assert "own_code:CIRCLE is code of a module, refused here (--no-code)" in ended.err
    assert not (tmp_path / "imported").exists()
    assert not (tmp_path / "x").exists()
    assert worm3d("check", "path_line", "--no-code").code == 0
    assert worm3d("check", "path_line", "-o", "reference.kind=own_code:CIRCLE").code == 0, "the next command is free"


def test_the_mark_says_the_kind() -> None:
    @part("term")
    @part("path")
    def both() -> None: ...

    assert [name for name, kind in PART_KINDS.items() if kind.marks(both)] == ["term", "path"]
    with pytest.raises(ValueError, match=r"part: got 'Bare', must be one of 'gait', .*: @part\('controller'\)"):

        @part
        class Bare: ...

    with pytest.raises(ValueError, match="got 'controler', must be one of"):
        part("controler")
    with pytest.raises(TypeError, match="got an object of int, must be a class or a function"):
        part("path")(3)


def test_what_claims_to_be_anything_is_not_asked() -> None:
    """Objects that answer to any name, and classes of a metaclass that does, are not marked, and run nothing."""

    class Any(type):
        def __getattribute__(cls, name):
            raise AssertionError(name)

    class Chameleon:
        def __getattribute__(self, name):
            raise AssertionError(name)

    for thing in (Chameleon(), Any("Thing", (), {})):
        assert not any(kind.marks(thing) for kind in PART_KINDS.values())
        assert "Chameleon" in named._described(thing) or "Thing" in named._described(thing)


def test_a_part_that_ends_the_program_has_failed(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "path_line", *("-o", "run.duration_s=1"), "-o", "controller.kind=own_code:Ends", "--out", "x")
    assert ended.code == 0
    assert "Ends raised an exception in 100 of 100 steps, and the worm rested: SystemExit: 0" in ended.err
    assert (tmp_path / "x" / "result.nc").is_file()
    leaves = ("-o", "reference.kind=own_code:LEAVES", "-o", "run.duration_s=1")
    ended = worm3d("run", "path_line", *leaves, "--out", "y")
    assert (ended.code, ended.complaints[-1]) == (2, "path_line: a part of your own raised SystemExit(0)")


def test_a_choice_that_ends_the_program_is_a_failed_one(own: Path) -> None:
    own.write_text(MODULE.replace("END = None", "END = 7"))
    record = simulate(load_scene("path_line", (*BRIEF, "controller.kind=own_code:Mine")))
    assert record.status == "done"
    assert "SystemExit: 7" in record.variable("decision_status").long_name


def test_a_case_that_ends_the_program_has_failed(worm3d, tmp_path: Path) -> None:
    vary = ("--vary", "reference.kind=line,own_code:LEAVES,circle", "--vary", "run.dt_s=0.01")
    ended = worm3d("sweep", "path_line", "-o", "run.duration_s=1", *vary, "--vary", "seed=1", "--out", "x")
    assert ended.code == 5
    assert "failed: path_line: a part of your own raised SystemExit(0)" in ended.err
    assert "3 of 3 cases, 1 failed" in ended.out


LOOKS = (
    ("view", "a", "--no-open"),
    ("plot", "a"),
    ("export", "a", "--csv", "a.csv", "--npz", "a.npz", "--glb", "a.glb"),
    ("compare", "a", "b", "--out", "c"),
)


@pytest.mark.parametrize(
    ("hangs", "workers"), [("sleep(9)", ()), pytest.param("sleep(1e9)", ("--workers", "1"), marks=pytest.mark.slow)]
)
def test_a_case_that_never_ends_has_a_time_limit(
    worm3d, tmp_path: Path, own: Path, hangs: str, workers: tuple[str]
) -> None:
    """Between steps in this process; a worker is replaced, even within a step."""
    own.write_text(f"from time import sleep\n{MODULE}".replace("while True:\n                pass", hangs + "\n"))
    own.write_text(own.read_text().replace("END = None", 'END = "never"').replace("if END and", "if False and"))
    vary = ("--vary", "controller.kind=own_code:Mine,open_loop", "--vary", "run.dt_s=0.01", "--vary", "seed=1")
    command = ("sweep", "path_line", "-o", "run.duration_s=0.7", *vary, *workers, "--out", "x")
    ended = worm3d(*command, "--case-limit-s", "8")
    assert ended.code == 5
    assert "failed: took longer than 8 s, the time limit of a case: give cases more time by --case-limit-s" in ended.err
    assert "2 of 2 cases, 1 failed" in ended.out
    assert len([*(tmp_path / "x" / "cases").iterdir()]) == 1, "the case that was late has no file"
    own.write_text(MODULE)
    sys.modules.pop("own_code", None)
    again = worm3d(*command)
    assert again.code == 0
    assert again.complaints[1].startswith("path_line: 1 of 2 cases, 1 kept from before")
    assert again.complaints[0] == f"runs code of the module own_code ({own})"


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "inf", "1e9"])
def test_a_time_limit_has_a_range(worm3d, tmp_path: Path, limit: str) -> None:
    vary = ("--vary", "gait.period_s=1,2", "--out", "x")
    ended = worm3d("sweep", "planar_published", *vary, "--case-limit-s", limit)
    assert (ended.code, len(ended.complaints)) == (2, 1)
    assert "--case-limit-s: got" in ended.err
    assert not (tmp_path / "x").exists()


def test_a_scene_with_a_sweep_has_a_time_limit_of_its_own(worm3d, tmp_path: Path) -> None:
    swept = 'model = "planar_published"\n[run]\nduration_s = 20.0\n[sweep]\ncase_limit_s = {}\n'
    vary = 'vary = { "gait.period_s" = [1], "run.dt_s" = 0.0001, "friction.forward" = 0.03 }\n'
    (tmp_path / "swept.toml").write_text(swept.format("-1") + vary)
    assert "sweep.case_limit_s: got -1" in worm3d("check", "swept.toml").err
    (tmp_path / "swept.toml").write_text(swept.format("0.01") + vary)
    ended = worm3d("run", "swept.toml", "--out", "x")
    assert (ended.code, "took longer than 0.01 s" in ended.err) == (5, True)


@pytest.mark.slow
def test_results_are_looked_at_without_the_code_they_were_made_with(worm3d, tmp_path: Path, own: Path) -> None:
    """The module is another one meanwhile, which leaves a file where it is imported, and then is gone."""
    asked = (
        "controller.kind=own_code:Mine",
        "reference.kind=own_code:CIRCLE",
        "controller.estimator=own_code:Estimator",
    )
    save(simulate(load_scene("path_line", (*BRIEF, *asked))), tmp_path / "result.nc")
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        shutil.copy("result.nc", folder)
    sys.modules.pop("own_code")
    own.write_text(MODULE.replace('"imported"', '"imported again"'))
    for command in LOOKS:
        ended = worm3d(*command)
        assert ended.code == 0, (command, ended.err)
    own.unlink()
    assert worm3d("view", "a", "--no-open").code == 0
    assert package.load("a").com.shape == load(tmp_path / "a")["com"].shape
    assert not (tmp_path / "imported again").exists()
    assert "own_code" not in sys.modules


@pytest.mark.slow
def test_results_with_parts_of_modules_that_are_not_imported_are_looked_at(worm3d, tmp_path: Path) -> None:
    """A gait, an actuator and a law of friction that are known only where their module has been imported."""
    record = simulate(load_scene("flat", ("run.duration_s=0.5", "gait.period_s=0.5")))
    written = tomllib.loads(record.scene)
    kinds = {"gait": "kind", "actuator": "kind", "friction": "law"}
    for section, key in kinds.items():
        written[section] |= {key: "unheard_of", "unheard_of_s": 1.0}
    text = "".join(
        f"{name} = {toml.value(value)}\n"
        for name, value in sorted(written.items(), key=lambda each: type(each[1]) is dict)
    )
    (tmp_path / "a").mkdir()
    save(replace(record, scene=text), tmp_path / "a" / "result.nc")
    for command in LOOKS[:2]:
        ended = worm3d(*command)
        assert ended.code == 0, (command, ended.err)
    seen = scene_of(load(tmp_path / "a"))
    assert (seen.gait.period_s, seen.worm) == (0.5, load_scene("flat").settings.worm)


@pytest.mark.parametrize("name", ["CIRCLE", "CURVE"])
def test_a_path_as_it_is_stored_is_the_path(own: Path, tmp_path: Path, name: str) -> None:
    """Through its points, 20 mm apart at most: the offset within a micrometre."""
    scene = load_scene("path_line", (*BRIEF, f"reference.kind=own_code:{name}"))
    record = simulate(scene)
    exact = tracked(record, reference_of(scene.settings))
    assert path_seen(record, scene.settings).closed is (name == "CIRCLE")
    stored = tracked(record, reference_seen(record, scene.settings))
    np.testing.assert_allclose(stored.cross_track, exact.cross_track, rtol=0, atol=1e-6)
    np.testing.assert_allclose(stored.heading_error, exact.heading_error, rtol=0, atol=2e-4)
    older = replace(record, variables=tuple(each for each in record.variables if each.name != "path"))
    assert path_seen(older, scene.settings) is None
    assert np.isnan(tracked(older, reference_seen(older, scene.settings)).cross_track).all()
