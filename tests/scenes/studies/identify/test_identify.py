"""`worm3d study identify`: its runs, what it does with worms that tip, and what it writes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control.gaits import TravellingWave
from control.gaits.steering import BLEND, WAVE_SCHEDULES, GaitParameters, Schedule, SteeredWave
from control.identification.identified import Design, SteeringMap, lag, load
from control.identification.surrogate import Misfit, Ranges
from scenes.language.errors import SceneError
from scenes.models.control import identify as runs
from scenes.models.control.build import identified_of, map_name
from scenes.models.loading import load_scene
from scenes.studies.identify import command, figure, report, study
from worm3d import Friction, Worm

WORM, GROUND, SCHEDULE = Worm(), Friction(), Schedule()
SUBJECT, STEEP = (runs.Subject(WORM, GROUND, wave) for wave in (SCHEDULE, WAVE_SCHEDULES["steep"]))
FEW = {"hinge": (0.0, 0.08, 0.3), "bias": (0.0, 0.05, 0.2)}


@pytest.fixture(scope="module")
def curves() -> tuple[study.Curve, ...]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "CURVE_STEERINGS", FEW)
        return study.curves(SUBJECT)


@pytest.fixture(scope="module")
def turned() -> tuple[study.Phases, ...]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "PHASES_DEG", (0, 60, 120))
        return study.phases(SUBJECT)


def test_the_phase_decides_between_turning_and_shuffling(turned: tuple[study.Phases, ...]) -> None:
    """A long bending wave turns with the cosine of the phase; one as long as the contraction's hardly does."""
    assert [(each.mechanism, each.steering_wavelength) for each in turned] == [
        ("hinge", 1.4),
        ("hinge", 0.7),
        ("bias", 1.4),
        ("bias", 0.7),
    ]
    for long, short in (turned[:2], turned[2:]):
        assert max(np.abs(short.turn_deg)) < 0.4 * max(np.abs(long.turn_deg))
        np.testing.assert_allclose(np.add(long.turn_deg[:3], long.turn_deg[3:]), 0.0, atol=1e-12)
        first, second, third = long.turn_deg[:3]
        assert second == pytest.approx(first + third, abs=2.0), "a cosine of the phase: y(60) = y(0) + y(120)"
        assert long.chosen_deg == pytest.approx({"hinge": 90.0, "bias": 105.0}[long.mechanism] + 0.8 * 72.0)


def test_steady_runs_tell_a_worm_that_tips_from_one_that_stands() -> None:
    gaits = [SteeredWave(GaitParameters(0.3, 0.8, hinge=0.1)), TravellingWave(amplitude=0.3, bias=0.1)]
    stands, lies = (runs.steady(WORM, GROUND, gait, 7, 4) for gait in gaits)
    assert not stands.tipped
    assert np.rad2deg(stands.roll) < 5.0
    assert lies.tipped
    assert np.rad2deg(lies.roll) == pytest.approx(45.0, abs=1.0)
    assert lies.slip > 3.0 * stands.slip > 0.0
    parameters = [GaitParameters(0.3, 0.8, hinge=0.1), GaitParameters(0.3, 0.8, hinge=0.4)]
    assert runs.samples(SUBJECT, Design(), parameters) is None
    found = runs.samples(SUBJECT, Design(), parameters[:1])
    assert found is not None
    assert [(each.parameters, each.motion) for each in found] == [(parameters[0], stands.motion)]


def test_a_run_that_folds_counts_as_tipped() -> None:
    folded = runs.steady(WORM, GROUND, TravellingWave(amplitude=0.3, hinge=2.0), 7, 4)
    assert folded.motion is None
    assert folded.tipped


@pytest.mark.slow
def test_lags_are_those_of_the_file_and_of_a_step() -> None:
    """What the steering lags behind by, the generator's part included, is also what a step of it finds, (I3)."""
    lags = runs.measure_lags(SUBJECT, "hinge", 0.06)
    known = load(WORM)
    assert known is not None
    for name in ("amplitude", "frequency", "steering"):
        assert getattr(lags, name) == pytest.approx(getattr(known.lags["hinge"], name), abs=1e-6)
    assert 0.25 < lags.amplitude < 0.55
    straight = GaitParameters(0.3, runs.FREQUENCY)
    steps = [runs.step_response(SUBJECT, straight, straight.steered("hinge", 0.06), shift)[1] for shift in runs.SHIFTS]
    found = np.mean([lag(each, runs.BEFORE - 1) - 0.5 for each in steps]) / runs.FREQUENCY
    assert lags.steering + BLEND / runs.FREQUENCY == pytest.approx(found, abs=0.15)


