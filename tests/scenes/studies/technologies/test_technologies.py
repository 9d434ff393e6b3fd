"""`worm3d study technologies`: what it finds follows from its runs, and what cannot be compared is refused in words."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scenes.commands.app import app
from scenes.language.errors import SceneError
from scenes.models.worm.build import worm_of
from scenes.records.text import csv_table
from scenes.studies.technologies import limits, report, runs
from scenes.studies.technologies.limits import ALL, Verdict, judged
from scenes.studies.technologies.runs import Bench, Trial
from worm3d.physics.actuator_names import TECHNOLOGIES

RIGHT = ["run.dt_s=0.02"]


@pytest.fixture
def one_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "FACTORS", (1.0, 2.0))
    monkeypatch.setattr(runs, "MIN_RUN_PERIODS", 4)


@pytest.mark.usefixtures("one_period")
def test_files_sentences_and_a_weak_worm(tmp_path: Path) -> None:
    told = ["technologies", "flat", "--only", "dea_stack", "--only", "hydraulic", "--out", str(tmp_path / "a")]
    done = CliRunner().invoke(app, [*told, "-o", "run.dt_s=0.02"])
    assert done.exit_code == 0, done.output
    lines = (tmp_path / "a/technologies.csv").read_text().splitlines()
    rows = {row["technology"]: row for row in csv.DictReader(lines)}
    assert list(rows) == ["dea_stack", "hydraulic"]
    assert rows["dea_stack"]["limit"] == "stroke"
    assert float(rows["hydraulic"]["speed_bl_s"]) > 2.0 * float(rows["dea_stack"]["speed_bl_s"]) > 0.0
    assert (
        float(rows["hydraulic"]["cost_of_transport_input"]) > float(rows["hydraulic"]["cost_of_transport_given"]) > 0.0
    )
    text = (tmp_path / "a/technologies.md").read_text()
    assert "limited by its stroke: of the 0.2 that the gait asks for in 2 s it has 0.033" in text
    assert "estimate" in text
    assert (tmp_path / "a/technologies.png").stat().st_size > 20_000


@pytest.mark.slow
@pytest.mark.usefixtures("one_period")
def test_a_worm_that_its_actuators_cannot_move_says_which_limit_holds_it() -> None:
    weak = judged(Bench("flat", [*RIGHT, "actuator.area_m2=1e-9"]), "hydraulic")
    assert not weak.moves
    assert weak.limit == "force"
    assert "does not move the worm; what holds it is its force" in weak.sentence
    slow = judged(Bench("flat", [*RIGHT, "actuator.rise_s=60"]), "magnetic")
    assert (slow.moves, slow.limit) == (False, "speed")


def test_the_sentence_follows_from_the_numbers() -> None:
    acting = TECHNOLOGIES["servo_cable"]()
    own = Trial(period=2.0, speed=0.05, free=0.2, made=0.1, pull=1.0, warmth=50.0)
    verdict = Verdict("servo_cable", acting, np.full(6, 1e-4), 0.2, own, (own, Trial(period=1.0, speed=0.08)))
    said = {
        "force": "without load it would contract by 0.2, on the worm by 0.1, at 1 N",
        "speed": "with 0.02 s of lag and at most 1 of its stroke a second",
        "heat": "it warms by 50 K, and is switched off at 55 K",
        "stroke": "of the 0.2 that the gait asks for in 2 s it has 0.35",
        ALL: "limited by its limits together",
    }
    for name, words in said.items():
        without = {"speed": own, "force": own, name: Trial(period=2.0, speed=0.1)}
        sentence = replace(verdict, without=without).sentence
        assert words in sentence
        assert sentence.endswith("without that 2 times as fast; fastest at a period of 1 s: 0.08 BL/s")
    assert "no limit of its own costs it 5 %" in replace(verdict, without={"force": Trial(2.0, 0.052)}).sentence
    still = replace(verdict, own=Trial(2.0, 0.0), without={"force": Trial(2.0, 0.0)}, periods=())
    assert "would not without its limits" in still.sentence
    assert "did not come to its end: it burst" in replace(verdict, own=Trial(2.0, why="it burst")).sentence


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(SceneError, match=r"planar_wave: must be a scene of the model 'worm', with a gait"):
        Bench("planar_wave", ())
    done = CliRunner().invoke(app, ["technologies", "flat", "--only", "steam"])
    assert "must be one of sma_wire" in str(done.exception or done.output)


def test_what_is_not_counted_is_said_and_not_ranked() -> None:
    """Magnets draw least here, but their coils are not counted; servos idle, and their share is named."""
    verdicts = []
    for kind, drawn in (("magnetic", 2.9), ("hydraulic", 5.3), ("servo_cable", 170.0)):
        own = Trial(period=2.0, speed=0.05, drawn=drawn, given=0.8, power=0.3)
        verdicts.append(Verdict(kind, TECHNOLOGIES[kind](), np.full(6, 1e-4), 0.2, own, (own,)))
    table = csv_table(report.VERDICT_COLUMNS.values(), verdicts).decode().splitlines()
    rows = {row["technology"]: row for row in csv.DictReader(table)}
    assert [float(row["idle_W"]) for row in rows.values()] == pytest.approx([0.0, 0.0, 7.2])
    assert rows["magnetic"]["efficiency"] == ""
    assert "coils" in rows["magnetic"]["not_counted"]
    said = report.conclusion(verdicts)
    assert "hydraulic draws least for its way (5.3 times" in said
    assert "idle power is counted of servo_cable alone" in said
    assert "magnetic is not compared: what it draws leaves out what the coils or magnets draw" in said
    assert report.conclusion(verdicts[:1]).endswith("the work of the field alone.")


def test_wires_that_are_made_stronger_are_more_wires_of_the_same_thickness() -> None:
    bench = Bench("flat", RIGHT)
    acting, area, _ = bench.technology("sma_wire")
    worm = worm_of(bench.scene_of(("actuator.kind=sma_wire", *runs.lifted(bench, "sma_wire")["force"])).settings)
    given = worm.actuator.values(worm, hinge=False)
    assert np.asarray(given["area"]) == pytest.approx(runs.STRONGER * area)
    assert np.asarray(given["fall"]) == pytest.approx(acting.fall * acting.slower(area))
    assert bench.technology("sma_coil").slowest == pytest.approx(2.33, abs=0.01)
