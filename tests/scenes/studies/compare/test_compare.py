"""`worm3d compare` as people call it: tables, files and mistakes."""

from __future__ import annotations

import csv
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.models.loading import load_scene
from scenes.records import measured
from scenes.records.record import Record
from scenes.records.store import export_csv, save
from scenes.running import overlays
from scenes.running.runner import simulate
from scenes.studies.compare import page
from scenes.studies.compare.differences import named_by_settings
from scenes.studies.compare.sources import Source, sources
from scenes.sweep import case_file

BRIEF = ("run.duration_s=0.3", "worm.segments=3", "worm.mass_kg=0.03")


@pytest.fixture(scope="module")
def straight() -> Record:
    return simulate(load_scene("flat", BRIEF))


@pytest.fixture
def folder(straight: Record, tmp_path: Path) -> Path:
    """A folder with two runs, a case of a sweep and a measurement of the first run's head, 5 mm off to the left."""
    turning = simulate(load_scene("flat", [*BRIEF, "gait.hinge_deg=20"]))
    for name, record in (("straight", straight), ("turning", turning)):
        (tmp_path / name).mkdir()
        save(record, tmp_path / name / "result.nc")
    case_file.write(case_file.result_of("0" * 20, turning, tomllib.loads(turning.scene)), tmp_path / f"{'0' * 20}.json")
    head, com = straight["joints"][:, 3], straight["com"]
    rows = (
        f"{t!r},{x!r},{y + 0.005!r},{c!r}"
        for t, (x, y, _), c in zip(straight["time"].tolist(), head.tolist(), com[:, 0].tolist(), strict=True)
    )
    text = "\n".join(["# marker head: joint 3", "time_s,marker_head_x_m,marker_head_y_m,com_x_m", *rows])
    (tmp_path / "lab.csv").write_text(text)
    return tmp_path


