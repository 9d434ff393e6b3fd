"""Runs of the 3D worm by the command line: what they write, and how they go on."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.contour import ContourSet
from numpy.testing import assert_array_equal

from scenes import models
from scenes.language.errors import SceneError
from scenes.language.loader import shipped_scenes
from scenes.models.loading import Scene, load_scene
from scenes.models.worm import figures as worm_figures
from scenes.records.record import Record
from scenes.records.store import load, save
from scenes.running import runner
from scenes.running.runner import lengthened, simulate
from worm3d.values.variable import Variable

MODELS = ("worm", "worm_planar")
SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")
WORMS = [name for name, path in shipped_scenes().items() if tomllib.loads(path.read_text())["model"] in MODELS]
REQUIRED = {
    "status", "duration_s", "distance_m", "path_length_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J",
    "work_friction_J", "cost_of_transport", "energy_balance_error", "newton_iterations_mean", "real_time_factor",
}  # fmt: skip
TURNING = ("gait.period_s=0.5", "gait.bias=0.5", "gait.hinge_deg=20", "push.force_N=[0, 0.02, 0]", "push.begin_s=0.35")


def assert_same(ours: Record, theirs: Record) -> None:
    for a, b in ((ours.variables, theirs.variables), (ours.checkpoint, theirs.checkpoint)):
        assert [(v.name, v.dims, v.units) for v in a] == [(v.name, v.dims, v.units) for v in b]
        for mine, yours in zip(a, b, strict=True):
            assert_array_equal(mine.values, yours.values, strict=True, err_msg=mine.name)
    for name in ("name", "model", "scene", "status", "sentence", "seed", "versions", "summary"):
        assert getattr(ours, name) == getattr(theirs, name)


PROMISED = {
    "flat", "free_fall", "planar_case", "slope", "slope_5", "slope_15", "slope_into_pipe",
    "rubble", "mesh_tunnel", "pipe_straight", "pipe_bend", "pipe_narrowing", "pipe_vertical",
}  # fmt: skip


@pytest.mark.parametrize(("name", "columns"), [("pipe_vertical", 5), ("pipe_bend", 2), ("rubble", 2)])
def test_the_figure_of_the_body_can_be_read(name: str, columns: int) -> None:
    """Bodies that climb stand side by side; tick labels do not meet, and what is solid is seen in every side view."""
    figure, _ = worm_figures.body(simulate(load_scene(name, ["run.duration_s=0.2"])))
    FigureCanvasAgg(figure).draw()
    *views, bar = figure.axes
    assert len({round(view.get_position().x0, 6) for view in views}) == columns
    assert bar.get_position().height * figure.get_figheight() < 2.6
    for k, view in enumerate(views):
        labels = [label.get_window_extent() for label in view.get_xticklabels() if label.get_text()]
        assert all(left.x1 < right.x0 for left, right in pairwise(labels))
        if columns == 5 or k % 2 == 0:
            assert any(isinstance(each, ContourSet) and each.get_paths()[0].vertices.size for each in view.collections)


def test_the_figure_of_the_body_shows_what_its_label_says() -> None:
    """At 1 s what the actuators give differs from the chambers' strain by as much as 0.027."""
    record = simulate(load_scene("flat", ["run.duration_s=1"]))
    figure, axes = worm_figures.body(record)
    assert figure.axes[-1].get_ylabel() == "contraction given\nby the actuators"
    (shapes,) = (each for each in axes.collections if isinstance(each, PolyCollection) and each.get_array() is not None)
    np.testing.assert_array_equal(np.sort(shapes.get_array()), np.sort(record["contraction"][-1].ravel()))
    strain = 6.0 * record["chamber_length"][-1] - 1.0  # of the default worm: six segments, one metre
    assert np.abs(record["contraction"][-1] + strain).max() > 0.02


def test_there_are_those_promised() -> None:
    assert set(WORMS) >= PROMISED
    for name in WORMS:
        assert shipped_scenes()[name].read_text().startswith("# ")


@pytest.mark.parametrize("name", WORMS)
def test_each_scene_runs_and_writes_what_is_promised(worm3d, tmp_path: Path, name: str) -> None:
    ended = worm3d("run", name, *SHORT, "--out", "x")
    assert ended.code == 0
    assert {path.name for path in (tmp_path / "x").iterdir()} == {
        *("result.nc", "summary.json", "viewer.html", "overview.png")
    }
    assert ended.out.startswith(f"{name}: the run reached its end (0.2 s simulated, ")
    assert "\n  turned                " in ended.out
    assert ended.out.endswith("\n  files                 x\n  to look at            x/viewer.html\n")
    summary = json.loads((tmp_path / "x" / "summary.json").read_text())
    assert set(summary) >= REQUIRED
    assert {key for key, figure in summary.items() if figure is None} == set(summary["reasons"])
    assert summary["status"] == "done"
    assert summary["real_time_factor"] > 0.0


