"""The section [segment] of a scene: kinds of segment laws, files of learned laws beside the scene, and mistakes."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import TravellingWave
from control.gaits.steering import GaitParameters, Schedule
from control.identification.identified import MAX_STEERING, Design
from scenes.language.errors import SceneError
from scenes.models.control import identify as runs
from scenes.models.control.identify import Subject
from scenes.models.loading import load_scene
from scenes.models.worm.build import gait_of, worm_of
from scenes.models.worm.model import _period
from scenes.models.worm.overview import outlines
from scenes.running.runner import simulate
from worm3d import Friction, Hydrostat, Learned, Rhombus, Worm
from worm3d.values.arrays import FloatArray

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


def test_the_waves_that_measure_a_worm_end_at_its_stroke(monkeypatch: pytest.MonkeyPatch) -> None:
    """Amplitudes scale in proportion; the parameters of a worm with a large stroke are the same numbers."""
    waves: list[GaitParameters] = []
    monkeypatch.setattr(runs, "samples", lambda subject, design, given: waves.extend(given) or given)
    monkeypatch.setattr(runs, "fit_map", lambda mechanism, ranges, *rest: ranges)
    design, barrel = Design(runs=48), Worm(segment=Learned("barrel.json"))
    for worm, least, most in ((Worm(), 0.15, 0.4), (barrel, 0.15 * barrel.stroke[1] / 0.4, barrel.stroke[1])):
        waves.clear()
        ranges = runs.map_of(Subject(worm, Friction(), Schedule()), design, "hinge")
        assert ranges.amplitude == pytest.approx((least, most), rel=1e-15)
        amplitudes = np.array([each.amplitude for each in waves])
        assert amplitudes[:48].min() == ranges.amplitude[0]
        assert amplitudes.max() == ranges.amplitude[1] <= worm.stroke[1] * (1.0 + 1e-15)
        usual = design.parameters("hinge", MAX_STEERING["hinge"])
        assert (waves[:48] == usual) == (worm is not barrel)


def test_the_lags_of_a_worm_are_measured_within_its_stroke(monkeypatch: pytest.MonkeyPatch) -> None:
    barrel, waves = Worm(segment=Learned("barrel.json")), list[float]()

    def stepped(subject: Subject, begin: GaitParameters, end: GaitParameters, shift: float) -> tuple[FloatArray, None]:
        waves.extend((begin.amplitude, end.amplitude))
        return np.arange(16.0), None

    monkeypatch.setattr(runs, "_winding", lambda *given: (0.5, 0.0))
    monkeypatch.setattr(runs, "step_response", stepped)
    for worm, share in ((Worm(), 1.0), (barrel, barrel.stroke[1] / 0.4)):
        waves.clear()
        runs.measure_lags(Subject(worm, Friction(), Schedule()), "both", 0.5)
        assert {*waves} == {0.2 * share, 0.3 * share}


def test_a_controller_of_a_worm_with_too_small_a_stroke_gets_a_sentence() -> None:
    learned = ("segment.kind=learned", "segment.file=barrel.json", "worm.stroke=[0.0, 0.12]")
    with pytest.raises(SceneError, match=r"stroke of its chambers is 0.12, must be at least 0.15, the contraction of"):
        simulate(load_scene("path_line", (*SHORT, *learned)))


BARREL = ("segment.kind=learned", "segment.file=barrel.json")
CABLE = "segment: the law 'learned' has no cable; command its pressure"


def test_the_amplitude_of_a_gait_may_be_a_pressure() -> None:
    settings = load_scene("flat", (*BARREL, "gait.pressure_Pa=3000")).settings
    gait = gait_of(settings)
    assert isinstance(gait, TravellingWave)
    assert gait.amplitude == worm_of(settings).segment.contraction_of(3000.0)
    assert gait.amplitude == pytest.approx(0.2158, abs=1e-4)


@pytest.mark.parametrize(
    ("columns", "rows", "at_half"),
    [
        ("pressure_kPa", "3\n0", [1500.0] * 12),
        ("pressure_0_kPa,pressure_1_kPa", "3,1\n0,0", [1500.0] * 2 + [500.0] * 2),
        ("pressure_0_0_Pa,pressure_0_1_Pa,pressure_1_0_Pa,pressure_1_1_Pa", "3,1,2,0\n0,0,0,4", [1.5, 0.5, 1.0, 2.0]),
    ],
)
def test_a_file_gives_the_pressures_of_the_chambers(
    columns: str, rows: str, at_half: list[float], tmp_path: Path
) -> None:
    first, last = rows.split("\n")
    (tmp_path / "valves.csv").write_text(f"time_ms,{columns}\n0,{first}\n500,{last}\n")
    (tmp_path / "mine.toml").write_text('model = "worm"\n[gait]\nfile = "valves.csv"\n')
    settings = load_scene(tmp_path / "mine.toml", (*BARREL, f"worm.segments={len(at_half) // 2}")).settings
    worm = worm_of(settings)
    found = worm.segment.input_of(gait_of(settings).bind(worm)(0.25).contraction)
    assert_allclose(found.ravel(), at_half, rtol=1e-10)


def test_a_run_by_a_file_has_no_period(tmp_path: Path) -> None:
    (tmp_path / "valves.csv").write_text("time_s,contraction\n0,0.0\n1,0.2\n")
    scene = load_scene("flat", ("run.duration_s=0.5", f"gait.file={tmp_path / 'valves.csv'}"))
    run = simulate(scene)
    assert_allclose(run["command"][-1], 0.1, rtol=1e-12)
    assert run.summary["speed_BL_per_period"] is None
    assert _period(scene.settings, run) is None


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
        ((*BARREL, "gait.pressure_Pa=5000"), r"gait.pressure_Pa: .*got 5000 Pa, must be from 0 to 4500 Pa"),
        ((*BARREL, "gait.cable_N=5"), f"gait.cable_N: .*{CABLE}"),
        ((*BARREL, "gait.pressure_Pa=3e3", "gait.amplitude=0.1"), r"gait.amplitude: got 0.1 and a pressure: give only"),
        (("gait.pressure_Pa=3000",), r"gait.pressure_Pa: .*law 'rhombus' has no pressure; command the contraction"),
        (("gait.file=lost.csv",), r"lost.csv: no such file"),
        (("gait.file=data/mesh_segment_load_frame.csv",), r"no column of a command, must have pressure_kPa"),
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
