"""The pneumatic actuator against closed forms: filling a chamber, the balance of forces, energy, derivatives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kernel_states import COUNT, assert_close, differences, evaluated, some_segment
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from scenes.language.errors import SceneError
from worm3d import Command, Held, Plane, Pneumatic, Status, Worm, simulate
from worm3d.physics.kernels import actuator
from worm3d.physics.kernels.segment import SEGMENT_LAYOUT
from worm3d.running.plant import kernels
from worm3d.running.problem import Problem
from worm3d.running.run import Run

RT = 287.05 * 293.15
"""Gas constant times temperature of the default air [J/kg]."""


def volume(worm: Worm, length: np.ndarray) -> np.ndarray:
    """Return (A1) [m^3]."""
    air, a = worm.actuator, worm.link_length[0]
    assert isinstance(air, Pneumatic)
    return np.asarray(air.width * length * np.sqrt(a**2 - length**2 / 4.0) + air.dead_volume)


def filled(dt: float, integrator: Any, command: float = 0.4) -> tuple[worm3d.Result, np.ndarray]:
    """Fill the chambers of a segment that is held, from a step on; return the run and the closed form [Pa].

    p(t) = p_cmd + (p_0 - p_cmd) exp(-t/tau) with tau = V/(R T C) = 0.1 s.
    """
    still = Worm(segments=1, length=0.2, actuator=Pneumatic())
    conductance = float(volume(still, np.array(0.2))) / (RT * 0.1)
    worm = Worm(segments=1, length=0.2, actuator=Pneumatic(conductance=conductance))
    run = simulate(
        worm,
        None,
        actuation=lambda t: Command([[command, command / 2.0]]),
        duration=0.5,
        dt=dt,
        integrator=integrator,
        gravity=(0, 0, 0),
        held=Held(joints=True, roll=True, bend=True),
    )
    final = 101325.0 + 2e3 * np.array([command, command / 2.0])
    return run, final + (101325.0 - final) * np.exp(-run.time[:, None] / 0.1)


@pytest.mark.parametrize(("integrator", "order"), [("bdf2", 2.0), ("implicit_euler", 1.0)])
def test_a_held_chamber_fills_with_its_time_constant(integrator: str, order: float) -> None:
    errors = []
    for dt in (0.005, 0.0025, 0.00125):
        run, pressure = filled(dt, integrator)
        errors.append(np.abs(run.actuator_states["pressure"][:, 0] - pressure).max() / 800.0)
    assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), order, atol=0.15)
    assert errors[-1] < (1e-3 if integrator == "bdf2" else 1e-2)
    assert_allclose(run.chamber_length, 0.2, rtol=1e-14)


@pytest.mark.parametrize("command", [0.1, 0.4, -0.005])
def test_a_free_chamber_rests_where_springs_and_pressure_balance(command: float) -> None:
    """(k/2) (l/l0 - 1) = (p - p_0) dV/dl, with p the commanded pressure; both chambers alike."""
    worm = Worm(segments=1, length=0.2, actuator=Pneumatic(vacuum=-2e3, dead_volume=3e-5))
    run = simulate(worm, None, actuation=lambda t: Command([[command] * 2]), duration=12.0, gravity=(0, 0, 0))
    length, a = run.chamber_length[-1], worm.link_length[0]
    h = np.sqrt(a**2 - length**2 / 4.0)
    grows = 0.04 * (h - length**2 / (4.0 * h))
    assert_allclose(13.0 / 2.0 * (length / 0.2 - 1.0), 2e3 * command * grows, rtol=1e-9)
    assert_allclose(run.actuator_states["pressure"][-1], 101325.0 + 2e3 * command, rtol=1e-13)
    assert_allclose(run.actuator_states["air"][-1], (101325.0 + 2e3 * command) * volume(worm, length) / RT, rtol=1e-12)
    assert_allclose(run.contraction[-1], command, rtol=1e-8)


def test_the_command_is_kept_within_the_supply() -> None:
    worm = Worm(actuator=Pneumatic(supply=600.0, vacuum=-20.0))
    commands = np.linspace(-0.5, 0.9, 12).reshape(6, 2)
    run = simulate(worm, None, actuation=lambda t: Command(commands), duration=2.0, gravity=(0, 0, 0))
    assert_allclose(run.command[-1], np.clip(commands, -0.01, 0.3), rtol=1e-15)
    assert_allclose(run.actuator_states["pressure"][-1] - 101325.0, 2e3 * run.command[-1], rtol=0, atol=1.0)


def test_gradient_and_hessian_of_a_segment_full_of_air() -> None:
    layout, made = actuator.chambers(Pneumatic), kernels(chamber=Pneumatic)
    rng, segment = np.random.default_rng(4), some_segment()
    dt = segment["dt"]
    values = segment | {name: np.zeros((size, COUNT)) for name, size in layout.sizes.items() if name not in segment}
    values |= {
        "span": np.where(np.arange(COUNT) % 2, 2.0 / 3.0 * dt, dt),
        "f": 0.0 * segment["f"],
        "K": 0.0 * segment["K"],
    }
    values["f_ahead"] = values["f"]
    known = {"command": (0.0, 0.4, 2), "pressure_n": (1.00e5, 1.03e5, 2), "pressure_m": (1.00e5, 1.03e5, 2)}
    known |= {"air_n": (4e-4, 5e-4, 2), "air_m": (4e-4, 5e-4, 2), "width": (0.02, 0.06, 1), "gain": (1e3, 3e3, 1)}
    known |= {"supply": (1e3, 2e3, 1), "conductance": (1e-6, 1e-5, 1), "dead_volume": (0.0, 1e-4, 1)}
    values |= {f"actuator_{name}": rng.uniform(low, high, (size, COUNT)) for name, (low, high, size) in known.items()}
    for name, value in (("room", 101325.0), ("temperature", 293.15), ("gas_constant", 287.05)):
        values[f"actuator_{name}"] = np.full((1, COUNT), value)

    def potential(q: np.ndarray) -> np.ndarray:
        return evaluated(made["segment_gradient"], layout, values | {"q": q})[:1]

    def gradient(q: np.ndarray) -> np.ndarray:
        return evaluated(made["segment_gradient"], layout, values | {"q": q})[1:]

    found = evaluated(made["segment_hessian"], layout, values)
    assert_close(found[None, 1:9], differences(potential, values["q"], 1e-4), 1e-7)
    assert_close(found[9:].reshape(8, 8, COUNT), differences(gradient, values["q"], 1e-5), 1e-7)


def crawl(dt: float = 0.01, duration: float = 2.0, integrator: Any = "bdf2", **air: Any) -> worm3d.Result:
    worm, gait = Worm(actuator=Pneumatic(**air)), TravellingWave(amplitude=0.15)
    return simulate(worm, Plane(), actuation=gait, duration=duration, dt=dt, integrator=integrator)


def test_the_ledger_closes_and_the_valve_only_loses() -> None:
    """Whatever flows, source and valve take nothing back; the step's own error falls with the step."""
    runs = [crawl(dt, integrator="implicit_euler") for dt in (0.01, 0.005, 0.0025)]
    for run in runs:
        assert run.energy.balance_error < 1e-13
        assert (run.energy.actuator_loss > -1e-15).all()
        assert np.diff(run.energy.work_contract.cumsum()).min() > -1e-12
        assert run.energy.actuator_loss.sum() > 0.5 * run.energy.work_contract.sum()
    lost = np.array([run.energy.numerical_loss.sum() for run in runs])
    assert_allclose(lost[:-1] / lost[1:], 2.0, rtol=0.15)
    assert lost[-1] < 2e-3 * runs[-1].energy.work_contract.sum()


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_the_ledger_closes_from_a_contracted_start(integrator: Any) -> None:
    """A worm that is held at the command that it starts with: its first step works no more than any other."""
    worm = Worm(actuator=Pneumatic())
    start = worm3d.State.straight(worm, Plane(), contraction=0.3)
    wave = TravellingWave(amplitude=0.15).bind(worm)

    def actuation(t: float) -> Command:
        return Command(np.full((6, 2), 0.3) + wave(t - 0.2).contraction * (t > 0.2))

    run = simulate(worm, Plane(), actuation=actuation, duration=1.0, dt=0.01, state=start, integrator=integrator)
    work, lost = run.energy.work_contract, run.energy.actuator_loss
    assert run.status is Status.DONE
    assert run.energy.balance_error < 1e-13
    assert work.sum() > 1e-3
    assert np.abs(work[:20]).max() < 1e-12 * work.sum()
    assert lost.min() > (-1e-15 if integrator == "implicit_euler" else -1e-4 * work.sum())