def rows_of(path: Path) -> dict[tuple[str, str, str], dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return {(row["kind"], row["name"], row["source"]): row for row in csv.DictReader(file)}


@pytest.mark.slow
def test_two_runs_a_case_and_a_measurement(worm3d, folder: Path) -> None:
    case = "0" * 20
    ended = worm3d("compare", "straight", "turning/result.nc", f"{case}.json", "lab.csv", "--out", "x")
    assert ended.code == 0
    assert ended.err == ""
    for said in (
        "gait.hinge_deg",
        "distance_m",
        "com_displacement [m]",
        "marker_head [m]",
        "Written to x: compare.csv",
    ):
        assert said in ended.out
    assert {path.name for path in (folder / "x").iterdir()} == {
        *("compare.csv", "compare.html", "path.png", "centre_of_mass_and_heading.png", "strain.png", "markers.png"),
        "energy.png",
    }
    rows = rows_of(folder / "x" / "compare.csv")
    hinge = rows["setting", "gait.hinge_deg", "turning"]
    assert (hinge["reference"], hinge["value"]) == ("0.0", "20.0")
    of_run, of_case = (rows["figure", "distance_m", label] for label in ("turning", "gait.hinge_deg = 20.0"))
    assert {**of_run, "source": ""} == {**of_case, "source": ""}
    off = rows["series", "marker_head", "lab"]
    assert float(off["difference"]) == pytest.approx(0.005 / np.sqrt(2.0), rel=1e-9)
    assert float(off["value"]) == pytest.approx(0.005, rel=1e-9)
    assert float(rows["series", "com", "lab"]["difference"]) == 0.0
    text = (folder / "x" / "compare.html").read_text("utf-8")
    assert text.count("<iframe ") == 2
    for label in ("straight", "turning"):
        assert f"<figcaption>{label}</figcaption>" in text


@pytest.mark.slow
def test_a_measurement_that_lies_elsewhere_is_aligned_and_an_earlier_comparison_replaced(worm3d, folder: Path) -> None:
    (folder / "x").mkdir()
    for name in ("compare.html", "energy.png", "force_and_cable.png", "mine.txt"):
        (folder / "x" / name).write_text("of an earlier comparison")
    assert worm3d("compare", "straight", "lab.csv", "--align", "--out", "x").code == 2
    ended = worm3d("compare", "straight", "lab.csv", "--align", "--out", "x", "--force")
    assert ended.code == 0
    assert "no page side by side: 1 of the results can be seen in 3D, must be two or more" in ended.out
    left = {path.name for path in (folder / "x").iterdir() if path.read_bytes() == b"of an earlier comparison"}
    assert left == {"mine.txt"}
    assert not {"compare.html", "force_and_cable.png"} & {path.name for path in (folder / "x").iterdir()}
    rows = rows_of(folder / "x" / "compare.csv")
    assert float(rows["series", "marker_head", "lab"]["difference"]) < 0.001


@pytest.mark.slow
def test_mistakes_are_sentences(worm3d, folder: Path) -> None:
    (folder / "torn.csv").write_text("time_s,com_x_m\n0,0\n")
    (folder / "torn.json").write_text("{")
    (folder / "torn.nc").write_bytes((folder / "straight" / "result.nc").read_bytes()[:5000])
    for arguments, sentence in (
        (("straight",), "compare: got 1 results, must be 2 to 8; the first one is the reference"),
        (("straight",) * 9, "compare: got 9 results, must be 2 to 8"),
        (("straight", "nowhere"), "nowhere: no such file"),
        (("straight", "torn.csv"), "torn.csv: got 1 rows of numbers, must be two or more"),
        (("straight", "torn.json"), "torn.json: not the file of a case of a sweep, or damaged"),
        (("straight", "torn.nc"), "torn.nc: "),
        (("straight", "turning", "--out", "torn.nc"), "torn.nc is a file: choose a folder for --out"),
    ):
        ended = worm3d("compare", *arguments)
        assert ended.code == 2, arguments
        assert len(ended.complaints) == 1
        assert ended.complaints[0].startswith(sentence)


def test_equal_figures_are_in_the_csv_file_alone(worm3d, folder: Path) -> None:
    ended = worm3d("compare", "straight", "turning", "--out", "x")
    rows = [line.split()[0] for line in ended.out.splitlines() if line]
    assert "distance_m" in rows
    assert "duration_s" not in rows
    assert float(rows_of(folder / "x" / "compare.csv")["figure", "duration_s", "turning"]["difference"]) == 0.0


def test_cases_are_labelled_by_what_differs_else_by_digits() -> None:
    def labels(*scenes: dict[str, Any]) -> list[str]:
        given = [Source(f"{n}abcdef0" + "0" * 12, scene, {}, {}, None) for n, scene in enumerate(scenes)]
        return [source.label for source in named_by_settings(given)]

    def scene(period: float, seed: int, segments: int = 3) -> dict[str, Any]:
        return {"seed": seed, "gait": {"period_s": period}, "worm": {"segments": segments}}

    four, five = scene(4.0, 1), scene(5.0, 2)
    given = [Source("0" * 19 + digit, each, {}, {}, None) for digit, each in (("1", four), ("2", five))]
    assert [source.label for source in named_by_settings(given)] == ["gait.period_s = 4.0", "gait.period_s = 5.0"]
    assert labels(four, scene(4.0, 7)) == ["seed = 1", "seed = 7"]
    assert labels(four, scene(4.0, 7), scene(6.0, 3))[1:] == [
        "gait.period_s = 4.0, seed = 7",
        "gait.period_s = 6.0, seed = 3",
    ]
    assert labels(four, four) == ["0abcdef0", "1abcdef0"]


def test_labels_are_the_shortest_that_tell_them_apart(folder: Path) -> None:
    for name in ("one", "two"):
        shutil.copytree(folder / "straight", folder / name / "run")
    given = sources([folder / each for each in ("one/run", "two/run", "lab.csv", "one/run/result.nc")])
    assert [source.label for source in given] == ["run (1)", "two/run", "lab", "run (4)"]


def test_planar_worms_are_drawn_and_have_no_page() -> None:
    """They have two axes, and joints of another name."""
    records = {
        k: simulate(load_scene(name, ["run.duration_s=0.1"]))
        for k, name in enumerate(("planar_wave", "planar_published"))
    }
    given = {f"run {k}": record for k, record in records.items()}
    assert [stem for stem, _ in overlays.drawn(given)] == ["path", "centre_of_mass_and_heading", "strain"]
    pages, why = page.pages(given, "x")
    assert pages == {}
    assert why == "no page side by side: 0 of the results can be seen in 3D, must be two or more"


def test_curves_are_those_of_the_records(straight: Record, tmp_path: Path) -> None:
    export_csv(straight, tmp_path / "lab.csv")
    lab = measured.load(tmp_path / "lab.csv")
    found = overlays.strain({"sim": straight, "strange": replace(straight, variables=straight.variables[:1])})
    assert found is not None
    panels = found[0].axes
    assert [axes.get_ylabel() for axes in panels] == ["segment 2", "segment 1", "segment 0"]
    for segment, axes in enumerate(reversed(panels)):
        (line,) = axes.lines
        np.testing.assert_array_equal(line.get_ydata(), measured.segment_strain(straight)[:, segment])
    drawn = overlays.centre_of_mass_and_heading({"sim": straight, "lab": lab})
    assert drawn is not None
    sim, dots = drawn[0].axes[0].lines
    np.testing.assert_array_equal(sim.get_xydata(), dots.get_xydata())
    assert (sim.get_linestyle(), dots.get_linestyle()) == ("-", "None")


def test_what_nobody_has_is_not_drawn(straight: Record) -> None:
    bare = replace(straight, variables=straight.variables[:1])
    assert list(overlays.drawn({"a": bare, "b": bare})) == []
