"""Technologies of actuators against closed forms: drive, force and stroke, energy, heat, size, and their numbers."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kernel_states import COUNT, assert_close, differences, evaluated, some_segment
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Command, Held, Plane, Status, Worm, simulate
from worm3d.physics.actuator_names import ACTUATORS, TECHNOLOGIES, Technology
from worm3d.physics.kernels import actuator
from worm3d.running.plant import kernels
from worm3d.values.parameters import parameters_of

AT_ONCE: dict[str, Any] = {"rise": 0.0, "fall": 0.0}
STILL = Held(joints=True, roll=True, bend=True)


def technology(**numbers: Any) -> Technology:
    """Return one with a blocking force of 2 N, a free stroke of 0.4, and no lag unless the numbers say otherwise."""
    return Technology(**{"strain": 0.4, "stress": 2e4, "area": 1e-4, **AT_ONCE, **numbers})


def single(acting: Technology, command: Any, duration: float = 3.0, dt: float = 0.005, **more: Any) -> worm3d.Result:
    """Run a segment of 0.2 m in the air, both chambers commanded alike."""
    at = command if callable(command) else lambda t: command
    worm = Worm(segments=1, length=0.2, mass=0.02, actuator=acting, **more.pop("worm", {}))
    told = {"gravity": (0, 0, 0), "integrator": "implicit_euler", **more}
    run = simulate(worm, None, actuation=lambda t: Command([[at(t)] * 2]), duration=duration, dt=dt, **told)
    assert run.status is Status.DONE, run.stop.sentence
    return run


def test_the_drive_rises_and_falls_each_with_its_time_constant() -> None:
    """d = 1 - exp(-t/rise) from a step on, then exp(-t/fall)."""
    run = single(technology(rise=0.2, fall=0.7), lambda t: 0.4 * (t < 1.0 - 1e-9), duration=2.0, held=STILL)
    t, drive = run.time, run.actuator_states["drive"][:, 0, 0]
    assert_allclose(drive[:200], 1.0 - np.exp(-t[:200] / 0.2), atol=0.015)
    assert_allclose(drive[200:], drive[200] * np.exp(-(t[200:] - 1.0) / 0.7), rtol=1e-2)
    assert_allclose(run.contraction[:, 0, 0], 0.4 * drive, rtol=1e-12)


def test_delay_rate_and_band() -> None:
    ramp = single(technology(delay=0.1, rise=0.3), lambda t: 0.1 * t, duration=3.0, held=STILL)
    asked, drive = (ramp.actuator_states[name][:, 0, 0] for name in ("asked", "drive"))
    assert_allclose(asked[-1], 0.25 * (3.0 - 0.1), rtol=1e-9)  # a lag follows a ramp one time constant late
    assert_allclose(drive[-1], 0.25 * (3.0 - 0.4), rtol=1e-4)
    slow = single(technology(rate=0.5), lambda t: 0.4 * (t > 1e-9), duration=1.0, held=STILL)
    assert_allclose(slow.actuator_states["drive"][:, 0, 0], 0.5 * slow.time, atol=1e-12)
    w = 0.5
    wave = single(technology(hysteresis=w, rise=0.1, fall=0.1), lambda t: 0.4 * np.sin(t) ** 2, 12.0, held=STILL)
    d, a = (wave.actuator_states[name][:, 0, 0] for name in ("drive", "active"))
    assert (a <= np.minimum((1.0 + w) * d, 1.0) + 1e-12).all()
    assert (a >= (1.0 + w) * d - w - 1e-12).all()
    rises, falls = np.diff(a) > 1e-6, np.diff(a) < -1e-6
    assert_allclose(a[1:][rises], (1.0 + w) * d[1:][rises] - w, atol=1e-12)
    assert_allclose(a[1:][falls], (1.0 + w) * d[1:][falls], atol=1e-12)
    assert a.max() > 0.9


@pytest.mark.parametrize("drive", [0.3, 1.0])
def test_a_chamber_rests_where_the_line_of_force_and_stroke_meets_its_spring(drive: float) -> None:
    """F_b (a - z/s) = k z/2 with kappa = 1, and a F_b (1 - z/s) = k z/2 where the drive scales the force."""
    shifts = single(technology(), 0.4 * drive)
    z = 1.0 - shifts.chamber_length[-1, 0] / 0.2
    assert_allclose(z, 2.0 * drive / (2.0 / 0.4 + 13.0 / 2.0), rtol=1e-6)
    scales = single(technology(scales=True), 0.4 * drive)
    z = 1.0 - scales.chamber_length[-1, 0] / 0.2
    assert_allclose(z, 2.0 * drive / (2.0 * drive / 0.4 + 13.0 / 2.0), rtol=1e-6)
    assert_allclose(scales.actuator_states["pull"][-1, 0], 6.5 * z, rtol=1e-6)


def test_a_source_of_position_is_held_back_by_its_force() -> None:
    """Stiff: z = s a while the spring needs less than F_b; then the blocking force alone decides, with its droop."""
    stiff = single(technology(series=1000.0, droop=0.0, area=1.0e-3), 0.2)
    assert_allclose(1.0 - stiff.chamber_length[-1, 0] / 0.2, 0.2, rtol=1e-3)
    weak = single(technology(series=1000.0, droop=0.0, area=0.3e-4), 0.2)
    assert_allclose(1.0 - weak.chamber_length[-1, 0] / 0.2, 0.6 / 6.5, rtol=1e-6)
    drooping = single(technology(series=1000.0, droop=0.5, area=0.3e-4), 0.2)
    assert_allclose(1.0 - drooping.chamber_length[-1, 0] / 0.2, 0.6 / (6.5 + 0.3 / 0.4), rtol=1e-6)
    lever = single(technology(lever=2.0, series=1000.0, droop=0.0, area=0.3e-4), 0.2)
    assert_allclose(1.0 - lever.chamber_length[-1, 0] / 0.2, 0.3 / 6.5, rtol=1e-6)


def test_cables_do_not_push_and_hoops_lengthen() -> None:
    pushed: dict[str, Any] = {"external_force": lambda t: np.array([[1.0, 0, 0], [-1.0, 0, 0]]), "duration": 0.6}
    cable, rod = single(technology(), 0.0, **pushed), single(technology(push=1.0), 0.0, **pushed)
    assert_allclose(1.0 - cable.chamber_length[-1, 0] / 0.2, 1.0 / 13.0, rtol=1e-4)
    assert_allclose(1.0 - rod.chamber_length[-1, 0] / 0.2, 1.0 / (13.0 + 2.0 * 2.0 / 0.4), rtol=1e-4)
    one, other = single(technology(), 0.2), single(technology(lengthens=True), -0.2)
    assert_allclose(other.chamber_length - 0.2, 0.2 - one.chamber_length, atol=1e-3)
    assert other.chamber_length[-1, 0, 0] > 0.215
    assert_allclose(single(technology(lengthens=True), 0.2).chamber_length, 0.2, rtol=1e-12)
    both = single(technology(both_ways=True, push=1.0), -0.2)
    assert_allclose(1.0 - both.chamber_length[-1, 0] / 0.2, -2.0 * 0.5 / (2.0 / 0.4 + 13.0 / 2.0), rtol=1e-6)


def test_what_a_drive_without_work_draws() -> None:
    """A held chamber: E d is kept, leak E d is lost, and the sum of both is drawn, while it rises and stays."""
    hot = technology(rise=0.3, fall=0.8, charge=1e6, leak=1.25, charging=0.5)
    run = single(hot, lambda t: 0.4 * (t > 1e-9), duration=1.5, dt=0.001, held=STILL)
    energy, kept, t = run.energy, 2.0 * 1e6 * 1e-4 * 0.2, 1.5
    drive, area = 1.0 - np.exp(-t / 0.3), t - 0.3 * (1.0 - np.exp(-t / 0.3))
    pull = 2.0 * drive  # the chamber is held at its rest length
    assert_allclose(energy.actuator.sum(), kept * drive + pull**2 * 0.4 * 0.2 / 2.0, rtol=2e-3)
    assert_allclose(energy.actuator_loss.sum(), 1.25 * kept * area + kept * (drive + 1.25 * area), rtol=2e-3)
    work = pull**2 * 0.4 * 0.2 / 2.0  # of two springs in series with the drives
    assert_allclose(energy.work_contract.sum(), 2.0 * kept * (drive + 1.25 * area) + work, rtol=2e-3)


def test_a_drive_that_cools_as_it_falls_draws_nothing_then() -> None:
    wire = technology(rise=0.3, fall=0.8, charge=1e6, leak=1.25)
    run = single(wire, lambda t: 0.4 * (t < 0.5), duration=2.0, dt=0.002, held=STILL)
    drawn = run.energy.work_contract
    assert drawn[1:200].min() > 0.0
    assert drawn[260:].max() < 1e-6 * drawn[:200].max()


def test_work_is_drawn_at_its_efficiency_and_none_comes_back() -> None:
    run = single(technology(efficiency=0.25, rise=0.1, fall=0.1, push=1.0), lambda t: 0.2 * np.sin(t) ** 2, 2.0, 0.001)
    energy = run.energy
    rises = run.time <= 1.5
    gained = (energy.work_contract - energy.actuator_loss)[rises].sum()
    assert_allclose(gained, 0.25 * energy.work_contract[rises].sum(), rtol=0.02)
    assert energy.work_contract.min() > -1e-15
    assert energy.actuator_loss.min() > -1e-15
    to_the_worm = (energy.work_contract - energy.actuator - energy.actuator_loss).sum()
    went = sum(energy.sum((name,)).sum() for name in ("elastic", "kinetic", "viscous_loss", "numerical_loss"))
    assert_allclose(to_the_worm, went, rtol=1e-9)


RANDOM = {
    "strain": (0.05, 0.6),
    "stress": (1e4, 1e6),
    "series": (1.0, 30.0),
    "droop": (0.0, 1.0),
    "push": (0.0, 1.0),
    "delay": (0.0, 0.1),
    "rise": (0.0, 1.0),
    "fall": (0.0, 1.0),
    "rate": (0.5, 20.0),
    "charge": (0.0, 1e5),
    "leak": (0.0, 2.0),
    "charging": (0.3, 1.0),
    "efficiency": (0.1, 1.0),
    "stall": (0.0, 0.1),
    "idle": (0.0, 1.0),
    "hot": (0.0, 70.0),
    "heat_capacity": (0.01, 10.0),
    "cooling": (0.1, 100.0),
    "hottest": (30.0, 200.0),
}


def some_technology(seed: int) -> Technology:
    """Return one with random numbers, of all kinds in turn."""
    rng = np.random.default_rng(seed)
    numbers: dict[str, Any] = {name: rng.uniform(*span) for name, span in RANDOM.items()}
    kind = seed % 4
    return Technology(
        **numbers,
        scales=kind == 1,
        both_ways=kind == 2,
        lengthens=kind == 3,
        hysteresis=0.0 if kind == 2 else rng.uniform(0.0, 1.0),
        lever=rng.uniform(0.5, 3.0, 6),
        gauge=rng.uniform(1e-6, 1e-4, 6) if seed % 2 else None,
    )


def random_run(seed: int, world: Any, integrator: Any, dt: float) -> worm3d.Result:
    """Run a random worm with random commands on a random technology."""
    rng = np.random.default_rng(100 + seed)
    shape, rates = rng.uniform(-0.2, 0.3, (6, 2)), rng.uniform(1.0, 8.0, (6, 2))
    worm = Worm(actuator=some_technology(seed), k_spring=rng.uniform(5.0, 30.0, 6), mass=rng.uniform(0.03, 0.15))
    told: dict[str, Any] = {"integrator": integrator, "gravity": (0, 0, 0) if world is None else (0, 0, -9.81)}
    run = simulate(worm, world, None, lambda t: Command(shape * np.sin(rates * t) ** 2), 1.6, dt, **told)
    assert run.status is Status.DONE, run.stop.sentence
    return run


def given_to_the_worm(run: worm3d.Result) -> np.ndarray:
    return np.asarray(run.energy.work_contract - run.energy.actuator - run.energy.actuator_loss)


def given_by_hand(run: worm3d.Result) -> np.ndarray:
    """Return the mean pull of each step times the shortening, of all chambers, from what the run recorded [J]."""
    pull, length = run.actuator_states["pull"], run.chamber_length
    return np.asarray(((pull[1:] + pull[:-1]) / 2.0 * -np.diff(length, axis=0)).sum(axis=(1, 2)))


@pytest.mark.parametrize("world", [None, Plane()], ids=["air", "plane"])
@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
@pytest.mark.parametrize("seed", range(8))
def test_the_ledger_closes_for_random_worms_and_commands(seed: int, integrator: Any, world: Any) -> None:
    """What is drawn is kept, lost, or given to the chambers as pull times shortening: to rounding, in every step."""
    run = random_run(seed, world, integrator, 0.005)
    energy, given = run.energy, given_to_the_worm(run)
    assert abs(energy.residual.sum()) < 1e-11 * (np.abs(given).sum() + energy.friction_loss.sum())
    assert_allclose(given[1:], given_by_hand(run), rtol=0, atol=1e-11 * energy.work_contract.max())
    assert energy.work_contract.min() > -1e-12
    assert energy.actuator_loss.min() > -1e-12
    assert all(np.isfinite(values).all() for values in run.actuator_states.values())


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
@pytest.mark.parametrize("seed", range(4))
def test_what_the_integrator_misses_falls_with_the_step(seed: int, integrator: Any) -> None:
    """In the air, by first order: a step takes the pull at its end, and its kinks are few.

    From a step to its quarter, of which a first-order error leaves a fourth; one term too much would stay as it is.
    """
    missed, drawn = [], []
    for dt in (0.004, 0.001):
        run = random_run(seed, None, integrator, dt)
        missed.append(float(np.abs(run.energy.numerical_loss).sum() / np.abs(given_to_the_worm(run)).sum()))
        drawn.append(run.energy.work_contract.sum())
    assert missed[1] < missed[0] / 2.8
    assert drawn[1] == pytest.approx(drawn[0], rel=3e-3)


def test_gradient_and_hessian_of_a_segment() -> None:
    layout, made = actuator.chambers(Technology), kernels(chamber=Technology)
    rng, segment = np.random.default_rng(4), some_segment()
    dt = segment["dt"]
    values = segment | {name: np.zeros((size, COUNT)) for name, size in layout.sizes.items() if name not in segment}
    values |= {
        "span": np.where(np.arange(COUNT) % 2, 2.0 / 3.0 * dt, dt),
        "f": 0.0 * segment["f"],
        "K": 0.0 * segment["K"],
        "actuator_haste": np.ones((1, COUNT)),
    }
    values["f_ahead"] = values["f"]
    for name in parameters_of(Technology):
        low, high = RANDOM.get(name, (0.0, 0.0))
        values[f"actuator_{name}"] = rng.uniform(low, high, (1, COUNT))
    values |= {"actuator_area": np.full((1, COUNT), 1e-5), "actuator_lever": rng.uniform(0.5, 2.0, (1, COUNT))}
    values["actuator_lengthens"] = (np.arange(COUNT)[None] % 2).astype(float)
    values["actuator_scales"] = (np.arange(COUNT)[None] % 3 == 0).astype(float)
    for name, (low, high) in {"command": (-0.4, 0.4), "drive_n": (0.0, 1.0), "active_n": (0.0, 1.0)}.items():
        values[f"actuator_{name}"] = rng.uniform(low, high, (2, COUNT))

    def potential(q: np.ndarray) -> np.ndarray:
        return evaluated(made["segment_gradient"], layout, values | {"q": q})[:1]

    def gradient(q: np.ndarray) -> np.ndarray:
        return evaluated(made["segment_gradient"], layout, values | {"q": q})[1:]

    found = evaluated(made["segment_hessian"], layout, values)
    assert_close(found[None, 1:9], differences(potential, values["q"], 1e-5), 1e-6)
    assert_close(found[9:].reshape(8, 8, COUNT), differences(gradient, values["q"], 1e-6), 1e-6)


def test_a_motor_that_holds_warms_up_and_switches_off() -> None:
    """C T' = stall F_b - C T/cooling: T = stall cooling/(C/F_b) (1 - exp(-t/cooling)) while it holds F_b."""
    holding: dict[str, Any] = {"stall": 0.5, "heat_capacity": 0.1, "cooling": 4.0, "series": 50.0, "droop": 0.0}
    run = single(technology(**holding), lambda t: 0.4, duration=6.0, held=STILL)
    warmth = run.actuator_states["warmth"][:, 0, 0]
    assert_allclose(warmth, 20.0 * (1.0 - np.exp(-run.time / 4.0)), atol=0.15)
    off = single(technology(**holding, hottest=10.0), lambda t: 0.4, duration=12.0, held=STILL)
    assert off.actuator_states["warmth"].max() < 10.0
    assert off.actuator_states["drive"][-1, 0, 0] < 0.5
    assert off.actuator_states["pull"].max() > 1.9


