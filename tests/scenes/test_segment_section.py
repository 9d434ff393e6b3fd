"""The section [segment] of a scene: kinds of segment laws, files of learned laws beside the scene, and mistakes."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.testing import assert_allclose

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.build import worm_of
from scenes.models.worm.overview import outlines
from scenes.running.runner import simulate
from worm3d import Hydrostat, Learned, Rhombus

SHORT = ("run.duration_s=0.3",)


def _learned_laws() -> ModuleType:
    """Return the module of the tests of worm3d that makes files of laws."""
    path = Path(__file__).parents[1] / "worm3d" / "learned_laws.py"
    spec = importlib.util.spec_from_file_location("learned_laws", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


LAWS = _learned_laws()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a scene, mine.toml, and a law beside it, barrel.json; another folder is the current one."""
    LAWS.written(tmp_path)
    (tmp_path / "mine.toml").write_text('model = "worm"\n[segment]\nkind = "learned"\nfile = "barrel.json"\n')
    other = tmp_path / "elsewhere"
    other.mkdir()
    monkeypatch.chdir(other)
    return tmp_path


def test_the_rhombus_is_the_default() -> None:
    assert worm_of(load_scene("flat", SHORT).settings).segment == Rhombus()


def test_a_kind_without_keys() -> None:
    scene = load_scene("flat", (*SHORT, "segment.kind=hydrostat"))
    assert worm_of(scene.settings).segment == Hydrostat()
    assert 'kind = "hydrostat"' in scene.to_toml()


def test_a_law_beside_the_scene_gives_the_sizes_of_the_worm(folder: Path) -> None:
    worm = worm_of(load_scene(folder / "mine.toml", ("worm.segments=5",)).settings)
    assert isinstance(worm.segment, Learned)
    assert (worm.l0, worm.chamber_offset) == (LAWS.L0, LAWS.B)
    assert worm.length == pytest.approx(5 * LAWS.L0)
    with pytest.raises(SceneError, match=r"half_height_m: got .*0.06.*, must be .* as in the segment law"):
        load_scene(folder / "mine.toml", ("worm.half_height_m=0.06",))


def test_a_scene_chooses_a_member_of_the_ensemble() -> None:
    learned = ("segment.kind=learned", "segment.file=barrel.json")
    laws = [worm_of(load_scene("flat", (*learned, f"segment.member={k}")).settings).segment for k in (0, 2)]
    assert_allclose(laws[1].law.energy, laws[0].law.ensemble[1]["energy"], rtol=0, atol=0)


def test_a_scene_with_a_law_runs(folder: Path) -> None:
    outcome = simulate(load_scene(folder / "mine.toml", SHORT))
    assert outcome.status == "done"
    assert outcome.summary["energy_balance_error"] < 1e-12


@pytest.mark.parametrize(("kind", "corners"), [("rhombus", 4), ("hydrostat", 32)])
def test_outlines_reach_from_joint_to_joint_and_from_apex_to_apex(kind: str, corners: int) -> None:
    run = simulate(load_scene("flat", (*SHORT, f"segment.kind={kind}")))
    joints, points = run["joints"][-1], run["points"][-1]
    drawn = outlines(run, joints[:-1], points[:, 1], joints[1:], points[:, 0])
    assert drawn.shape == (6, corners, 3)
    for end in (joints[:-1], joints[1:], points[:, 1], points[:, 0]):
        away = np.linalg.norm((drawn - end[:, None])[..., [0, 2]], axis=2).min(axis=1)
        assert_allclose(away, 0.0, atol=1e-3 * (kind == "hydrostat"))


LEARNED = ("segment.kind=learned", "segment.file=barrel.json")


def test_the_planar_worm_has_the_section(folder: Path) -> None:
    scene = load_scene("planar_case", (*SHORT, "segment.kind=hydrostat"))
    assert worm_of(scene.settings).segment == Hydrostat()
    text = f'model = "worm_planar"\n[segment]\nkind = "learned"\nfile = "barrel.json"\n{FLAT}'
    (folder / "flat.toml").write_text(text)
    scene = load_scene(folder / "flat.toml", (*SHORT, "worm.segments=4"))
    worm = worm_of(scene.settings)
    assert (worm.flat, worm.l0, worm.stroke) == (True, LAWS.L0, (0.0, LAWS.MOST))
    assert worm.half_height[0] == pytest.approx(worm.segment.law.rest_radius)
    outcome = simulate(scene)
    assert outcome.status == "done"
    assert outcome.summary["energy_balance_error"] < 1e-12
    with pytest.raises(SceneError, match=r"gait.amplitude: got 0.5, must be at most 0.45"):
        load_scene(folder / "flat.toml", ("gait.amplitude=0.5",))


FLAT = "[worm]\nmass_kg = 0.07\ntorsion_J = 10.0\n[gait]\namplitude = 0.2\n"


def test_a_controller_of_a_law_with_small_strokes_gets_a_sentence() -> None:
    learned = ("segment.kind=learned", "segment.file=barrel.json")
    with pytest.raises(SceneError, match=r"contract its chambers by 0.4, must be at most the stroke, 0.2701; choose"):
        simulate(load_scene("path_line", (*SHORT, *learned)))


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (
            ("segment.kind=learned", "segment.file=barrel.json", "gait.amplitude=0.3"),
            r"gait.amplitude: got 0.3, must be at most 0.27",
        ),
        (
            ("segment.kind=learned", "segment.file=barrel.json", "segment.member=9"),
            r"segment.member: got 9, must be from 0 to 4: the file has 4 further laws",
        ),
        (("segment.member=1",), r"segment.member: only for segment.kind = 'learned'"),
        (("segment.kind=learned",), r"segment.kind: must name the file of a law that 'worm3d law' wrote"),
        (("segment.kind=learned", "segment.file=lost.json"), r"segment law 'lost.json': there is no such file"),
        (("segment.kind=hydrostat", "segment.file=barrel.json"), r"segment.file: .*learned"),
        (("segment.kind=rhombic",), r"segment.kind: .*did you mean 'rhombus'"),
        (("segment.kind=hydrostat", "actuator.kind=pneumatic"), r"got Pneumatic, which acts on the links"),
    ],
)
def test_mistakes(overrides: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        load_scene("flat", overrides)


@pytest.mark.parametrize("name", ["planar_case", "load_frame"])
@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (("segment.kind=learned",), r"segment.kind: must name the file of a law that 'worm3d law' wrote"),
        (("segment.kind=learned", "segment.file=lost.json"), r"segment law 'lost.json': there is no such file"),
        (("segment.kind=hydrostat", "segment.file=barrel.json"), r"segment.file: .*learned"),
        (("segment.kind=rhombic",), r"segment.kind: .*did you mean 'rhombus'"),
        ((*LEARNED, "worm.length_m=0.3"), r"worm.length_m: got 0.3, must be .* as in the segment law, or be left out"),
    ],
)
def test_the_same_mistakes_in_other_models(name: str, overrides: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        load_scene(name, overrides)


def test_a_broken_law_is_a_mistake_of_the_scene(folder: Path) -> None:
    (folder / "barrel.json").write_text('{"kind": "other"}')
    with pytest.raises(SceneError, match=r"segment law 'barrel.json': kind: got 'other', must be"):
        load_scene(folder / "mine.toml")
