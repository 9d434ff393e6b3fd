"""`accuracy.py`: what the program measures is what runs say, and the table that is shipped has every scene."""

from pathlib import Path

import accuracy
import measuring
import numpy as np
import pytest
from accuracy import Case, Found
from numpy.testing import assert_allclose
from speed_measures import StoppedError

from scenes.language.loader import shipped_scenes
from scenes.models.loading import load_scene
from scenes.running.runner import simulate

SHIPPED = (Path(__file__).parents[2] / ".docs" / "evidence" / "accuracy.md").read_text().split("\n## ")[1]


def test_the_shipped_table_has_every_case_and_the_cases_every_scene() -> None:
    for name in accuracy.CASES:
        assert SHIPPED.count(f"| {name} |") == 3, "accuracy.py says how to make the page anew"
    worms = {n for n in shipped_scenes() if load_scene(n).model.name in ("worm", "worm_planar")}
    assert {case.scene for case in accuracy.CASES.values()} == worms - {"free_fall", "slope"}


def test_the_shipped_table_fits_a_terminal() -> None:
    assert max(len(line) for line in SHIPPED.splitlines() if line.startswith("|")) <= 100


def test_differences_are_those_of_the_runs() -> None:
    changes = ("run.duration_s=1", "gait.hinge_deg=20")
    (found,) = accuracy.measure({"bends": Case("flat", changes)})
    summary = simulate(load_scene("flat", (*changes, "run.dt_s=0.005"))).summary
    assert_allclose(found.coarse[2, 0], [summary[name] for name in accuracy.METRICS], rtol=1e-9)
    off = np.abs(found.coarse[:, 0] / found.reference[0] - 1.0)
    assert (off[3] < off[0]).all(), "finer steps are better"
    page = accuracy.markdown([found])
    assert "## Turn: reference, and differences [degrees]" in page
    assert f"| bends | {found.reference[0, 0]:.4g} | " in page


def test_several_starts_are_a_mean_and_a_spread() -> None:
    reference = np.array([[1.0, 10.0, 2.0], [3.0, 20.0, 4.0]])
    found = Found("rough", reference, np.array([reference, reference + 1.0, reference, reference]))
    rows = [rows[0] for _, _, rows in accuracy.tables([found])]
    assert rows[0][:4] == ("rough", "2 ± 1", "0.0 ± 70.7", "+50.0 ± 70.7")
    assert rows[1][:4] == ("rough", "15.0 ± 7.1", "0.0 ± 7.1", "+1.0 ± 7.1")
    assert rows[2][3] == "+33.3 ± 47.1"


def test_rough_ground_is_entered_at_several_places_within_a_millimetre() -> None:
    assert accuracy.starts(Case("flat")) == [()]
    starts = accuracy.starts(Case("rubble", rough=True))
    places = [
        load_scene("rubble", start).settings.start.position_m  # type: ignore[attr-defined]
        for start in starts
    ]
    off = np.array(places) - load_scene("rubble").settings.start.position_m  # type: ignore[attr-defined]
    assert len(np.unique(off, axis=0)) == 8
    assert 0.0 < np.abs(off).max() <= 0.001


def test_what_has_no_value_is_a_dash() -> None:
    nothing = np.full((1, 3), np.nan)
    (_, _, (row,)), *_ = accuracy.tables([Found("vertical", nothing, np.full((4, 1, 3), np.nan))])
    assert row == ("vertical", *5 * ("-",))


def test_a_run_that_stops_is_a_sentence() -> None:
    with pytest.raises(StoppedError, match=r"^bench: folds, run\.dt_s="):
        accuracy.measure({"folds": Case("flat", ("gait.hinge_deg=110",))})


def test_the_program_prints_and_writes_its_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    page = tmp_path / "new" / "page.md"
    monkeypatch.setattr("sys.argv", ["accuracy.py", "--quick", "--out", str(page)])
    given = measuring.options("", quick=False, out=Path("runs", "accuracy.md"), seed=6)
    assert given.quick
    assert given.seed == 6
    measuring.publish("# Title\n", given.out)
    assert page.read_text() == capsys.readouterr().out == "# Title\n"


def test_a_name_that_is_not_known_ends_the_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["worlds.py"])
    assert measuring.options("", ("pipe", "mesh")).names == ["pipe", "mesh"]
    monkeypatch.setattr("sys.argv", ["worlds.py", "pip"])
    with pytest.raises(SystemExit):
        measuring.options("", ("pipe", "mesh"))
    assert "NAME: got 'pip', must be one of pipe, mesh" in capsys.readouterr().err