def test_the_size_follows_from_the_worm() -> None:
    worm = Worm(k_spring=20.0, mass=0.2, actuator=ACTUATORS["muscle"]())
    size = ACTUATORS["muscle"](reserve=3.0).size(worm)
    assert_allclose(size * 0.35e6, 3.0 * (20.0 * 0.4 + 0.2 * 9.81) / 2.0)
    assert_allclose(ACTUATORS["magnetic"](room=0.01).size(worm), 0.01 * 2.0 * 0.05 * 0.08)
    hoops = technology(strain=0.9, lengthens=True).needed(Worm(k_spring=20.0, mass=0.2, stroke=(-0.1, 0.4)))
    assert_allclose(hoops * 2e4, 2.0 * (20.0 * 0.1 + 0.2 * 9.81) / 2.0)
    wire, levered = ACTUATORS["sma_wire"](), ACTUATORS["sma_wire"](lever=4.0)
    assert_allclose(levered.size(worm) / 4.0 * (20.0 * 0.04 + 1.962), wire.size(worm) * (20.0 * 0.16 + 1.962))


def test_every_number_has_a_source_and_all_share_their_kernels() -> None:
    assert set(TECHNOLOGIES) == {name for name, each in ACTUATORS.items() if issubclass(each, Technology)}
    for name, kind in TECHNOLOGIES.items():
        made = ACTUATORS[name]()
        changed = {each.name for each in fields(kind) if getattr(made, each.name) != getattr(Technology(), each.name)}
        assert type(made) is kind
        assert all(kind.sources.values())
        assert changed <= set(kind.sources)
        assert made.compiled() is Technology
        assert {"strain", "stress"} <= set(kind.sources)
        assert "Attributes" in (type(made).__doc__ or "")


