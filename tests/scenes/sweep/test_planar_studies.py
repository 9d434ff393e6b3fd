"""The shipped studies of the planar worm are sweeps of `planar_linkage`: each case is the run of its own scene."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

from scenes.models.loading import load_scene
from scenes.records.store import load
from scenes.running.runner import simulate

BRIEF = ("-o", "run.duration_s=0.4", "-o", "gait.period_s=0.2")


@pytest.mark.slow
def test_each_case_is_the_run_of_its_scene(worm3d, tmp_path: Path) -> None:
    ended = worm3d("sweep", "planar_segments", *BRIEF, "--vary", "worm.segments=3,5", "--results", "--out", "x")
    assert ended.code == 0
    with (tmp_path / "x" / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, segments in zip(rows, (3, 5), strict=True):
        alone = simulate(load_scene("planar_wave", [*BRIEF[1::2], f"worm.segments={segments}"]))
        case = load(tmp_path / "x" / "cases" / f"{row['case']}.nc")
        for name in ("com", "joint", "cumulative_cot_contract"):
            assert_array_equal(case[name], alone[name])
        figures = {name: figure for name, figure in alone.summary.metrics.items() if isinstance(figure, float)}
        assert {name: float(row[name]) for name in figures} == figures


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar_segments", "planar_periods"])
def test_a_study_says_what_it_finds(worm3d, tmp_path: Path, name: str) -> None:
    ended = worm3d("run", name, "--out", "x")
    assert ended.code == 0
    says = load_scene(name).settings.says
    with xarray.open_dataset(tmp_path / "x" / "sweep.nc", engine="h5netcdf") as data:
        if name == "planar_segments":
            distance = data.distance_m.to_series()
            assert_allclose(distance, [0.11637, 0.19837, -0.00745, 0.03431, -0.03676], atol=2e-5)
            assert "four segments go furthest, 0.198 m in ten seconds" in says
            assert_array_equal(np.isnan(data.cost_of_transport), distance < 0.0)
            assert data.reason.sel({"worm.segments": 5}) == "the worm did not move forward (-0.007448 m)"
        else:
            work, distance = data.work_contract_J.values, data.distance_m.values
            assert f"falls from {work[0]:.2f} J to {work[-1]:.3f} J" in says
            assert f"the distance from {distance[0]:.3f} m to {distance[-1]:.3f} m" in says


def test_a_study_ends_with_its_table(worm3d, tmp_path: Path) -> None:
    ended = worm3d("study", "planar_segments", *BRIEF, "--out", "x")
    assert ended.code == 0
    first, header, *rows, files = ended.out.splitlines()
    assert first.startswith("planar_segments: 5 of 5 cases, ")
    assert header.split("  ")[1:3] == ["worm.segments", "distance [m]"]
    assert [row.split()[0] for row in rows] == ["3", "4", "5", "6", "7"]
    assert files.split() == ["files", "x"]
    drawn = {path.name for path in (tmp_path / "x").iterdir()}
    assert {"cases", "sweep.csv", "sweep.nc", "summary.json", "sweep_distance_m.png"} <= drawn
    plotted = worm3d("plot", "x/sweep.nc")
    assert (plotted.code, plotted.err.startswith("planar_segments: a sweep; its figures are beside it")) == (2, True)
    summary = json.loads((tmp_path / "x" / "summary.json").read_text())
    assert [row["worm.segments"] for row in summary["cases"]] == [3, 4, 5, 6, 7]
    assert_allclose(summary["duration_s"], 5 * 0.4)


def test_a_case_that_the_plant_would_refuse_fails_and_the_others_run(worm3d, tmp_path: Path) -> None:
    ended = worm3d("sweep", "planar_segments", *BRIEF, "--vary", "worm.mass_kg=0.07,5.0,0.08", "--out", "x")
    assert ended.code == 5
    assert ended.out.startswith("planar_segments: 3 of 3 cases, 1 failed (1 refused, not run)")
    with xarray.open_dataset(tmp_path / "x" / "sweep.nc", engine="h5netcdf") as data:
        assert data.status.values.tolist() == ["done", "failed", "done"]
        assert "segment 0 would be pressed flat: it carries " in str(data.reason.values[1])


def test_a_diverging_case_has_no_figures(worm3d, tmp_path: Path) -> None:
    options = ("--vary", "gait.amplitude=0.99,0.2", "-o", "run.duration_s=0.4", "--out", "x")
    ended = worm3d("sweep", "planar_periods", *options)
    assert ended.code == 5
    assert ended.complaints[-1].startswith("with gait.amplitude = 0.99: diverged: a joint came down to the ground")
    with xarray.open_dataset(tmp_path / "x" / "sweep.nc", engine="h5netcdf") as data:
        assert data.status.values.tolist() == ["diverged", "done"]
        assert np.isnan(data.distance_m).values.tolist() == [True, False]