@pytest.mark.slow
def test_the_swing_is_that_of_the_file_and_of_a_wave_between() -> None:
    """From 0.12 s at 0.6 Hz to -0.01 s at 1.1 Hz; sines of half the frequency and steering find the same.

    Linear algebra for AVX2 and for AVX-512 moves the swing by 1.3e-5 s; 1e-4 s are eight times as much.
    """
    known = load(WORM, schedule=WAVE_SCHEDULES["steep"])
    assert known is not None
    lags = known.lags["both"]
    measured = runs.measure_lags(STEEP, "both", 0.5, lags)
    assert (measured.swing, measured.swing_rise) == pytest.approx((lags.swing, lags.swing_rise), abs=1e-4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs, "WINDING", 0.05)
        _, found = runs._winding(STEEP, "both", 0.25, 0.8)
    assert lags.swing + 0.8 * lags.swing_rise == pytest.approx(found, abs=0.01)


def test_a_worm_that_tips_is_identified_over_less_steering(monkeypatch) -> None:
    """Hinges of 0.3 rad tip the default worm, 0.7 times as much does not at this amplitude."""
    asked = []

    def run(*given) -> list[object] | None:
        asked.append(max(abs(each.hinge) for each in given[-1]))
        return None if asked[-1] > 0.2 else [asked[-1]]

    monkeypatch.setattr(runs, "MAX_STEERING", {"hinge": 0.3})
    monkeypatch.setattr(runs, "samples", run)
    monkeypatch.setattr(runs, "fit_map", lambda mechanism, ranges, *given: ranges)
    assert runs.map_of(SUBJECT, Design(), "hinge").steering == pytest.approx(0.3 * 0.7**2)
    monkeypatch.setattr(runs, "samples", lambda *given: None)
    with pytest.raises(SceneError, match=r"tips over, folds or flattens even when it steers by 0\.103"):
        runs.map_of(SUBJECT, Design(), "hinge")


def test_check_runs_lie_within_the_ranges_and_last_whole_steps() -> None:
    ranges = Ranges((0.15, 0.4), (0.5, 1.25), 0.12)
    parameters = runs.check_parameters(ranges, "hinge")
    assert parameters == runs.check_parameters(ranges, "hinge")
    assert len(parameters) == 12
    for each in parameters:
        assert np.abs(ranges.scaled(each.amplitude, min(each.frequency, 1.25), each.hinge)).max() <= 1.0 + 1e-9
        assert 100.0 / each.frequency == pytest.approx(round(100.0 / each.frequency), abs=1e-9)


def test_curves_show_what_steers(curves: tuple[study.Curve, ...]) -> None:
    assert len(curves) == study.CURVES
    for curve in curves:
        middle = curve.points[1]
        assert not middle.tipped
        if curve.name == study.IN_STEP:
            assert abs(middle.turn_deg) < 2.0
        elif curve.name == "its own yaw joints":
            assert len(curve.useful) == 2, "the last steering is too much: the worm lies on its side"
            assert curve.speed_kept is not None
            assert curve.speed_kept > 1.0
            assert middle.turn_deg > 10.0


def told(*turns: tuple[float, float, bool]) -> list[str]:
    """What is said of a schedule that turns so far at such steerings, and tips."""
    points = [study.Point(s, turn, 0.1, 0.0, 0.0, 10.0 * s, tipped) for s, turn, tipped in ((0.0, 0.0, False), *turns)]
    curve = study.Curve("hinge", study.IN_STEP, tuple(points))
    return [report._line(curve), " | ".join(report._curve_row(curve))]


def test_what_is_said_of_a_schedule_is_what_its_figure_shows() -> None:
    """Hinges in step turn the default worm the other way at first, and then to the left by 8.5 degrees."""
    for text in told((0.04, -0.1, False), (0.06, 0.3, False), (0.25, 8.51, False), (0.3, 2.2, True)):
        assert (
            "turns the other way, or not, up to 0.04; then to the left, by up to 8.5° a wave at 0.25 (roll 2°)" in text
        )
    for text in told((0.04, -0.3, False), (0.1, -1.57, False), (0.15, 3.3, True)):
        assert "turns the other way, by up to 1.6° a wave at 0.1" in text
    for text in told((0.04, -9.0, True), (0.1, 9.0, True)):
        assert "the worm tips over from the start" in text