def test_commands_mirrored_left_and_right_give_the_mirrored_run() -> None:
    shape = 0.2 * np.random.default_rng(7).uniform(0.0, 1.0, (6, 2))

    def run(sides: np.ndarray) -> worm3d.Result:
        worm = Worm(actuator=Pneumatic())
        return simulate(worm, Plane(), actuation=lambda t: Command(sides * np.sin(4.0 * t) ** 2), duration=1.0)

    one, other = run(shape), run(shape[:, ::-1])
    assert np.abs(one.com[-1, 1]) > 1e-4
    assert_allclose(other.joints, one.joints * [1.0, -1.0, 1.0], rtol=0, atol=1e-9)
    assert_allclose(other.actuator_states["pressure"], one.actuator_states["pressure"][..., ::-1], rtol=1e-9)


def test_a_run_is_saved_with_its_air(tmp_path: Path) -> None:
    run = crawl(duration=0.2, width=[0.03, 0.04, 0.05, 0.04, 0.03, 0.04])
    run.save(tmp_path / "air.nc")
    again = worm3d.load(tmp_path / "air.nc")
    assert again.worm.actuator == run.worm.actuator
    for name, values in run.actuator_states.items():
        assert_array_equal(again.actuator_states[name], values)
    for name in ("work_contract", "actuator", "actuator_loss"):
        assert_array_equal(getattr(again.energy, name), getattr(run.energy, name))
    gait = TravellingWave(amplitude=0.15)
    rests = [simulate(each.worm, Plane(), actuation=gait, duration=0.1, state=each.state) for each in (run, again)]
    assert_array_equal(rests[1].actuator_states["air"], rests[0].actuator_states["air"])


