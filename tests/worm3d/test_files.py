"""A file gives back the result that was saved: arrays, summary, worm, world, and a state to go on from."""

import sys
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Centreline, Command, Friction, Heightfield, Pipe, Plane, Worm
from worm3d.recorded.series import Recorded, Steps, series_of
from worm3d.values import netcdf
from worm3d.values.netcdf import FileError

LINE = Centreline.through([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.8, 0.2, 0.05), (2.5, 0.7, 0.1)])
BOX = """v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nv 0 0 -1\nv 2 0 -1\nv 2 1 -1\nv 0 1 -1
f 1 2 3\nf 1 3 4\nf 5 7 6\nf 5 8 7\nf 1 6 2\nf 1 5 6\nf 4 3 7\nf 4 7 8\nf 1 4 8\nf 1 8 5\nf 2 6 7\nf 2 7 3\n"""
GAIT = TravellingWave(amplitude=0.2, bias=0.3, hinge=0.2)
WORLDS: dict[str, Any] = {
    "air": None,
    "plane": Plane(0.1, 0.3, (worm3d.Patch(0.5, along=(0.2, np.inf)),)),
    "pipe": Pipe(LINE, radius=0.1, patches=[worm3d.Patch(2.0, along=(0.0, 0.3))], start_wall=False),
    "narrowing": Pipe(worm3d.Centreline.of([worm3d.Straight(4.0)]), worm3d.Profile([1.2, 1.4], [0.1, 0.11])),
    "terrain": Heightfield.rubble(4.0, 2.0, 0.02, height=0.02, size=0.15, seed=2),
    "sampled": worm3d.World.from_distance(lambda p: p[:, 2], [(-1.0, -1.0, -0.3), (2.0, 1.0, 0.5)], spacing=0.1),
    "union": worm3d.Union((Plane(), Pipe(LINE, radius=0.12))),
    "clamped": worm3d.ClampedGround(),
}


def crawl(world: Any, **more: Any) -> worm3d.Result:
    worm = Worm.planar() if isinstance(world, worm3d.ClampedGround) else Worm(half_height=np.linspace(0.045, 0.05, 6))
    given = {"actuation": TravellingWave(), "duration": 0.3, "dt": 0.01, "record_every": 3, **more}
    return worm3d.simulate(worm, world, Friction(), **given)


def assert_same(one: Any, other: Any, name: str = "result") -> None:
    """Two values are equal, field by field and bit for bit."""
    assert type(one) is type(other), name
    if is_dataclass(one):
        for each in fields(one):
            if each.name not in ("wall_s", "path"):
                assert_same(getattr(one, each.name), getattr(other, each.name), f"{name}.{each.name}")
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, name
        assert_array_equal(one, other, err_msg=name)
        assert not other.flags.writeable or not name.startswith("result"), name
    elif isinstance(one, tuple):
        for k, (mine, others) in enumerate(zip(one, other, strict=True)):
            assert_same(mine, others, f"{name}[{k}]")
    elif hasattr(one, "keys"):
        assert list(one) == list(other), name
        for key in one:
            assert_same(one[key], other[key], f"{name}[{key!r}]")
    else:
        assert one == other, name


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no such folder: '.*none'$"):
        crawl(worm3d.Plane()).save(tmp_path / "none" / "run.nc")


@pytest.mark.parametrize("name", WORLDS)
def test_a_file_gives_back_the_result(name: str, tmp_path: Path) -> None:
    result = crawl(WORLDS[name])
    result.save(tmp_path / "run.nc")
    found = worm3d.load(tmp_path / "run.nc")
    assert_same(result, found)
    assert found.summary() == result.summary()
    assert found.reasons() == result.reasons()
    for series in series_of(Recorded) | series_of(Steps):
        assert_array_equal(getattr(found, series), getattr(result, series), err_msg=series)
    rest = [
        worm3d.simulate(each.worm, each.world, actuation=TravellingWave(), duration=0.2, state=each.state)
        for each in (result, found)
    ]
    for series in series_of(Recorded) | series_of(Steps):
        assert_array_equal(getattr(rest[0], series), getattr(rest[1], series), err_msg=f"going on: {series}")