@pytest.mark.parametrize(
    ("scene", "overrides"),
    [
        ("flat", TURNING),
        ("flat", (*TURNING, "run.integrator=implicit_euler", "run.record_every=5", "world.slope_deg=5")),
        ("flat", (*TURNING, "worm.actuator_lag_s=0", "worm.rate_limit_per_s=2", "gait.kind=segment_driven")),
        ("planar_case", ("gait.period_s=0.5",)),
        ("planar_case", ("gait.period_s=0.5", "world.kind=clamped")),
    ],
)
def test_half_a_run_and_its_rest_are_the_run_bit_for_bit(
    tmp_path: Path, scene: str, overrides: tuple[str, ...]
) -> None:
    half, whole = (simulate(load_scene(scene, [f"run.duration_s={t}", *overrides])) for t in (0.5, 1.0))
    save(half, tmp_path / "result.nc")
    stored = load(tmp_path)
    assert_same(simulate(lengthened(stored, 0.5), earlier=stored), whole)


def test_a_run_of_a_given_accuracy_goes_on_and_its_errors_add_up() -> None:
    def scene(seconds: float) -> Scene:
        return load_scene("flat", ("run.accuracy=0.05", f"run.duration_s={seconds}", "gait.period_s=1"))

    begun, whole = simulate(scene(0.3)), simulate(scene(0.6))
    both = simulate(lengthened(begun, 0.3), earlier=begun)
    assert_array_equal(both["joints"], whole["joints"])
    errors = [simulated.summary["distance_error_m"] for simulated in (begun, both)]
    assert isinstance(errors[0], float)
    assert isinstance(errors[1], float)
    assert 0.0 < errors[0] < errors[1]
    with pytest.raises(SceneError, match=r"run\.accuracy: got 0\.05 with run\.integrator = 'implicit_euler'"):
        load_scene("flat", ("run.accuracy=0.05", "run.integrator=implicit_euler"))


def test_resume_by_the_command_line(worm3d, tmp_path: Path, done: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "half").mkdir()
    save(done, tmp_path / "half" / "result.nc")
    before = (tmp_path / "half" / "result.nc").read_bytes()
    ended = worm3d("run", "--resume", "half", "--duration", "0.1", "--out", "rest")
    assert ended.code == 0
    assert ended.err == "flat: 10 steps\n"
    assert ended.out.startswith("flat: the run reached its end (0.3 s simulated, ")
    assert (tmp_path / "half" / "result.nc").read_bytes() == before
    assert_same(load(tmp_path / "rest"), simulate(load_scene("flat", [*SHORT[1::2], "run.duration_s=0.3"])))
    assert {path.stem for path in (tmp_path / "rest").glob("*.png")} == {"overview"}
    assert worm3d("resume", "half/result.nc", "--duration", "0.1", "--quiet").code == 0
    assert len(list((tmp_path / "runs").glob("flat-*"))) == 1
    ended = worm3d("resume", "half", "--duration", "0.1", "--out", "rest")
    assert (ended.code, len(ended.complaints)) == (2, 1)
    assert "rest exists and is not empty" in ended.complaints[0]


def test_an_interrupted_run_goes_on_to_its_planned_end() -> None:
    scene = load_scene("flat", ["run.duration_s=1.2", "gait.period_s=0.5", "run.record_every=20"])
    stopped = simulate(scene, lambda done: False)
    assert (stopped.status, stopped.sizes["step"]) == ("interrupted", 40)  # at a stored state
    rest = lengthened(stopped)
    assert rest.settings == scene.settings
    assert_same(simulate(rest, earlier=stopped), simulate(scene))
    assert lengthened(stopped, 0.4).settings.run.duration_s == 0.8


