"""Numbers of technologies that follow from others: compressed air, bending strips, thickness and times, idle power."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import TravellingWave
from worm3d import Command, Held, Plane, Status, Worm, simulate
from worm3d.physics.actuator_names import ACTUATORS, TECHNOLOGIES, Actuator, Pneumatic, Technology
from worm3d.physics.technologies.law import THICKNESS_POWER
from worm3d.physics.technologies.presets import ROOM_PRESSURE, bending, compressed_air

STILL = Held(joints=True, roll=True, bend=True)
LENGTH, WIDTH = 0.2, 0.04


def held(acting: Actuator, command: Any, duration: float, dt: float = 0.01) -> worm3d.Result:
    """Run a stiff segment of two chambers in the air."""
    told: dict[str, Any] = {"gravity": (0, 0, 0), "integrator": "implicit_euler", "held": STILL}
    worm = Worm(segments=1, length=LENGTH, mass=0.02, actuator=acting)
    run = simulate(worm, None, actuation=lambda t: Command([[command(t)] * 2]), duration=duration, dt=dt, **told)
    assert run.status is Status.DONE, run.stop.sentence
    return run


def chamber(gauge: float, dead: float, vacuum: float = 0.0) -> tuple[Pneumatic, float]:
    """Return a chamber with a supply of a gauge pressure [Pa], which a contraction of 0.1 asks for, and its volume."""
    filled = {"supply": gauge, "vacuum": vacuum, "gain": 10.0 * gauge, "conductance": 1e-4}
    acting = Pneumatic(width=WIDTH, dead_volume=dead, **filled)
    return acting, WIDTH * LENGTH * float(np.ravel(Worm(segments=1).half_height)[0]) + dead


def preset(gauge: float, volume: float) -> Technology:
    """Return a chamber of the same volume with the numbers that presets of compressed air have."""
    charge, charging = compressed_air(gauge)
    numbers = {"charge": charge, "charging": charging, "rise": 0.0, "fall": 0.0, "scales": True}
    return Technology(strain=0.1, stress=1.0, area=volume / LENGTH, **numbers)


@pytest.mark.parametrize("seed", range(12))
def test_a_stiff_chamber_draws_and_keeps_what_a_pneumatic_one_does(seed: int) -> None:
    """Random pressures, volumes and fillings, each vented before the next: drawn to 1e-6, kept at full pressure too."""
    rng = np.random.default_rng(seed)
    gauge, dead, count = rng.uniform(5e3, 500e3), rng.uniform(0.0, 1e-3), int(rng.integers(1, 4))
    air, volume = chamber(gauge, dead)
    steps = [0.0, *(each for part in rng.uniform(0.2, 1.0, count - 1) for each in (part, 0.0)), 1.0]

    def command(t: float) -> float:
        return float(0.1 * steps[min(int(t / 2.0 - 1e-9), len(steps) - 1)])

    witness, run = (held(each, command, 2.0 * len(steps)) for each in (air, preset(gauge, volume)))
    p, p0 = gauge + ROOM_PRESSURE, ROOM_PRESSURE
    closed = 2.0 * volume * sum(steps) * gauge * np.log(p / p0)
    assert_allclose(witness.energy.work_contract.sum(), closed, rtol=1e-6)
    assert_allclose(run.energy.work_contract.sum(), closed, rtol=1e-6)
    for each in (witness, run):
        assert_allclose(each.energy.actuator.sum(), 2.0 * volume * (p * np.log(p / p0) - gauge), rtol=1e-6)


@pytest.mark.parametrize(("gauge", "efficiency", "too_much"), [(60e3, 0.539, 0.231), (300e3, 0.611, 0.192)])
def test_efficiency_of_the_presets_of_air_and_what_they_keep_at_part_of_the_pressure(
    gauge: float, efficiency: float, too_much: float
) -> None:
    charge, charging = compressed_air(gauge)
    kind = "bellows_pneumatic" if gauge < 1e5 else "mckibben"
    assert (ACTUATORS[kind]().charge, ACTUATORS[kind]().charging) == (charge, charging)
    assert charging == pytest.approx(efficiency, abs=5e-4)
    p = ROOM_PRESSURE + gauge * np.linspace(0.0, 1.0, 1001)
    kept = p * (np.log(p / ROOM_PRESSURE) - 1.0) + ROOM_PRESSURE
    assert (np.linspace(0.0, 1.0, 1001) - kept / charge).max() == pytest.approx(too_much, abs=1e-3)


def test_a_vacuum_pump_draws_more_than_the_presets_count() -> None:
    air, volume = chamber(60e3, 1e-4, vacuum=-60e3)
    witness = held(air, lambda t: -0.1 * (t > 1e-9), 4.0)
    drawn, p0 = witness.energy.work_contract.sum(), ROOM_PRESSURE
    assert_allclose(drawn, 2.0 * volume * 60e3 * np.log(p0 / (p0 - 60e3)), rtol=1e-6)
    assert drawn / held(preset(60e3, volume), lambda t: 0.1 * (t > 1e-9), 1.0).energy.work_contract.sum() == (
        pytest.approx(1.93, abs=5e-3)
    )


def test_a_chamber_that_grows_takes_more_air_for_its_work() -> None:
    """Filled, then pulled open at full pressure: (p V_1 - p_0 V_0) ln(p/p_0) are drawn."""
    gauge = 3e3
    air, _ = chamber(gauge, 0.0)
    worm = Worm(segments=1, length=LENGTH, mass=0.02, actuator=air, k_spring=100.0)
    told: dict[str, Any] = {"gravity": (0, 0, 0), "integrator": "implicit_euler"}
    run = simulate(worm, None, actuation=lambda t: Command([[0.1 * (t > 1e-9)] * 2]), duration=8.0, dt=0.005, **told)
    p, p0, RT = gauge + ROOM_PRESSURE, ROOM_PRESSURE, air.gas_constant * air.temperature
    before, after = (run.actuator_states["air"][k].sum() for k in (0, -1))
    volume = after * RT / p
    assert volume > 1.01 * before * RT / p0
    assert_allclose(run.actuator_states["pressure"][-1], p, rtol=1e-6)
    assert_allclose(run.energy.work_contract.sum(), (p * volume - RT * before) * np.log(p / p0), rtol=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_strips_that_bend_have_the_stroke_and_the_force_of_a_cantilever(seed: int) -> None:
    """Curvature and moment integrated along the strip, and the blocking force from the flexibility of its tip."""
    rng = np.random.default_rng(seed)
    thickness, length, width = rng.uniform(1e-4, 5e-4), rng.uniform(2e-3, 2e-2), rng.uniform(1e-3, 1e-2)
    strain, modulus = rng.uniform(1e-3, 2e-2), rng.uniform(1e7, 1e9)
    x, dx = np.linspace(0.0, length, 20001, retstep=True)
    arm, stiffness = length - x, modulus * width * thickness**3 / 12.0
    free = np.trapezoid(2.0 * strain / thickness * arm, dx=dx)
    softness = np.trapezoid(arm**2 / stiffness, dx=dx)
    lever, stress = bending(thickness, length, modulus * strain)
    assert_allclose(lever * strain, free / length, rtol=1e-6)
    assert_allclose(stress * width * thickness / lever, free / softness, rtol=1e-6)


def test_strips_hold_the_default_worm_by_three_tenths_of_a_newton() -> None:
    acting = ACTUATORS["ipmc"]()
    assert isinstance(acting, Technology)
    assert_allclose(acting.stress * acting.size(Worm()) / acting.lever, 0.3, rtol=1e-9)
    assert_allclose(acting.charge, acting.stress * acting.strain / 2.0 / 0.02, rtol=1e-12)


WIRES = {0.10e-3: 1.0, 0.15e-3: 1.85, 0.20e-3: 3.0, 0.25e-3: 5.0, 0.38e-3: 10.0}
"""Cooling times that are told of wires [s], by thickness [m]."""


def test_thick_wires_are_slow_and_the_times_are_those_of_the_size() -> None:
    for diameter, seconds in WIRES.items():
        slower = ACTUATORS["sma_wire"]().slower(np.array(np.pi * diameter**2 / 4.0))
        assert 1.85 * slower == pytest.approx(seconds, rel=0.1)
    worm = Worm(k_spring=np.linspace(5.0, 40.0, 6))
    for kind in ("sma_wire", "sma_coil"):
        acting = ACTUATORS[kind]()
        given = acting.values(worm, hinge=False)
        thickness = np.sqrt(given["area"] / acting.gauge)
        assert np.ptp(thickness) > 0.2
        for name, power in (("rise", THICKNESS_POWER), ("fall", THICKNESS_POWER), ("leak", -THICKNESS_POWER)):
            assert_allclose(given[name], getattr(acting, name) * thickness**power, rtol=1e-12)
    bundle = ACTUATORS["sma_wire"](area=3e-8, gauge=3e-8).values(worm, hinge=False)
    assert_allclose(bundle["fall"], ACTUATORS["sma_wire"]().fall, rtol=1e-12)


def test_a_thin_wire_cools_in_the_time_of_its_thickness() -> None:
    """The drive of a held wire falls as exp(-t/fall), with the time constant of its own thickness."""
    thin = ACTUATORS["sma_wire"](area=np.pi * (0.06e-3) ** 2 / 4.0, hysteresis=0.0)
    run = held(thin, lambda t: 0.04 * (t < 3.0), 5.0, dt=0.005)
    drive, fall = run.actuator_states["drive"][:, 0, 0], thin.fall * 0.4**THICKNESS_POWER
    late = run.time > 3.05
    assert_allclose(np.diff(np.log(drive[late])) / 0.005, -1.0 / fall, rtol=1e-6)


def test_idle_power_is_drawn_in_every_step_by_a_worm_that_rests() -> None:
    run = simulate(Worm(actuator=ACTUATORS["servo_cable"]()), Plane(), duration=2.0)
    assert_allclose(run.energy.work_contract[1:], np.diff(run.time) * 7.2, rtol=2e-5)  # the weight is held as well
    assert_allclose(run.energy.actuator_loss[1:], run.energy.work_contract[1:], rtol=1e-9)
    assert run.actuator_states["warmth"].max() < 1e-4  # electronics do not warm the motor


@pytest.mark.parametrize("kind", TECHNOLOGIES)
def test_idle_power_adds_to_what_a_crawl_draws_and_loses_and_changes_nothing_else(kind: str) -> None:
    told: dict[str, Any] = {"actuation": TravellingWave(amplitude=0.1), "duration": 1.0}
    made = ACTUATORS[kind]
    none, some = (simulate(Worm(actuator=made(idle=watts)), Plane(), **told) for watts in (0.0, 0.25))
    assert_allclose(some.joints, none.joints, rtol=0, atol=0)
    for name in ("work_contract", "actuator_loss"):
        assert_allclose(getattr(some.energy, name)[1:] - getattr(none.energy, name)[1:], 12 * 0.25 * 0.01, rtol=1e-9)
    assert_allclose(some.energy.residual.sum(), none.energy.residual.sum(), atol=1e-9)


def test_only_what_the_field_does_is_counted_of_magnets() -> None:
    assert {kind for kind, made in TECHNOLOGIES.items() if made.uncounted} == {"magnetic"}
    assert {kind for kind, made in TECHNOLOGIES.items() if "idle" in made.sources} == {"servo_cable"}
