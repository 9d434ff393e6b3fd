"""Measurements read from CSV files, and simulations at their instants."""

from __future__ import annotations

import gzip
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from scenes.language.errors import DiscError, SceneError
from scenes.models.loading import load_scene
from scenes.records import measured, store
from scenes.records.columns import COLUMN_UNITS
from scenes.records.record import Record, Summary
from scenes.running.runner import simulate
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

TEXT = """\
# title: A crawl
# licence: CC0
# marker head: joint 2
# marker m 1: body 0.75
time_ms,com_x_mm,com_y_cm,marker_head_x_m,marker_head_y_m,marker_m 1_x_m,strain_1,heading_deg,force_N
0,10,1,,,0.1,0.5,90,1
10,20,2,1,2,0.2,nan,180,-2
30,-30,, 3 ,4,0.3,-0.5,-90,1e-3
"""


@pytest.fixture(scope="module")
def crawl() -> Record:
    return simulate(load_scene("flat", ["run.duration_s=0.2", "worm.segments=4", "gait.hinge_deg=20"]))


def written(folder: Path, text: str) -> Path:
    path = folder / "lab.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_packed_file_reads_like_a_plain_one(tmp_path: Path) -> None:
    packed = tmp_path / "lab.csv.gz"
    packed.write_bytes(gzip.compress(TEXT.encode()))
    plain = measured.load(written(tmp_path, TEXT))
    assert_array_equal(measured.load(packed)["com"], plain["com"])
    for damaged in (packed.read_bytes()[:-9], b"time_s,com_x_m\n0,1\n1,2\n"):
        packed.write_bytes(damaged)
        with pytest.raises(SceneError, match="damaged, or not packed by gzip"):
            measured.load(packed)


def simulation(time: FloatArray, **series: tuple[FloatArray, str]) -> Record:
    """A record of a worm of length 0.6 m with the given series and units."""
    variables = [Variable("time", ("time",), time, "s", "time")]
    for name, (values, unit) in series.items():
        dims = ("time", *(f"{name}_{k}" for k in range(values.ndim - 1)))
        variables.append(Variable(name, dims, values, unit, name))
    scene = 'model = "worm"\n[worm]\nlength_m = 0.6\n'
    return Record("sim", "worm", scene, "done", "", 0, {}, Summary({}), tuple(variables))


def test_columns_become_si_units_shapes_and_missing_values(tmp_path: Path) -> None:
    record = store.load(written(tmp_path, TEXT))
    assert (record.name, record.model, record.title) == ("lab", "measured", "A crawl")
    assert_allclose(record["time"], [0.0, 0.01, 0.03], rtol=1e-15)
    assert_allclose(record["com"], [[0.01, 0.01], [0.02, 0.02], [-0.03, np.nan]], rtol=1e-15)
    assert_array_equal(record["marker_head"], [[np.nan, np.nan], [1.0, 2.0], [3.0, 4.0]])
    assert_array_equal(record["marker_m 1"], [[0.1, np.nan], [0.2, np.nan], [0.3, np.nan]])
    assert_array_equal(record["strain"], [[np.nan, 0.5], [np.nan, np.nan], [np.nan, -0.5]])
    assert_allclose(record["heading"], [math.pi / 2.0, math.pi, -math.pi / 2.0], rtol=1e-15)
    assert [v.units for v in record.variables] == ["s", "m", "m", "m", "1", "rad", "N"]
    assert record.summary["duration_s"] == pytest.approx(0.03)


@pytest.mark.parametrize("suffix", COLUMN_UNITS)
def test_each_unit_has_its_factor(tmp_path: Path, suffix: str) -> None:
    record = measured.load(written(tmp_path, f"time_s,thing_{suffix}\n0,3\n1,5\n"))
    unit, factor = COLUMN_UNITS[suffix]
    assert record.variable("thing").units == unit
    assert_allclose(record["thing"], [3.0 * factor, 5.0 * factor], rtol=1e-15)
    scales = {"m": 1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "ms": 1e-3, "min": 60, "mN": 1e-3, "kN": 1e3, "percent": 1e-2}
    if suffix in scales:
        assert factor == scales[suffix]