@pytest.fixture
def missed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, float]:
    """What fresh runs miss of a map corrected on the spot; there are no runs."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found = {"distance": 1.0, "turn": 5.0}

    def map_of(*given) -> SteeringMap:
        similar: SteeringMap = given[-1]
        checks = {name: Misfit(0.1, 0.1, percent) for name, percent in found.items()}
        return replace(similar, checks={**similar.checks, **checks})

    monkeypatch.setattr(runs, "map_of", map_of)
    return found


def test_a_worm_that_is_not_identified_gets_a_map_on_the_spot_which_is_kept(missed, monkeypatch) -> None:
    near = load_scene("path_line", ["worm.mass_kg=0.12"]).settings
    assert map_name(near) == "nearby"
    first = identified_of(near)
    assert list(first.maps) == ["both"]
    assert first.maps["both"].checks["turn"].rms_percent == 5.0
    asked = load_scene("path_line", ["worm.mass_kg=0.12", "controller.mechanism=bias"]).settings
    assert list(identified_of(asked).maps) == ["both", "bias"]
    monkeypatch.setattr(runs, "map_of", None)
    assert identified_of(near).maps["both"] == first.maps["both"]


def test_a_worm_that_is_far_from_the_default_one_is_refused_in_a_sentence(missed) -> None:
    missed["turn"] = 35.0
    far = load_scene("path_line", ["worm.mass_kg=0.12"]).settings
    with pytest.raises(SceneError, match="in the turn per wave is 35 %, must be at most 20 %: identify it once by"):
        identified_of(far)


def test_which_map_a_controller_goes_by() -> None:
    for choice, name in (("own", "identified"), ("nearby", "nearby"), ("default", "default")):
        assert map_name(load_scene("path_line", [f"controller.map={choice}"]).settings) == name


def test_each_wave_has_its_map() -> None:
    for wave, schedule in WAVE_SCHEDULES.items():
        settings = load_scene("path_line", [f"controller.wave={wave}"]).settings
        assert map_name(settings) == "identified"
        assert identified_of(settings).schedule == schedule


def test_a_map_of_each_wave_that_a_choice_asks_for_is_made(
    curves: tuple[study.Curve, ...], turned: tuple[study.Phases, ...], tmp_path: Path, monkeypatch
) -> None:
    made = []

    def measure(subject, quiet):
        made.append(subject.schedule)
        return load(WORM, schedule=subject.schedule), curves, turned

    monkeypatch.setattr(command, "_measure", measure)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for speed, waves in ((0.08, ["sine"]), (0.14, ["sine", "steep"])):
        made.clear()
        far = load_scene("path_line", ["worm.mass_kg=0.5", f"reference.speed_m_s={speed}"])
        command.run(far, tmp_path / "out", force=True, quiet=True)
        assert made == [WAVE_SCHEDULES[wave] for wave in waves]
        assert map_name(far.settings) == "identified"
        assert identified_of(far.settings).schedule == made[-1]


def test_the_command_writes_what_controllers_and_people_need(
    curves: tuple[study.Curve, ...], turned: tuple[study.Phases, ...], tmp_path: Path, monkeypatch, capsys
) -> None:
    known = load(WORM)
    monkeypatch.setattr(command, "_measure", lambda *given: (known, curves, turned))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert command.run(load_scene("flat"), tmp_path / "out", force=False, quiet=False) == 0
    said = capsys.readouterr().out
    assert "hinge: steering up to 0.12" in said
    assert "kept for controllers" in said
    content = json.loads((tmp_path / "out" / "identified.json").read_text("utf-8"))
    assert content["worm"]["k_yaw"] == 0.5
    assert content["maps"].keys() == content["speed_range_bl_s"].keys() == {"hinge", "bias", "both"}
    assert len(content["curves"]) == study.CURVES
    assert len(content["phases"]) == study.PHASE_STUDIES
    tables = (tmp_path / "out" / "steering.md").read_text("utf-8").splitlines()
    assert sum(line.startswith(("| hinge |", "| bias |")) for line in tables) == study.CURVES + 6
    assert (tmp_path / "out" / "steering.png").stat().st_size > 10_000
    assert len(list((tmp_path / "cache" / "worm3d" / "identified").glob("*.map"))) == 1
    with pytest.raises(SceneError, match="exists and is not empty"):
        command.run(load_scene("flat"), tmp_path / "out", force=False, quiet=True)


def test_the_figure_has_a_panel_for_each_quantity(
    curves: tuple[study.Curve, ...], turned: tuple[study.Phases, ...]
) -> None:
    known = load(WORM)
    assert known is not None
    axes = figure.draw(curves, turned, known).axes
    assert len(axes) == 8
    ours = next(c for c in curves if (c.mechanism, c.name) == ("bias", "its own yaw joints"))
    drawn = next(line for line in axes[4].lines if line.get_label() == "its own yaw joints")
    np.testing.assert_allclose(drawn.get_ydata()[:2], [p.turn_deg for p in ours.points[:2]])


def test_the_report_says_how_good_the_map_is(curves: tuple[study.Curve, ...]) -> None:
    known = load(WORM)
    assert known is not None
    lines = report.sentences(known, curves, 1.0)
    assert sum("rms of the fit (fresh runs)" in line for line in lines) == 3
    assert any("hinge, its own yaw joints: 10° at 1" in line for line in lines)
    low, high = report.speeds(known.maps["hinge"])
    assert low < 0.04 < 0.104 < high


def test_a_planar_scene_does_not_steer(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="planar_wave: a scene of the model 'planar_linkage' does not steer"):
        command.run(load_scene("planar_wave"), tmp_path / "out", force=False, quiet=True)