def test_a_mesh_is_in_the_file(tmp_path: Path) -> None:
    """Its grid, not its triangles, which only pictures need."""
    (tmp_path / "box.obj").write_text(BOX)
    state = worm3d.State.straight(Worm(half_height=np.linspace(0.045, 0.05, 6)), Plane(), (0.2, 0.5))
    result = crawl(worm3d.Mesh(tmp_path / "box.obj", units="m", cell=0.05), state=state, duration=0.03)
    result.save(tmp_path / "run.nc")
    (tmp_path / "box.obj").unlink()
    found = worm3d.load(tmp_path / "run.nc")
    assert_same(result, found)
    assert found.world is not None
    places = np.array([[0.5, 0.5, 0.1], [1.0, 0.2, -0.3]])
    assert_array_equal(found.world.distance(places), result.world.distance(places))


def test_states_of_actuators_are_seen_recorded_and_kept(tmp_path: Path) -> None:
    seen: list[np.ndarray] = []
    given = {"actuation": TravellingWave(), "dt": 0.01}
    worm = Worm(actuator=worm3d.Pneumatic())
    whole = worm3d.simulate(
        worm, Plane(), duration=0.2, **given, every=1, observer=lambda t, v: seen.append(v.actuator_states["pressure"])
    )
    assert whole.actuator_states["pressure"].shape == (21, 6, 2)
    assert_array_equal(seen, whole.actuator_states["pressure"])
    assert np.ptp(seen) > 1.0
    assert_array_equal(whole.to_xarray().actuator_pressure.sel(chamber=1), whole.actuator_states["pressure"][:, :, 1])
    first = worm3d.simulate(worm, Plane(), duration=0.1, **given)
    first.save(tmp_path / "run.nc")
    found = worm3d.load(tmp_path / "run.nc")
    assert_same(first, found)
    rest = worm3d.simulate(found.worm, found.world, duration=0.1, state=found.state, **given)
    assert_array_equal(rest.actuator_states["air"], whole.actuator_states["air"][10:])
    assert_array_equal(rest.joints, whole.joints[10:])


@dataclass(frozen=True)
class Shelf(Plane):
    """A world of one's own."""


def test_a_world_of_ones_own_is_kept_as_it_looks_around_the_worm(tmp_path: Path) -> None:
    result = crawl(Shelf(0.1))
    result.save(tmp_path / "run.nc")
    seen = worm3d.load(tmp_path / "run.nc")
    assert_allclose(seen.world.distance(result.joints), result.world.distance(result.joints), atol=1e-4)
    assert seen.summary() == result.summary()
    found = worm3d.load(tmp_path / "run.nc", world=Shelf(0.1))
    assert_same(result, found)


def test_how_a_run_failed_is_kept(tmp_path: Path) -> None:
    def fails(t: float) -> Command:
        if t > 0.1:
            raise RuntimeError("out of air")
        return Command(np.zeros((6, 2)))

    result = crawl(Plane(), actuation=fails, record_every=1)
    result.save(tmp_path / "run.nc")
    found = worm3d.load(tmp_path / "run.nc")
    assert found.stop == result.stop
    assert "out of air" in found.stop.reason
    assert repr(found) == repr(result)


@pytest.fixture(scope="module")
def run() -> worm3d.Result:
    return crawl(Plane(), duration=2.1)


def test_to_xarray(run: worm3d.Result) -> None:
    data = run.to_xarray()
    assert_array_equal(data.joints.sel(axis="z", joint=0), run.joints[:, 0, 2])
    assert data.joints.attrs == {"units": "m", "long_name": "joints, from tail to head"}
    assert_array_equal(data.com.sel(time=0.9, method="nearest"), run.com[30])
    assert_array_equal(data.friction_loss, run.energy.friction_loss)
    assert data.sizes["step"] == 210
    assert data.attrs["sentence"] == "the run reached its end"
    assert isinstance(data.mean("time"), xarray.Dataset)