def test_pure_numbers_and_indices(tmp_path: Path) -> None:
    record = measured.load(
        written(tmp_path, "time_s,ratio_1,strain_1,contraction_1_0,directors_0_x\n0,1,2,3,4\n1,1,2,3,4\n")
    )
    assert record["ratio"].shape == (2,)
    assert record["strain"].shape == (2, 2)
    assert record["contraction"].shape == (2, 2, 1)
    assert record["directors"].shape == (2, 1, 2)


def test_an_exported_run_comes_back_bit_for_bit(crawl: Record, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    store.export_csv(crawl, path)
    again = measured.load(path)
    like = measured.simulated_like(crawl, again)
    assert measured.unmatched(crawl, again) == {}
    timed = {v.name for v in crawl.variables if v.dims[:1] == ("time",)}
    assert like.keys() == timed - {"time"}
    for name in like:
        assert_array_equal(again[name], crawl[name], err_msg=name)
        assert_array_equal(like[name], crawl[name], err_msg=name)


def test_between_instants_a_simulation_moves_on_straight_lines_and_outside_it_says_nothing(tmp_path: Path) -> None:
    time = np.array([0.0, 0.1, 0.4, 1.0])
    com = np.column_stack([2.0 * time, 1.0 - time, 0.0 * time])
    sim = simulation(time, com=(com, "m"))
    rows = "\n".join(f"{t},0,0" for t in (-0.1, 0.0, 0.05, 0.3, 0.99, 1.0, 1.1))
    lab = measured.load(written(tmp_path, f"time_s,com_x_m,com_y_m\n{rows}\n"))
    like = measured.simulated_like(sim, lab)["com"]
    inside = lab["time"][1:-1]
    assert_allclose(like[1:-1], np.column_stack([2.0 * inside, 1.0 - inside]), atol=1e-15)
    assert np.isnan(like[[0, -1]]).all()


def test_what_is_no_number_does_not_spread_to_stored_instants() -> None:
    values = np.array([0.0, np.nan, 2.0, 3.0])
    found = measured.at_instants(np.arange(4.0), values, np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5]))
    assert_array_equal(found, [0.0, np.nan, np.nan, np.nan, 2.0, 2.5])


def test_one_stored_instant_is_known_there_only() -> None:
    found = measured.at_instants(np.array([1.0]), np.array([[7.0]]), np.array([0.0, 1.0, 2.0]))
    assert_array_equal(found, [[np.nan], [7.0], [np.nan]])


@pytest.mark.parametrize(
    ("place", "weights"),
    [
        ("joint 0", (1.0, 0.0, 0.0, 0.0)),
        ("joint 3", (0.0, 0.0, 0.0, 1.0)),
        ("body 0", (1.0, 0.0, 0.0, 0.0)),
        ("body 1", (0.0, 0.0, 0.0, 1.0)),
        ("body 0.5", (0.0, 0.5, 0.5, 0.0)),
        ("body 0.9", (0.0, 0.0, 0.3, 0.7)),
    ],
)
def test_a_marker_sits_on_the_line_of_joints(tmp_path: Path, place: str, weights: tuple[float, ...]) -> None:
    joints = np.random.default_rng(3).normal(size=(5, 4, 3))
    sim = simulation(np.arange(5.0), joints=(joints, "m"))
    text = f"# marker a: {place}\ntime_s,marker_a_x_m,marker_a_z_m\n0,0,0\n4,0,0\n"
    like = measured.simulated_like(sim, measured.load(written(tmp_path, text)))["marker_a"]
    assert_allclose(like, np.einsum("j,tjx->tx", weights, joints)[[0, 4]], atol=1e-14)


def test_strain_is_that_of_the_distance_of_joints(tmp_path: Path) -> None:
    stretch = np.array([1.0, 0.8, 1.3])  # of the segments, of 0.2 m each
    x = np.concatenate([[0.0], np.cumsum(0.2 * stretch)])
    tilted = x[:, None] * np.array([2.0, -1.0, 2.0]) / 3.0
    sim = simulation(np.arange(2.0), joints=(np.stack([tilted, tilted]), "m"))
    lab = measured.load(written(tmp_path, "time_s,strain_0,strain_2\n0,0,0\n1,0,0\n"))
    assert_allclose(measured.simulated_like(sim, lab)["strain"], [[0.0, -0.2, 0.3]] * 2, atol=1e-14)


