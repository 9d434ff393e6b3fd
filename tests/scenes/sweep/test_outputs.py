"""What a sweep leaves behind: the table, the data set, the summary and the figures say what the cases came to."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from scenes.models.loading import Scene, load_scene
from scenes.running.terminal import HEADLINES
from scenes.sweep.case_file import NOT_RUN, CaseResult
from scenes.sweep.design import Design, Varied
from scenes.sweep.figures import draw
from scenes.sweep.outputs import MOST_LINES, MOST_ROWS, NOT_DRAWN, headlines, report, write_outputs
from scenes.sweep.table import Table
from worm3d.values import netcdf

SEGMENTS = Varied("worm.segments", "worm.segments", (3, 4, 5), "1", "number of segments")
PERIOD = Varied("gait.period_s", "gait.period_s", (0.5, 1.0, 2.0, 4.0), "s", "period of the gait")
DIRECTION = Varied("gait.direction", "gait.direction", ("direct", "retrograde"))
GRID = Design("flat", (SEGMENTS, PERIOD))
LOST = 5
"""Case of `GRID` that diverged: 4 segments, 1 s."""


def done(number: int, **figures: Any) -> CaseResult:
    """Return a case that came to its end; its distance is 0.1 m times its number."""
    summary = {"status": "done", "duration_s": 2.0, "distance_m": 0.1 * number, "newton_iterations_mean": 1.0 + number}
    absent = {"cost_of_transport": None, "energy_balance_error": 1e-9 * number, "faults": []}
    reasons = {"cost_of_transport": "the worm did not move forward"}
    timing = {"wall_s": float(np.random.default_rng().random())}
    return CaseResult(
        *(f"key{number}", "flat", "worm", "done", "ran to its end", number),
        summary={**summary, **absent, **figures},
        reasons=reasons,
        timing=timing,
    )


def lost(number: int, status: str = "diverged") -> CaseResult:
    return CaseResult(f"key{number}", "flat", "worm", status, "too, fast\nat 1 s", number, summary={"distance_m": 99.0})


def results(design: Design) -> list[CaseResult]:
    return [lost(number) if number == LOST else done(number) for number in range(len(design))]


@pytest.fixture(scope="module")
def base() -> Scene:
    return load_scene("flat")


@pytest.fixture(scope="module")
def folder(base: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    assert write_outputs(folder, base, GRID, iter(results(GRID))).ending == "incomplete"
    written = {path.name for path in folder.iterdir()} - {path.name for path in folder.glob("sweep_*.png")}
    assert written == {"sweep.csv", "sweep.nc", "summary.json"}
    return folder


def test_the_table_has_a_row_for_each_case(folder: Path) -> None:
    with (folder / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    first = ["case", "worm.segments", "gait.period_s", "status", "reason", "seed", "duration_s", "distance_m"]
    assert list(rows[0])[:8] == first
    assert [row["case"] for row in rows] == [f"key{number}" for number in range(12)]
    assert [(row["worm.segments"], row["gait.period_s"]) for row in rows[3:5]] == [("3", "4.0"), ("4", "0.5")]
    assert [float(row["distance_m"]) for row in rows if row["status"] == "done"] == [
        0.1 * number for number in range(12) if number != LOST
    ]
    assert rows[LOST]["reason"] == "too, fast\nat 1 s"
    assert rows[LOST]["distance_m"] == rows[0]["cost_of_transport"] == ""
    assert rows[0]["reason"] == "the worm did not move forward"
    assert rows[0]["faults"] == "0.0"


def test_the_table_depends_on_no_clock(folder: Path, base: Scene, tmp_path: Path) -> None:
    write_outputs(tmp_path, base, GRID, results(GRID))
    for name in ("sweep.csv", "summary.json", "sweep_distance_m.png"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_the_data_set_has_the_varied_keys_as_dimensions(folder: Path) -> None:
    with xarray.open_dataset(folder / "sweep.nc", engine="h5netcdf") as data:
        assert data.distance_m.dims == ("worm.segments", "gait.period_s")
        assert data["gait.period_s"].attrs == {"units": "s", "long_name": "period of the gait"}
        assert data.cost_of_transport.attrs == {"units": "1", "long_name": "cost of transport"}
        assert data.distance_m.attrs == {"units": "m", "long_name": "distance"}
        assert_allclose(data.distance_m.sel({"worm.segments": 5, "gait.period_s": 2.0}), 1.0)
        place = {"worm.segments": 4, "gait.period_s": 1.0}
        assert np.isnan(data.distance_m.sel(place))
        assert data.status.sel(place) == "diverged"
        assert data.seed.sel(place) == LOST
        assert data.case.values.ravel().tolist() == [f"key{number}" for number in range(12)]
        assert "wall_s" not in data
    with xarray.open_dataset(folder / "sweep.nc", engine="h5netcdf", group="timing") as timing:
        assert (timing.wall_s > 0.0).sum() == 11
    netcdf.load(folder / "sweep.nc").require_digest("sweep.nc")


def test_the_summary_counts_and_lists_the_cases(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    counts = [summary[f"cases_{name}"] for name in ("total", "done", "diverged", "failed", "not_run")]
    assert counts == [12, 11, 1, 0, 0]
    assert summary["status"] == "incomplete"
    assert summary["duration_s"] == 22.0
    assert_allclose(summary["energy_balance_error"], 11e-9)
    assert summary["distance_m"] is None
    assert summary["reasons"]["distance_m"] == "a sweep has one for each case: see sweep.csv"
    assert len(summary["cases"]) == 12
    assert summary["cases"][LOST]["distance_m"] is None
    failed = {"case": "key5", "worm.segments": 4, "gait.period_s": 1.0, "status": "diverged"}
    assert summary["failures"] == [{**failed, "reason": "too, fast\nat 1 s"}]


def test_an_interrupted_sweep_says_so(base: Scene, tmp_path: Path) -> None:
    rest = [done(0), lost(1, "failed"), *(CaseResult(f"key{n}", "flat", "worm", NOT_RUN, "", n) for n in range(2, 12))]
    assert write_outputs(tmp_path, base, GRID, rest).ending == "interrupted"
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["status"] == "interrupted"
    assert [summary[f"cases_{name}"] for name in ("done", "diverged", "failed", "not_run")] == [1, 0, 1, 10]
    assert len(summary["failures"]) == 1


def test_a_sweep_of_which_nothing_is_left_has_outputs(base: Scene, tmp_path: Path) -> None:
    (tmp_path / "sweep_of_an_earlier_one.png").write_bytes(b"")
    write_outputs(tmp_path, base, GRID, [lost(n, "failed") for n in range(12)])
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.csv", "sweep.nc", "summary.json"}
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["energy_balance_error"] is None
    assert summary["reasons"]["energy_balance_error"] == "no case came to its end"


def test_results_are_one_for_each_case(base: Scene, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="results: got 2 of them, must be one for each of 12 cases"):
        write_outputs(tmp_path, base, GRID, [done(0), done(1)])


def test_many_cases_are_in_the_table_alone(base: Scene, tmp_path: Path) -> None:
    number = MOST_ROWS + 1
    design = Design("flat", (Varied("gait.period_s", "case", tuple(np.linspace(1.0, 2.0, number).tolist())),))
    table = write_outputs(tmp_path, base, design, (lost(n) if n % 2 else done(n) for n in range(number)))
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["cases"] is None
    assert summary["reasons"]["cases"] == "more than 1000: see sweep.csv"
    assert len((tmp_path / "sweep.csv").read_text().splitlines()) > number
    lines = report(base, table)
    assert len(lines) == 2 + MOST_LINES
    assert lines[-1] == f"and {number - MOST_LINES} more: see sweep.csv"


def test_the_report_has_a_line_for_each_case(base: Scene) -> None:
    header, *rows = report(base, Table.of(GRID, results(GRID)))
    assert header.split() == ["worm.segments", "gait.period_s", "distance", "[m]", "status"]
    assert rows[2].split() == ["3", "2", "0.2", "done"]
    assert rows[LOST].split() == ["4", "1", "none", "diverged"]


def test_a_seed_can_be_varied(base: Scene, tmp_path: Path) -> None:
    write_outputs(tmp_path, base, Design("flat", (Varied("seed", "seed", (1, 2)),)), [done(1), done(2)])
    with (tmp_path / "sweep.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header.count("seed") == 1
    assert [row[header.index("seed")] for row in rows] == ["1", "2"]
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="h5netcdf") as data:
        assert data.distance_m.sel(seed=2) == 0.2


@pytest.mark.parametrize(
    ("values", "coordinate"),
    [
        ((True, False), ["true", "false"]),
        (([1.0, 2.0], 3.0), ["[1.0, 2.0]", "3.0"]),
        ((1, 2), [1, 2]),
        (("flat", "ä, b"), ["flat", "ä, b"]),
    ],
)
def test_values_of_any_type_are_coordinates(
    base: Scene, tmp_path: Path, values: tuple[Any, ...], coordinate: list[Any]
) -> None:
    design = Design("flat", (Varied("worm.x", "worm.x", values),))
    write_outputs(tmp_path, base, design, [done(1), done(2)])
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="h5netcdf") as data:
        assert data["worm.x"].values.tolist() == coordinate
        assert data["worm.x"].attrs == {"units": "1", "long_name": "worm.x"}, "neither of the two is ever empty"
        assert_allclose(data.distance_m.sel({"worm.x": coordinate[1]}), 0.2)
    with (tmp_path / "sweep.csv").open(newline="", encoding="utf-8") as file:
        assert [row["worm.x"] for row in csv.DictReader(file)] == [str(each) for each in coordinate]


def axes_of(design: Design, metric: str = "distance_m", **figures: Any) -> Any:
    cases = [lost(n) if n == LOST else done(n, **figures) for n in range(len(design))]
    return draw(Table.of(design, cases), metric, "distance [m]", "Title").axes[0]


def crosses(axes: Any) -> list[list[float]]:
    """Return where cases are marked as failed."""
    return [point for each in axes.collections if len(each.get_paths()) == 1 for point in each.get_offsets().tolist()]


def test_two_numbers_are_a_map() -> None:
    axes = axes_of(GRID)
    mesh = axes.collections[0]
    assert_allclose(mesh.get_array()[:, 0], [0.0, 0.1, 0.2, 0.3])
    assert mesh.get_array().mask.tolist()[1] == [False, True, False]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("worm.segments", "gait.period_s")
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    assert_allclose(mesh.get_coordinates()[:, 0, 1], np.sqrt(2.0) ** np.array([-3, -1, 1, 3, 5]))  # the cells' edges
    assert crosses(axes) == [[4.0, 1.0]]
    assert axes.get_title() == "Title: distance [m]; 1 of 12 cases failed (marked x)"


def test_a_number_is_a_curve_over_its_ascending_values() -> None:
    axes = axes_of(Design("flat", (Varied("a.b", "a.b", (3.0, 1.0, 2.0)),)))
    assert_array_equal(axes.lines[0].get_xydata(), [[1.0, 0.1], [2.0, 0.2], [3.0, 0.0]])


def test_a_number_and_a_category_are_a_curve_for_each() -> None:
    axes = axes_of(Design("flat", (DIRECTION, PERIOD)))
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["direct", "retrograde"]
    assert_allclose(axes.lines[0].get_ydata(), [0.0, 0.1, 0.2, 0.3])
    assert_allclose(axes.lines[1].get_ydata(), [0.4, np.nan, 0.6, 0.7])
    assert crosses(axes) == [[1.0, 0.03]]


def test_a_category_is_bars_and_a_seed_is_one() -> None:
    axes = axes_of(Design("flat", (Varied("seed", "seed", (7, 5)),)))
    assert [bar.get_height() for bar in axes.patches] == [0.0, 0.1]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["7", "5"]


def test_two_categories_are_a_map() -> None:
    axes = axes_of(Design("flat", (DIRECTION, Varied("gait.kind", "gait.kind", ("a", "b", "c")))))
    assert axes.collections[0].get_array().shape == (3, 2)
    assert [text.get_text() for text in axes.get_yticklabels()] == ["a", "b", "c"]


@pytest.mark.parametrize(("second", "number"), [("case", 8), ("gait.period_s", 4)])
def test_drawn_values_are_points(second: str, number: int) -> None:
    drawn = tuple(np.linspace(1.0, 2.0, number).tolist())
    other = Varied("gait.period_s", second, PERIOD.values * (number // 4))
    axes = axes_of(Design("flat", (other, Varied("worm.mass_kg", "case" if second == "case" else "sample", drawn))))
    points = axes.collections[0]
    assert len(points.get_offsets()) == (7 if second == "case" else 15)
    assert_allclose(points.get_array()[:3], [0.0, 0.1, 0.2])


def test_a_figure_that_a_case_has_not_is_none() -> None:
    axes = axes_of(Design("flat", (SEGMENTS,)))
    assert [text.get_text() for text in axes.texts] == []
    table = Table.of(Design("flat", (SEGMENTS,)), [done(0, cost_of_transport=2.0), done(1), done(2)])
    axes = draw(table, "cost_of_transport", "cost", "Title").axes[0]
    assert [(text.get_text(), text.get_position()[0]) for text in axes.texts] == [("none", 4.0), ("none", 5.0)]


def test_a_row_tells_each_reason_once_and_in_alphabetical_order() -> None:
    """A table is the same in each process: the order of a set is not."""
    reasons = {f"figure_{letter}": f"no {letter}" for letter in "gcaebdf"}
    table = Table.of(
        Design("flat", (SEGMENTS,)), [replace(done(k), reasons={**reasons, "g": "no g"}) for k in range(3)]
    )
    assert table.reasons == ["; ".join(f"no {letter}" for letter in "abcdefg")] * 3


def test_a_single_value_can_be_drawn() -> None:
    for design in (
        Design("flat", (Varied("a.b", "a.b", (0.0,)), PERIOD)),
        Design("flat", (Varied("a.b", "a.b", (2,)),)),
    ):
        axes_of(design).figure.canvas.draw()


def test_the_pictures_have_colours(folder: Path) -> None:
    with Image.open(folder / "sweep_distance_m.png") as picture:
        assert len(picture.convert("RGB").getcolors(100_000) or []) > 50


def test_a_sweep_of_controllers_reports_how_well_they_keep_to_their_reference() -> None:
    design = Design("path_line", (Varied("controller.kind", "controller.kind", ("mpc", "pi_los")),))
    tracked = {"cross_track_rms_bl": 0.25, "heading_error_rms_deg": 3.5, "speed_error_rms_relative": 0.125}
    controlled = load_scene("path_line")
    header, first, *_ = report(controlled, Table.of(design, [done(k, **tracked) for k in (1, 2)]))
    assert header.index("beside the path") < header.index("heading error") < header.index("speed error")
    assert all(figure in first for figure in ("0.25", "3.5", "0.125"))
    last = report(controlled, Table.of(design, [done(k, **dict.fromkeys(tracked)) for k in (1, 2)]))[-1]
    assert last == (
        "no case has beside the path, rms, heading error, rms, speed error, rms: the worm did not move forward"
    )


def test_seeds_of_each_controller_are_bars_with_points() -> None:
    seed = Varied("seed", "seed", (1, 2, 3))
    design = Design("flat", (seed, Varied("controller.kind", "controller.kind", ("mpc", "pi_los"))))
    axes = axes_of(design)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["mpc", "pi_los"]
    cases = np.array([done(k).summary["distance_m"] if k != LOST else np.nan for k in range(6)]).reshape(3, 2)
    assert_allclose([bar.get_height() for bar in axes.patches], np.nanmean(cases, axis=0))
    assert_allclose(axes.lines[-1].get_ydata(), cases.ravel())


def test_figures_of_all_models_come_before_those_of_one_and_what_cannot_be_drawn_is_left_out() -> None:
    """The order is that of the columns of the report, and of the pictures."""
    base = load_scene("path_line")
    own, found = [name for name, _, _ in base.model.headlines], list(headlines(base))
    assert own
    every = [name for name, _, _ in HEADLINES]
    assert found == [name for name in dict.fromkeys(every + own) if name not in NOT_DRAWN]
    assert [name for name in found if name in every] == found[: len(set(every) - set(NOT_DRAWN))]