@pytest.mark.parametrize("name", TECHNOLOGIES)
def test_a_worm_crawls_on_each_and_goes_on_bit_for_bit(name: str, tmp_path: Path) -> None:
    worm, gait = Worm(actuator=ACTUATORS[name]()), TravellingWave(amplitude=0.15, bias=0.2)
    whole = simulate(worm, Plane(), actuation=gait, duration=1.0)
    begun = simulate(worm, Plane(), actuation=gait, duration=0.5)
    begun.save(tmp_path / "a.nc")
    again = worm3d.load(tmp_path / "a.nc")
    assert again.worm.actuator == worm.actuator
    rest = simulate(again.worm, Plane(), actuation=gait, duration=0.5, state=again.state)
    assert whole.status is Status.DONE
    assert_array_equal(rest.joints, whole.joints[50:])
    assert_array_equal(rest.actuator_states["pull"], whole.actuator_states["pull"][50:])


def test_commands_mirrored_left_and_right_give_the_mirrored_run() -> None:
    shape = 0.2 * np.random.default_rng(7).uniform(0.0, 1.0, (6, 2))

    def run(sides: np.ndarray) -> worm3d.Result:
        worm = Worm(actuator=ACTUATORS["mckibben"]())
        return simulate(worm, Plane(), actuation=lambda t: Command(sides * np.sin(4.0 * t) ** 2), duration=1.0)

    one, other = run(shape), run(shape[:, ::-1])
    assert np.abs(one.com[-1, 1]) > 1e-4
    assert_allclose(other.joints, one.joints * [1.0, -1.0, 1.0], rtol=0, atol=1e-9)