@pytest.fixture(scope="module")
def done() -> Record:
    return simulate(load_scene("flat", SHORT[1::2]))


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (None, r"flat: has come to its end \(0\.2 s\); say how much longer it is to go on: --duration SECONDS_MORE"),
        (-1.0, r"--duration: got -1\.0 s, must be finite and above 0"),
        (float("nan"), r"--duration: got nan s, must be finite and above 0"),
        (0.001, r"--duration: got 0\.001 s, must be at least a time step \(run\.dt_s = 0\.01 s\)"),
        (1e9, r"override run\.duration_s: got 1e\+11 steps of 6 segments, about .* GB of memory"),
    ],
)
def test_durations_that_cannot_be(done: Record, more: float | None, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        lengthened(done, more)


def test_results_that_cannot_go_on(done: Record, record: Record) -> None:
    with pytest.raises(SceneError, match=r"planar_published: has no checkpoint to go on from \(model 'planar_publ"):
        lengthened(record, 1.0)
    thinned = replace(done, scene=done.scene.replace("record_every = 1", "record_every = 20").replace("0.2", "0.4", 1))
    short = replace(thinned, variables=tuple(_cut(v) for v in thinned.variables))
    with pytest.raises(SceneError, match=r"flat: stopped after step 19, between two stored states \(run\.record_every"):
        lengthened(short, 1.0)
    old = replace(done, variables=tuple(v for v in done.variables if v.name != "anchors"))
    with pytest.raises(SceneError, match=r"anchors: not in this result, .*; perhaps another version of"):
        simulate(lengthened(old, 0.1), earlier=old)


def _cut(v: Variable) -> Variable:
    return Variable(v.name, v.dims, v.values[:19], v.units, v.long_name) if v.dims[:1] == ("step",) else v


def test_a_checkpoint_of_another_computer_is_a_sentence(done: Record) -> None:
    other = tuple(
        Variable(v.name, ("other", "lanes"), v.values[:, :-1], v.units, v.long_name) if v.name == "memory_x" else v
        for v in done.checkpoint
    )
    foreign = replace(done, checkpoint=other)
    with pytest.raises(SceneError, match=r"state\.memory: got shape .* belongs to another worm or kind of computer"):
        simulate(lengthened(foreign, 0.1), earlier=foreign)


COLLAPSES = ("-o", "worm.torsion_J=0", "-o", "gait.amplitude=0.44", "-o", "worm.mass_kg=0.5")


def test_a_run_that_fails_keeps_what_it_has_and_cannot_go_on(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "flat", *COLLAPSES, "--out", "x", "--quiet")
    assert ended.code == 3
    (line,) = ended.complaints
    assert line.startswith("diverged: ")
    assert "(step " in line
    assert "try a smaller run.dt_s or gait.amplitude" in line
    record = load(tmp_path / "x")
    assert record.sizes["time"] == record.sizes["step"] + 1 < 1000
    assert json.loads((tmp_path / "x" / "summary.json").read_text())["status"] == "diverged"
    ended = worm3d("resume", "x", "--duration", "1", "--out", "y")
    assert ended.code == 2
    assert "a continued run would end there again: try a smaller run.dt_s" in ended.complaints[0]
    assert not (tmp_path / "y").exists()


def test_a_run_that_cannot_begin_has_a_record_too(worm3d, tmp_path: Path) -> None:
    humped = ("-o", "worm.torsion_J=0", "-o", "worm.half_height_m=[0.05, 0.05, 0.3, 0.3, 0.05, 0.05]")
    ended = worm3d("run", "flat", *humped, "--out", "x", "--quiet")
    assert (ended.code, len(ended.complaints)) == (3, 1)
    record = load(tmp_path / "x")
    assert (record.sizes["step"], record.sizes["time"]) == (0, 1)
    summary = json.loads((tmp_path / "x" / "summary.json").read_text())
    assert summary["reasons"]["newton_iterations_mean"] == "no step was finished"
    assert {path.name for path in (tmp_path / "x").iterdir()} == {"result.nc", "summary.json"}


def test_a_model_with_a_view_gets_its_page(worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def view(record: Record, path: Path, *, skin: bool = True) -> None:
        path.write_text(f"<title>{record.title}</title>")

    model = replace(models.get("worm"), view=view)
    monkeypatch.setattr("scenes.models.worm.model.WORM_MODEL", model)
    assert worm3d("run", "flat", *SHORT, "--out", "x", "--quiet").code == 0
    assert (tmp_path / "x" / "viewer.html").read_text() == "<title>The worm on flat ground</title>"
    monkeypatch.setattr("scenes.models.worm.model.WORM_MODEL", replace(model, view=None))
    assert worm3d("run", "flat", *SHORT, "--out", "x", "--quiet", "--force").code == 0
    assert not (tmp_path / "x" / "viewer.html").exists()


def test_an_export_has_every_series(done: Record, tmp_path: Path, worm3d) -> None:
    save(done, tmp_path / "result.nc")
    assert worm3d("export", tmp_path, "--csv", "x.csv").code == 0
    header, *rows = (tmp_path / "x.csv").read_text().splitlines()
    assert len(rows) == 21
    assert {"time_s", "joints_6_z_m", "contraction_5_1", "work_contract_J", "heading_rad"} <= set(header.split(","))


def test_ctrl_c_stops_at_a_stored_state(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def observer(done: int) -> bool:
        seen.append(done)
        return False

    record = simulate(load_scene("flat", ["run.duration_s=2.1", "run.record_every=30"]), observer)
    assert record.status == "interrupted"
    assert record.sizes["step"] == seen[-1] == 30
    assert runner.EXIT_CODES[record.status] == 130
