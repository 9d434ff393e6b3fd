"""The paper's study: its verdicts follow from its numbers."""

from __future__ import annotations

import errno
import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

from planar import published
from planar.animation import Movie
from planar.published import Parameters, Run
from scenes.running.report import markdown, terminal_lines
from scenes.studies.paper import cases, claims, differences, figures, report
from scenes.studies.paper.cases import CorrectedRow, Key, Overstatement, Row

ROW = Row(6, 2.0, 0.7, 4.5, 6.2, 1.2, 100.0)
CORRECTED = CorrectedRow(6, 2.0, "contact", "anchored", -0.1, 0.6, 0.01, None, 8000.0, 0.01, 8.0, 0, "it ended")
ALL = cases.published_keys()
OVERSTATED = Overstatement(2.0, 0.03, 120.0, None)


def numbers_in(sentence: str) -> list[float]:
    """The decimal numbers of a sentence, in order."""
    return [float(found) for found in re.findall(r"-?\d+\.\d+(?:e[+-]?\d+)?", sentence)]


def rows_by_segments(values: list[float]) -> list[Row]:
    return [replace(ROW, n=n, reported_distance_m=v) for n, v in zip(cases.SEGMENTS, values, strict=True)]


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([1.0, 2.0, 3.0, 4.0, 3.5], "holds"),
        ([1.0, 2.0, 1.5, 4.0, 3.5], "does not hold"),
        ([1.0, 2.0, 3.0, 4.0, 5.0], "does not hold"),
    ],
)
def test_verdict_on_the_number_of_segments(values: list[float], verdict: str) -> None:
    judged = claims._segment_claims(rows_by_segments(values))
    assert judged[0].verdict == verdict


def test_verdict_on_the_period() -> None:
    rows = [replace(ROW, T_wave_s=T, work_J=10.0 / T) for T in cases.PAPER_PERIODS_S]
    work, _, per_metre = claims._period_claims(rows)
    assert work.verdict == "holds"
    assert per_metre.verdict == "does not hold", "equal values do not rise"


@pytest.mark.slow
def test_the_differences_are_measured() -> None:
    run = published.simulate()
    by_name = {what: effect for what, _, _, effect in differences._ENTRIES}
    assert_allclose(numbers_in(by_name["centre of mass"](run))[:2], [0.739210, 1.250650], rtol=0, atol=1.5e-6)
    counted, signed = numbers_in(by_name["work"](run))[:2]
    assert_allclose([counted, signed], [4.547915, run.work_contract.sum()], rtol=0, atol=1.5e-6)
    amplitude = published.simulate(parameters=Parameters(contraction_force=1.0))
    assert any(
        abs(number - amplitude.reported_distance) < 1e-4 * abs(amplitude.reported_distance)
        for number in numbers_in(by_name["amplitude"](run))
    )


def test_report_holds_every_row_claim_and_difference() -> None:
    rows = [replace(ROW, n=n) for n in cases.SEGMENTS] + [
        replace(ROW, T_wave_s=T) for T in cases.PAPER_PERIODS_S if T != 2.0
    ]
    claim = claims.Claim("the claim", "IV.A", "holds", "the evidence")
    difference = differences.Difference("thing", "the text", "the program", "the effect")
    study = report.Study(rows, [claim], [difference], [CORRECTED], [replace(claim, claim="another")], [OVERSTATED])
    text = markdown(report.report(study, {}).pages["report.md"])
    # Once in Table II, five times in Table III, once compared with the print, once corrected.
    assert text.count("\n| 6 |") == 8
    assert (
        "| 6 | 0.739210 / 0.700000 (-3.9e-02) | 4.547915 / 4.500000 (-4.8e-02) | 6.1524 / 6.2000 (+4.8e-02) |" in text
    )
    assert "![" not in text
    drawn = report.report(study, {"figure_7.png": Figure()})
    assert "\n![figure 7](figure_7.png)\n" in markdown(drawn.pages["report.md"])
    assert "| 6 | 2 | contact | anchored | -0.1000 | 0.6000 | 0.0100 | none | 0.0100 |" in text
    assert "| 2 | 0.0300 | 120 | none |" in text
    assert "* **holds**: another (IV.A). Evidence: the evidence." in text
    assert "* **holds**: the claim (IV.A). Evidence: the evidence." in text
    assert "* **thing**. Text: the text. Program: the program. Effect: the effect." in text
    lines = list(terminal_lines(drawn.said, 100))
    assert max(map(len, lines)) <= 100
    assert "  holds: another" in lines
    assert any(line.startswith("Threshold friction overstates the distance of six segments by 120 %") for line in lines)