def test_a_scene_names_it_and_each_kind_has_its_own_defaults() -> None:
    from scenes.language.errors import SceneError
    from scenes.models.loading import load_scene
    from scenes.models.worm.build import worm_of

    chosen = ["actuator.kind=sma_coil", "actuator.lever=2", "actuator.both_ways=false"]
    assert worm_of(load_scene("flat", chosen).settings).actuator == ACTUATORS["sma_coil"](lever=2.0)
    for wrong, line in (
        (["actuator.lever=2"], r"actuator.lever: only for actuator.kind = 'sma_wire' or 'sma_coil' or 9 others"),
        (["actuator.kind=ipmc", "actuator.strain=-1"], r"actuator.strain: got -1"),
        (["actuator.kind=muscle", "actuator.both_ways=true"], r"both_ways: got True, must be False where the drive"),
    ):
        with pytest.raises(SceneError, match=line):
            load_scene("flat", wrong)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: technology(both_ways=True, hysteresis=0.1), r"hysteresis: got 0.1, must be 0 in an actuator"),
        (lambda: technology(both_ways=True, scales=True), r"both_ways: got True, must be False where the drive scales"),
        (lambda: technology(efficiency=0.0), r"efficiency: got 0.0"),
        (lambda: Worm(actuator=technology(area=[1e-4, 2e-4])), r"actuator.area: got 2 values, must be a number or 6"),
        (lambda: Worm(hinge_actuator=technology()), r"hinge_actuator: got Technology, which acts on chambers alone"),
    ],
)
def test_what_is_wrong_is_said(make: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()