def test_crawling_converges_with_the_time_step() -> None:
    fine = crawl(0.00125).com[-1, 0]
    errors = [abs(crawl(dt).com[-1, 0] - fine) for dt in (0.01, 0.005)]
    assert errors[1] < 0.7 * errors[0]
    assert errors[1] < 1e-3
    assert fine > 0.1


@pytest.mark.parametrize("seed", range(6))
def test_any_air_leads_to_a_result(seed: int) -> None:
    """From valves that are all but shut to wide open ones, narrow and wide chambers, weak and strong supplies."""
    rng = np.random.default_rng(seed)

    def log_uniform(low: float, high: float, size: Any = None) -> Any:
        return np.exp(rng.uniform(np.log(low), np.log(high), size))

    air = {
        "conductance": log_uniform(1e-9, 1e-3),
        "width": log_uniform(0.01, 0.1, 6),
        "dead_volume": log_uniform(1e-7, 1e-3),
        "gain": log_uniform(200.0, 5e3, 6),
        "supply": log_uniform(200.0, 5e4),
        "vacuum": -rng.uniform(0.0, 2e3),
        "room": log_uniform(1e4, 2e5),
    }
    worm = Worm(actuator=Pneumatic(**air))
    run = simulate(worm, Plane(), actuation=TravellingWave(amplitude=0.1, bias=0.3), duration=1.0, dt=0.01)
    assert run.status is Status.DONE, run.stop.sentence
    assert all(np.isfinite(states).all() for states in run.actuator_states.values())
    assert run.energy.balance_error < 1e-11