def test_tables_hold_the_papers_runs_once_each() -> None:
    assert cases.published_keys() == [
        (3, 2.0),
        (4, 2.0),
        (5, 2.0),
        (6, 2.0),
        (7, 2.0),
        (6, 1.0),
        (6, 3.0),
        (6, 4.0),
        (6, 5.0),
    ]
    (row,) = cases.published_rows({(3, 2.0): cases.published_run((3, 2.0))})
    assert_allclose(row.total_cot_J_per_m, 6.0267, rtol=0, atol=1e-4)
    assert_allclose(row.cumulative_cot_J_per_m, 1432.166, rtol=1e-4)


@pytest.fixture(scope="module")
def curves() -> dict[Key, Run]:
    """Every run of the tables, cut short."""
    return {(n, T): published.simulate(n=n, T_wave=T, steps=30) for n, T in ALL}


@pytest.mark.parametrize(
    ("number", "keys"),
    [(10, [(n, 2.0) for n in cases.SEGMENTS]), (12, [(6, T) for T in cases.PAPER_PERIODS_S])],
)
def test_the_centres_of_mass_are_those_of_the_right_runs(curves, number: int, keys: list[Key]) -> None:
    (figure,) = [f for stem, f in figures.published_figures(curves).items() if stem.startswith(f"figure_{number}_")]
    reported, true = figure.axes
    assert "as the paper reports it" in reported.get_title()
    assert "true" in true.get_title()
    for key, left, right in zip(keys, reported.lines, true.lines, strict=True):
        run = curves[key]
        assert left.get_label() in (f"n = {key[0]}", f"T = {key[1]:g} s")
        assert_allclose(left.get_xdata(), run.time)
        assert_allclose(left.get_ydata(), run.reported_com - run.reported_com[0])
        x = run.q[:, ::3, 0][:, : key[0] + 1].mean(axis=1)
        assert_allclose(right.get_ydata(), x - x[0], atol=1e-15)


@pytest.mark.parametrize(
    ("number", "keys"),
    [(11, [(n, 2.0) for n in cases.SEGMENTS]), (13, [(6, T) for T in cases.PAPER_PERIODS_S])],
)
def test_the_costs_are_those_of_the_right_runs(curves, number: int, keys: list[Key]) -> None:
    (figure,) = [f for stem, f in figures.published_figures(curves).items() if stem.startswith(f"figure_{number}_")]
    (axes,) = figure.axes
    for key, line in zip(keys, axes.lines, strict=True):
        assert_array_equal(line.get_ydata(), curves[key].cumulative_cot)


def test_the_segments_contract_one_at_a_time_and_the_wave_runs_to_the_head(curves) -> None:
    drawn = figures.published_figures(curves)
    seventh = drawn["figure_7_segment_activation"].axes[0]
    heights = np.array([line.get_ydata() for line in seventh.lines]) - np.arange(6)[:, None]
    assert set((heights > 0).sum(axis=0)) == {1}
    assert "our choice: T_contract = 0.333 s" in seventh.get_title()
    eighth = drawn["figure_8_segment_contraction_force"]
    assert "our choice" in eighth.get_suptitle()
    assert "10 N" in eighth.get_suptitle()
    assert all("highest contraction force: 10 N" in axes.get_title() for axes in eighth.axes[1:])
    ninth = drawn["figure_9_wave_contraction_force"].axes[0]
    force = np.array([line.get_ydata() for line in ninth.lines])[:, 200:400]
    assert (np.diff(np.argmax(force[2:5], axis=1)) > 0).all()
    assert_allclose(figures.CONTRACTION_FORCE, Parameters().contraction_force)