def test_a_heading_is_taken_in_the_turn_nearest_to_the_measured(tmp_path: Path) -> None:
    sim = simulation(np.arange(3.0), heading=(np.array([0.1, 6.0, 13.0]), "rad"))
    lab = measured.load(written(tmp_path, "time_s,heading_rad\n0,0\n1,0\n2,\n"))
    assert_allclose(measured.simulated_like(sim, lab)["heading"], [0.1, 6.0 - 2.0 * math.pi, 13.0], atol=1e-14)


def test_what_has_no_counterpart_is_left_out_with_a_reason(crawl: Record, tmp_path: Path) -> None:
    text = (
        "# marker tip: joint 9\ntime_s,com_x_m,joints_7_x_m,heading_m,force_N,pressure_kPa,marker_tip_x_m\n"
        "0,0,0,0,0,0,0\n0.1,0,0,0,0,0,0\n"
    )
    lab = measured.load(written(tmp_path, text))
    assert measured.simulated_like(crawl, lab).keys() == {"com"}
    assert measured.unmatched(crawl, lab) == {
        "joints": "joints is measured up to index 7, flat has 0 to 4",
        "heading": "heading: got a unit of [m], must be one of [rad] as in flat",
        "force": "force: got shape () at each instant, must be (4, 2) as in flat",
        "pressure": "flat has no pressure",
        "marker_tip": "marker on joint 9: the simulated worm has joints 0 to 4",
    }
    nothing = measured.load(written(tmp_path, "time_s,pressure_kPa\n0,0\n1,1\n"))
    with pytest.raises(SceneError, match=r"^lab: nothing of it can be compared with flat: flat has no pressure$"):
        measured.simulated_like(crawl, nothing)