def test_without_xarray_it_says_how_to_get_it(run: worm3d.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"to_xarray: xarray is not installed; pip install 'worm3d\[xarray\]'"):
        run.to_xarray()


def test_to_csv(run: worm3d.Result, tmp_path: Path) -> None:
    run.to_csv(tmp_path / "some.csv", ["com", "heading", "friction_loss", "com_velocity"])
    header, *rows = (tmp_path / "some.csv").read_text().splitlines()
    assert header.split(",")[:5] == ["time_s", "com_x_m", "com_y_m", "com_z_m", "heading_rad"]
    assert header.endswith("friction_loss_J,com_velocity_x_m_per_s,com_velocity_y_m_per_s,com_velocity_z_m_per_s")
    numbers = np.array([row.split(",") for row in rows], dtype=float)
    assert_array_equal(numbers[:, 1:4], run.com)
    run.to_csv(tmp_path / "all.csv")
    assert "contact_force_5_7_z_N" in (tmp_path / "all.csv").read_text().partition("\n")[0]
    with pytest.raises(ValueError, match=r"series: got 'hight', 'breakaways', must be among time, joints, "):
        run.to_csv(tmp_path / "none.csv", ["hight", "breakaways"])


def test_the_summary_is_a_mapping_and_a_table(run: worm3d.Result) -> None:
    summary = run.summary()
    assert isinstance(summary, dict)
    lines = repr(summary).splitlines()
    names = [line for line in lines if line.startswith("  ")]
    assert len(names) == 10
    assert lines[:2] == ["motion", f"  {'status':<32}{'done':>12}"]
    assert names[2].split() == ["distance", f"{summary['distance_m']:.6g}", "m"]
    assert lines[-1] == f"{len(summary) - 10} more: print(result.summary().table())"
    every = summary.table().splitlines()
    assert [line for line in every if line[0] != " "] == ["motion", "contact", "work", "quality"]
    assert len(every) == len(summary) + 4
    assert max(map(len, every)) < 60


@pytest.mark.parametrize("wrong", ["bit", "cut", "text", "other", "gone"])
def test_files_that_are_none_are_refused_in_a_sentence(wrong: str, run: worm3d.Result, tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    run.save(path)
    data = bytearray(path.read_bytes())
    if wrong == "bit":
        data[len(data) // 3] ^= 8
    path.write_bytes({"cut": bytes(data[: len(data) // 2]), "text": b"joints\n"}.get(wrong, bytes(data)))
    if wrong == "other":
        xarray.Dataset({"a": ("x", [1.0])}).to_netcdf(path, engine="h5netcdf")
    if wrong == "gone":
        path.unlink()
    why = {"bit": "damaged: its bytes are not those", "cut": "cut short", "text": "not a result of worm3d"}
    error = FileNotFoundError if wrong == "gone" else FileError
    with pytest.raises(error, match=why.get(wrong, "not a result of worm3d" if wrong == "other" else "run.nc")):
        worm3d.load(path)


def test_a_file_that_another_program_changed_is_refused(run: worm3d.Result, tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    run.save(path)
    content = netcdf.load(path)
    faster = {**content.attributes, "run": content.attributes["run"].replace('"dt": 0.01', '"dt": 0.02')}
    assert faster["run"] != content.attributes["run"]
    path.write_bytes(netcdf.packed(netcdf.Content(faster, content.groups)))
    with pytest.raises(FileError, match=r"run\.nc: does not say what worm3d wrote"):
        worm3d.load(path)


def test_saving_replaces_a_file_whole_or_not_at_all(run: worm3d.Result, tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    path.write_text("before")
    with pytest.raises(OSError, match="no such folder"):
        run.save(tmp_path / "nowhere" / "run.nc")
    run.save(path)
    assert [each.name for each in tmp_path.iterdir()] == ["run.nc"]
    assert_array_equal(worm3d.load(tmp_path / "run.nc").com, run.com)