@pytest.fixture
def cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of a few steps, and nothing judged: the command itself is what is tested."""
    claim = claims.Claim("the claim", "IV.A", "holds", "the evidence")
    difference = differences.Difference("thing", "the text", "the program", "the effect")
    monkeypatch.setattr(cases, "published_run", lambda key: published.simulate(n=key[0], T_wave=key[1], steps=3))
    monkeypatch.setattr(cases, "corrected_run", lambda key: key)
    monkeypatch.setattr(
        report,
        "_study",
        lambda runs, others: report.Study(
            [*cases.published_rows(runs), replace(ROW, n=9, work_J=math.nan)],
            [claim],
            [difference],
            [CORRECTED],
            [claim],
            [OVERSTATED],
        ),
    )
    monkeypatch.setattr(report, "corrected_figures", lambda *_: {"corrected_figure_10": Figure(figsize=(1, 1))})


def test_the_command_writes_the_study(worm3d, cheap: None, tmp_path: Path) -> None:
    ended = worm3d("paper", "--out", "x")
    assert ended.code == 0
    assert "the paper's runs: 9 runs" in ended.err.splitlines()
    assert ended.out.splitlines()[-1].startswith("Written to x: report.md, paper.json, figure_7_")
    folder = tmp_path / "x"
    found = {path.name for path in folder.iterdir()}
    pictures = {name for name in found if name.endswith((".png", ".gif"))}
    assert found - pictures == {"paper.json", "report.md"}
    assert {f"{name.split('_')[0]}_{name.split('_')[1]}" for name in pictures} >= {f"figure_{n}" for n in range(7, 14)}
    text = (folder / "report.md").read_text()
    assert set(re.findall(r"!\[[^]]*\]\(([^)]*)\)", text)) == pictures
    study = json.loads((folder / "paper.json").read_text(), parse_constant=pytest.fail)
    assert {"rows", "claims", "differences", "corrected", "corrected_claims", "overstatements", "versions"} == set(
        study
    )
    assert {
        "n", "T_wave_s", "reported_distance_m", "work_J", "total_cot_J_per_m", "true_displacement_m"
    } <= set(study["rows"][0])  # fmt: skip
    assert [(row["n"], row["T_wave_s"]) for row in study["rows"][:-1]] == cases.published_keys()
    assert study["rows"][-1]["work_J"] is None
    assert study["claims"][0]["verdict"] == "holds"
    (folder / "notes.txt").write_text("mine")
    assert worm3d("paper", "--out", "x").code == 2
    ended = worm3d("paper", "--out", "x", "--force", "--quiet")
    assert (ended.code, ended.out, ended.err) == (0, "", "")
    assert (folder / "notes.txt").read_text() == "mine"


@pytest.mark.slow
def test_an_animation_that_cannot_be_written_leaves_no_part(
    worm3d, cheap: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Movie, path: Path, fps: int = 20) -> None:
        path.write_bytes(b"GIF8")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Movie, "save", full)
    ended = worm3d("paper", "--out", "x")
    assert ended.code == 1
    assert ended.complaints[-1] == "cannot write x/animation_6_segments.gif: no space left on device"
    assert not [path.name for path in (tmp_path / "x").iterdir() if "part" in path.name]


def test_the_papers_movie_is_drawn_like_that_of_a_scene() -> None:
    run = published.simulate(steps=3)
    movie = report._movie(run)
    assert_array_equal(movie.activation[0], run.activation[0])
    (ground,) = movie.figure.axes[0].patches
    assert_allclose(ground.get_y() + ground.get_height(), run.ground)