HEAD = "time_s,com_x_m\n"
MISTAKES: Mapping[str, tuple[str, str]] = {
    "nothing": ("", "no row of column names"),
    "only a header": ("# title: x\n\n", "no row of column names"),
    "no rows": (HEAD, "got 0 rows of numbers, must be two or more"),
    "one row": (HEAD + "0,0\n\n", "got 1 rows of numbers"),
    "no time": ("com_x_m\n0\n1\n", "no column of time, must have one named time_s"),
    "a place for time": ("time_x_m,com_x_m\n0,0\n1,1\n", "no column of time"),
    "time alone": ("time_s\n0\n1\n", "only a column of time"),
    "no instant": (HEAD + "0,0\n,1\n2,2\n", "line 3: without a time"),
    "time goes back": (HEAD + "0,0\n\n1,1\n0.5,2\n", "line 5: got the time 0.5 s after 1 s, must ascend"),
    "time stands": (HEAD + "0,0\n0,1\n", "line 3: got the time 0 s after 0 s"),
    "unknown unit": ("time_s,com_x_ft\n0,0\n1,1\n", "column 'com_x_ft': unknown unit 'ft', must end in one of m, cm"),
    "no unit": ("time_s,force\n0,0\n1,1\n", "unknown unit 'force'"),
    "no name": ("time_s,\n0,0\n1,1\n", "the name of a quantity is missing"),
    "no quantity": ("time_s,_x_m\n0,0\n1,1\n", "the name of a quantity is missing"),
    "twice": (
        "time_s,com_x_m,com_x_mm\n0,0,0\n1,1,1\n",
        "'com_x_mm': has the same quantity as 'com_x_m', must occur once",
    ),
    "two kinds": ("time_s,a_0_m,a_m\n0,0,0\n1,1,1\n", "'a_m': must have as many indices"),
    "two units": ("time_s,a_0_m,a_1_N\n0,0,0\n1,1,1\n", "'a_1_N': must have as many indices"),
    "huge index": ("time_s,strain_99999999999\n0,0\n1,1\n", "its index is too large"),
    "no number": (HEAD + "0,0\n1,one\n", "line 3: com_x_m: got 'one', must be a number, or blank where it is missing"),
    "infinite": (HEAD + "0,0\n1,-inf\n", "line 3: com_x_m: got -inf, must be finite"),
    "overflow": (HEAD + "0,0\n1,1e400\n", "line 3: com_x_m: got inf, must be finite"),
    "short row": (HEAD + "0,0\n1\n", "line 3: got 1 cells, must be 2 as in the row of column names"),
    "semicolons": ("time_s;com_x_m\n0;0\n1;1\n", "separated by semicolons, must be by commas"),
    "open quotation": (HEAD + '0,"0\n', "not a table"),
    "marker without place": ("time_s,marker_a_x_m\n0,0\n1,1\n", "must have a line such as '# marker a: joint 0'"),
    "place without marker": ("# marker a: joint 1\n" + HEAD + "0,0\n1,1\n", "marker a: has no columns"),
    "marker in the air": (
        "# marker a: tail\ntime_s,marker_a_x_m\n0,0\n1,1\n",
        "must be 'joint NUMBER' or 'body SHARE'",
    ),
    "half a joint": ("# marker a: joint 0.5\ntime_s,marker_a_x_m\n0,0\n1,1\n", "must be an integer"),
    "beyond the head": ("# marker a: body 1.5\ntime_s,marker_a_x_m\n0,0\n1,1\n", "must be from 0 (tail) to 1 (head)"),
    "marker without axis": ("# marker a: body 1\ntime_s,marker_a_m\n0,0\n1,1\n", "must be a position"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_sentences(tmp_path: Path, mistake: str) -> None:
    text, sentence = MISTAKES[mistake]
    path = written(tmp_path, text)
    with pytest.raises(SceneError) as error:
        measured.load(path)
    assert len(error.value.lines) == 1
    assert str(error.value).startswith(f"{path}: ")
    assert sentence in str(error.value)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no such file"):
        measured.load(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\x89HDF\xff\xfe\x00")
    with pytest.raises(SceneError, match="not a text in UTF-8"):
        measured.load(tmp_path / "binary.csv")
    with pytest.raises(DiscError, match="not a regular file"):
        measured.load(Path("/dev/zero"))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_are_read_or_refused_with_a_sentence(tmp_path: Path, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(TEXT)))
    end = data.draw(st.integers(start, min(start + 30, len(TEXT))))
    put = data.draw(st.text(alphabet="0159_-.,;:#\"'\n\x00einfxyzmkN² ", max_size=6))
    path = written(tmp_path, TEXT[:start] + put + TEXT[end:])
    try:
        record = measured.load(path)
    except SceneError:
        return
    assert not any(np.isinf(v.values).any() for v in record.variables)
    assert np.all(np.diff(record["time"]) > 0.0)


def test_a_measurement_is_plotted_exported_and_not_gone_on_with(worm3d, tmp_path: Path) -> None:
    written(tmp_path, TEXT)
    ended = worm3d("plot", "lab.csv", "--out", "figures")
    assert ended.code == 0
    drawn = {path.name for path in (tmp_path / "figures").iterdir()}
    assert drawn == {
        f"measured_{stem}.png" for stem in ("path", "centre_of_mass_and_heading", "strain", "markers", "single_numbers")
    }
    assert worm3d("export", "lab.csv", "--csv", "si.csv").code == 0
    assert (tmp_path / "si.csv").read_text().startswith("time_s,com_x_m,com_y_m,marker_head_x_m")
    for command in (("resume", "lab.csv"), ("view", "lab.csv"), ("animate", "lab.csv", "--out", "a.gif")):
        ended = worm3d(*command)
        assert ended.code == 2
        assert len(ended.complaints) == 1
        assert "measure" in ended.err


def test_results_of_python_have_strains_too(crawl: Record) -> None:
    """A result saved by `Result.save` has no scene, but says which worm it is of."""
    assert_array_equal(measured.segment_strain(replace(crawl, scene="")), measured.segment_strain(crawl))