def test_a_run_goes_on_bit_for_bit_and_a_batch_is_as_single_runs() -> None:
    whole, begun = crawl(), crawl(duration=1.0)
    worm, gait = whole.worm, TravellingWave(amplitude=0.15)
    rest = simulate(worm, Plane(), actuation=gait, duration=1.0, state=begun.state)
    assert_array_equal(rest.joints, whole.joints[100:])
    assert_array_equal(rest.actuator_states["pressure"], whole.actuator_states["pressure"][100:])
    batch = worm3d.simulate_batch([worm, Worm()], Plane(), actuation=gait, duration=1.0)
    assert_array_equal(batch[0].joints, begun.joints)
    assert_array_equal(batch[0].actuator_states["air"], begun.actuator_states["air"])


def test_a_scene_names_it(tmp_path: Path) -> None:
    from scenes.models.loading import load_scene
    from scenes.models.worm.build import worm_of

    chosen = ["actuator.kind=pneumatic", "actuator.width_m=0.05", "actuator.supply_Pa=900"]
    worm = worm_of(load_scene("flat", chosen).settings)
    assert worm.actuator == Pneumatic(width=0.05, supply=900.0)
    with pytest.raises(SceneError, match=r"actuator.width_m: only for actuator.kind = 'pneumatic'"):
        load_scene("flat", ["actuator.width_m=0.05"])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Pneumatic(vacuum=-2e5), r"vacuum: got -200000 Pa, must be above -101325 Pa"),
        (lambda: Pneumatic(conductance=0.0), r"conductance: got 0.0"),
        (lambda: Worm(actuator=Pneumatic(width=[0.04, 0.05])), r"actuator.width: got 2 values, must be a number or 6"),
        (lambda: Worm(hinge_actuator=Pneumatic()), r"hinge_actuator: got Pneumatic, which acts on chambers alone"),
    ],
)
def test_what_is_wrong_is_said(make: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


def test_a_worm_that_starts_contracted_gets_no_work_for_nothing() -> None:
    """Its springs rest at their own lengths from the start: a constant command brings in what the valve lets in."""
    worm = Worm(segments=2, length=0.4, actuator=Pneumatic())
    start = worm3d.State.straight(worm, contraction=0.3)
    run = simulate(worm, None, actuation=lambda t: Command(np.full((2, 2), 0.3)), duration=0.1, dt=0.001, state=start)
    assert run.energy.work_contract.min() > -1e-15
    assert run.energy.balance_error < 1e-13
    assert np.abs(run.energy.elastic[1]) < 1e-4


def test_a_pressure_beyond_that_of_a_contraction_of_one_is_kept(tmp_path: Path) -> None:
    """Near the length with the most volume air moves a chamber little: its pressure may be of any size."""
    worm = Worm(segments=1, length=0.15, mass=0.02, actuator=Pneumatic(gain=500.0, supply=800.0, conductance=1e-6))
    chosen: Any = {"actuation": lambda t: Command([[0.99, 0.99]]), "dt": 0.002}
    # A chamber that is stretched has less room for its air.
    pressed: Any = {"external_force": lambda t: np.array([[-3.0, 0, 0], [3.0, 0, 0]]) * (t > 0.2), "gravity": (0, 0, 0)}
    whole = simulate(worm, None, duration=0.4, **chosen, **pressed)
    begun = simulate(worm, None, duration=0.21, **chosen, **pressed)
    begun.save(tmp_path / "a.nc")
    rest = simulate(worm, None, duration=0.19, state=worm3d.load(tmp_path / "a.nc").state, **chosen, **pressed)
    assert begun.contraction[-1].max() > 1.0
    assert_array_equal(rest.joints, whole.joints[105:])


def test_every_segment_of_a_contracted_pose_has_the_rest_length_of_its_actuator() -> None:
    worm = Worm(actuator=Pneumatic())
    state = worm3d.State.straight(worm, None, contraction=np.full((6, 2), 0.2))
    plant = Run(Problem(worm=worm, world=None, state=state, gravity=(0.0, 0.0, 0.0))).plant
    plant.set_pose(state)
    lengths = SEGMENT_LAYOUT.of("commanded", plant.arrays["segment_in"])[:, :6]
    assert_allclose(lengths, worm.l0, rtol=1e-15)  # pressure bears what is asked, no shorter springs
