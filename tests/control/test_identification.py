"""Identification: what is measured of a run, the lag of a step, the files, and the default worm's map on the plant."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits.steering import MECHANISMS, WAVE_SCHEDULES, GaitParameters, Schedule, SteeredWave
from control.identification import identified, surrogate
from control.identification.identified import (
    SHIPPED_MAPS,
    Design,
    Identified,
    Motion,
    Sample,
    fit_map,
    key,
    lag,
    load,
    steady_motion,
    store,
)
from worm3d import Friction, Plane, Pneumatic, Viscous, Worm, simulate

DESIGN = Design()


def rocking_arc(turn: float, distance: float, rows: int, waves: int) -> tuple[np.ndarray, np.ndarray]:
    """Return centre of mass and heading of a worm that goes round a circle and rocks within each wave."""
    phase = np.arange(waves * rows + 1) / rows
    h = 0.4 + turn * phase
    radius = distance / turn
    com = radius * np.column_stack([np.sin(h), -np.cos(h)])
    rock = np.sin(2.0 * np.pi * phase)
    return com + 0.02 * rock[:, None], h + 0.1 * rock


def test_steady_motion_of_an_arc() -> None:
    com, h = rocking_arc(np.deg2rad(12.0), 0.1, rows=50, waves=9)
    motion = steady_motion(com, h, 50, 4, length=2.0)
    chord = 0.05 * np.sin(np.deg2rad(6.0)) / np.deg2rad(6.0) * np.sinc(12.0 / 360.0)  # of averages over a wave
    assert motion.turn == pytest.approx(np.deg2rad(12.0), rel=1e-12)
    assert motion.distance == pytest.approx(chord, rel=1e-4)
    assert motion.drift == pytest.approx(0.0, abs=1e-9)


def test_steady_motion_tells_left_from_right() -> None:
    com, h = rocking_arc(np.deg2rad(12.0), 0.1, rows=50, waves=9)
    left = np.column_stack([-np.sin(h), np.cos(h)])
    sliding = com + 0.01 * (np.arange(len(h)) / 50)[:, None] * left
    motion = steady_motion(com, h - 0.2, 50, 4, length=1.0)
    assert motion.drift == pytest.approx(motion.distance * np.tan(0.2), rel=1e-6), "it moves to the left of its chord"
    assert steady_motion(sliding, h, 50, 4, 1.0).drift > 0.009


def test_steady_motion_needs_waves_and_a_heading() -> None:
    com, h = rocking_arc(0.2, 0.1, rows=50, waves=5)
    with pytest.raises(ValueError, match="got 5 waves of which 4 are skipped, must leave at least 2"):
        steady_motion(com, h, 50, 4, 1.0)
    with pytest.raises(ValueError, match="lost its heading"):
        steady_motion(com, np.full_like(h, np.nan), 50, 1, 1.0)


@pytest.mark.parametrize(("delay", "constant"), [(0, 0.8), (1, 0.5), (2, 0.0)])
def test_the_lag_is_delay_and_time_constant(delay: int, constant: float) -> None:
    waves = np.arange(40.0)
    since = np.maximum(0.0, waves - delay)
    # Mean over wave k of 1 - exp(-(t - delay)/constant).
    gone = constant * (np.exp(-since / constant) - np.exp(-(since + 1.0) / constant)) if constant else 0.0 * waves
    response = np.where(waves < delay, 0.0, 1.0 - gone)
    rates = 3.0 - 2.0 * np.concatenate([np.zeros(6), response])
    assert lag(rates, 6) == pytest.approx(delay + constant, abs=1e-9)
    with pytest.raises(ValueError, match="must change"):
        lag(np.ones(20), 6)


def test_a_map_finds_what_samples_follow() -> None:
    def motion(p: GaitParameters) -> Motion:
        return Motion(p.amplitude * (0.4 + p.hinge**2), 3.0 * p.hinge * p.frequency, -0.1 * p.hinge)

    def sampled(parameters: list[GaitParameters]) -> list[Sample]:
        return [Sample(p, motion(p)) for p in parameters]

    samples = sampled(DESIGN.parameters("hinge", 0.12))
    checks = sampled([GaitParameters(0.23, 0.7, hinge=-0.1), GaitParameters(0.31, 1.1, hinge=0.03)])
    found = fit_map("hinge", DESIGN.ranges(0.12), samples, checks)
    assert found.speed(0.3, 1.2, 0.1) == pytest.approx(1.2 * 0.3 * 0.41)
    assert found.turn_rate(0.3, 1.2, -0.1) == pytest.approx(-1.2 * 0.36)
    assert found.drift_speed(0.3, 1.2, 0.1) == pytest.approx(-0.012)
    assert max(misfit.rms_percent for misfit in (*found.misfits.values(), *found.checks.values())) < 1e-9


def test_files_are_read_as_they_were_written(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    default, other = load(Worm()), Worm(mass=0.11)
    assert default is not None, "the default worm's file has to be shipped under its key: worm3d study identify flat"
    assert load(other) is None
    assert store(default, other, Friction(), DESIGN)
    again = load(other)
    assert again is not None
    assert again.as_dict() == default.as_dict()
    assert load(other, Friction(forward=0.05)) is None
    (path,) = (tmp_path / "worm3d" / "identified").iterdir()
    path.write_bytes(path.read_bytes()[:100])
    assert load(other) is None, "a spoilt file counts as absent"


def test_the_key_is_made_of_all_parameters() -> None:
    worm, ground, schedule = Worm(), Friction(), Schedule()
    keys = {
        key(worm, ground, schedule, DESIGN),
        key(replace(worm, k_yaw=0.6), ground, schedule, DESIGN),
        key(replace(worm, half_height=np.linspace(0.04, 0.05, 6)), ground, schedule, DESIGN),
        key(worm, Friction(lateral=0.3), schedule, DESIGN),
        key(worm, ground, Schedule(lead=0.3), DESIGN),
        key(worm, ground, Schedule(steepness=2.0), DESIGN),
        key(worm, ground, schedule, Design(waves=9)),
        key(worm, Friction(law=Viscous()), schedule, DESIGN),
        key(Worm(actuator=Pneumatic()), ground, schedule, DESIGN),
        key(Worm(actuator=Pneumatic(supply=3e3)), ground, schedule, DESIGN),
    }
    assert len(keys) == 10
    assert key(worm, ground, schedule, DESIGN) == key(Worm(k_yaw=np.full(5, 0.5)), ground, schedule, DESIGN)


def test_a_parameter_that_has_its_default_does_not_enter_the_key() -> None:
    """So that maps are found again where a worm has got parameters that it had not when it was identified."""
    assert identified._unusual(Worm()) == identified._unusual(Friction()) == {}
    assert identified._unusual(Worm(k_yaw=0.6)) == {"k_yaw": 0.6}


def test_only_the_default_worm_is_shipped() -> None:
    names = {wave: f"{key(Worm(), Friction(), schedule, DESIGN)}.json" for wave, schedule in WAVE_SCHEDULES.items()}
    assert {path.name for path in SHIPPED_MAPS.glob("*.json")} == set(names.values())
    for wave, schedule in WAVE_SCHEDULES.items():
        content = json.loads((SHIPPED_MAPS / names[wave]).read_text("utf-8"))
        assert Identified.from_dict(content).on(Worm(), Friction()) == load(Worm(), schedule=schedule)
        assert Identified.from_dict(content).schedule == schedule


@pytest.mark.parametrize("schedule", WAVE_SCHEDULES.values(), ids=WAVE_SCHEDULES)
@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_the_shipped_map_agrees_with_fresh_runs(mechanism, schedule) -> None:
    default = load(Worm(), schedule=schedule)
    assert default is not None
    found = default.maps[mechanism]
    for amplitude, rows, share in ((0.28, 140, 0.6), (0.36, 90, -0.85)):
        steering = share * found.ranges.steering
        parameters = GaitParameters(amplitude, 100.0 / rows).steered(mechanism, steering)
        run = simulate(Worm(), Plane(), actuation=SteeredWave(parameters, schedule), duration=0.01 * rows * 8)
        motion = steady_motion(run.com, run.heading, rows, 4, 1.0)
        given = (parameters.amplitude, parameters.frequency, steering)
        assert found.distance(*given) == pytest.approx(motion.distance, rel=0.04)
        assert np.rad2deg(found.turn(*given)) == pytest.approx(np.rad2deg(motion.turn), abs=1.0)
        assert found.drift(*given) == pytest.approx(motion.drift, abs=0.003)


@pytest.mark.parametrize(("hinge", "share"), [(0.007, 0.23), (0.02, 0.73)])
def test_weak_steering_hardly_turns_since_feet_stick(hinge: float, share: float) -> None:
    """Told by the map and by fresh runs, as a share of what goes in proportion to steering by 0.06 rad."""
    default = load(Worm())
    assert default is not None
    found = default.maps["hinge"].turn
    turn = found(0.3, 0.8, hinge)
    assert turn / (found(0.3, 0.8, 0.06) * hinge / 0.06) == pytest.approx(share, abs=0.06)
    run = simulate(Worm(), Plane(), actuation=SteeredWave(GaitParameters(0.3, 0.8, hinge=hinge)), duration=10.0)
    assert turn == pytest.approx(steady_motion(run.com, run.heading, 125, 4, 1.0).turn, abs=0.003)


def test_the_default_worm_reaches_the_speeds_of_the_bars() -> None:
    default = load(Worm())
    assert default is not None
    for mechanism, found in default.maps.items():
        amplitude, frequency = np.meshgrid(np.linspace(*found.ranges.amplitude), np.linspace(*found.ranges.frequency))
        speed = found.speed(amplitude, frequency, 0.0)
        assert speed.min() < 0.04
        assert speed.max() > 1.3 * 0.08
        turns = np.rad2deg(found.turn(0.3, 0.8, np.linspace(0.0, found.ranges.steering, 25)))
        assert (np.diff(turns) > -0.1).all(), "it rises, but for what the map is off by"
        assert (np.diff(turns)[3:] > 0.1).all()
        assert turns[-1] > 10.0
        assert found.checks["distance"].rms_percent < (2.5 if mechanism == "both" else 2.0), "both turn more sharply"
        assert np.rad2deg(found.checks["turn"].rms) < 0.35
    assert_allclose([lags.amplitude for lags in default.lags.values()], 0.4, atol=0.1)
    assert_allclose([lags.steering for lags in default.lags.values()], 0.55, atol=0.1)


def test_both_mechanisms_turn_26_degrees_a_wave_and_the_map_knows_the_roll() -> None:
    """The bar of turning at amplitude 0.3, on the plant; the worm lies on its side at 45 degrees of roll."""
    default = load(Worm())
    assert default is not None
    found = default.maps["both"]
    run = simulate(Worm(), Plane(), actuation=SteeredWave(GaitParameters(0.3, 0.8).steered("both", 1.0)), duration=12.5)
    late = run.directors[5 * 125 + 1 :, :, 2]
    roll = np.abs(np.arcsin(late.mean(axis=1))).max()
    assert np.rad2deg(steady_motion(run.com, run.heading, 125, 5, 1.0).turn) > 26.0
    assert np.rad2deg(np.abs(np.arcsin(late))).max() < 6.0
    assert found.roll is not None
    assert found.roll(0.3, 0.8, 1.0) == pytest.approx(roll, abs=0.012)
    amplitude, frequency = np.meshgrid(np.linspace(*found.ranges.amplitude), np.linspace(*found.ranges.frequency))
    assert np.rad2deg(found.roll(amplitude, frequency, 1.0)).max() < 7.0, "within the ranges it has room to spare"


def test_a_design_of_half_the_runs_does_as_well() -> None:
    """At places that tell the most a map has nearly the coefficients of all combinations; at the first ones not."""
    places = [(p.amplitude, p.frequency, p.hinge) for p in Design(runs=240).parameters("hinge", 0.12)]
    ranges = DESIGN.ranges(0.12)
    chosen = [(p.amplitude, p.frequency, p.hinge) for p in DESIGN.parameters("hinge", 0.12)]
    assert len(set(chosen)) == DESIGN.runs == 120
    assert set(chosen) < set(places)
    default = load(Worm())
    assert default is not None
    turn = default.maps["hinge"].turn
    rng = np.random.default_rng(0)

    def noise_of(where: list[tuple[float, float, float]]) -> float:
        seen = turn(*np.array(where).T) + 0.002 * rng.standard_normal(len(where))
        off = surrogate.fit(ranges, "odd", where, seen)(*np.array(places).T) - turn(*np.array(places).T)
        return float(np.sqrt(np.mean(off**2)))

    assert noise_of(chosen) < 1.7 * noise_of(places)
    assert noise_of(places) < 0.002
    with pytest.raises(ValueError, match="number: got 241, must be at most that of the places, 240"):
        surrogate.informative(ranges, places, 241)


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    default = load(Worm())
    assert default is not None
    (tmp_path / "file").write_text("")
    assert not store(default, Worm(), Friction(), DESIGN, tmp_path / "file" / "below")
    assert identified.parameters(Worm())["rate_limit"] == "inf"
