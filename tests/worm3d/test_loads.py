"""Payloads and tethers against closed forms: how they pull, stick and slide, and what becomes of the energy."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Held, Load, Payload, Pipe, Plane, Result, State, Status, Tether, Worm, simulate
from worm3d.machine.codegen import evaluate
from worm3d.physics.kernels import load as kernels
from worm3d.physics.load import LOAD_FREE, LOAD_HIGH, LOAD_LOW, LOAD_STICKING
from worm3d.running.plant import kernels as compiled
from worm3d.values.parameters import parameter

G = 9.81
WAVE = TravellingWave(period=1.0)
ON_AXIS = Held(joints=[[False, True, True]] * 2, roll=True, bend=True)


def done(result: Result) -> Result:
    assert result.status is Status.DONE, result.stop.sentence
    return result


def states(run: Result) -> dict[str, np.ndarray]:
    return {name.removeprefix("load_"): value for name, value in run.actuator_states.items()}


def slider(load: Any, **more: Any) -> Worm:
    """Return a segment as good as rigid, whose mass is on its joints."""
    return Worm(segments=1, joint_mass_fraction=1.0, k_spring=3e4, end_faces=False, load=load, **more)


def pulled(load: Any, force: Callable[[float], float], duration: float, dt: float = 0.01, **more: Any) -> Result:
    """Return the run of a segment on a straight line in a medium; the force acts on both joints."""

    def forces(t: float) -> np.ndarray:
        return np.array([[0.5 * force(t), 0.0, 0.0]] * 2)

    worm = slider(load, drag=1.0)
    return done(simulate(worm, None, external_force=forces, duration=duration, dt=dt, held=ON_AXIS, **more))


def uphill(tilt: float, load: Any, force: Callable[[float], float], duration: float, **more: Any) -> Result:
    """Return the same under a gravity that leans back by the tilt; the force acts beside what bears the worm."""
    lean = (-G * np.sin(tilt), 0.0, -G * np.cos(tilt))
    return pulled(load, lambda t: 0.1 * G * np.sin(tilt) + force(t), duration, gravity=lean, **more)


def push(t: float) -> float:
    """Return a force that moves a segment in its medium by about 0.4 m [N]."""
    return 0.4 * np.sin(np.pi * t / 2.0) ** 2


# -- the tether -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_straight_pull_feels_mu_w_s(seed: int) -> None:
    """In a medium, m x'' + zeta x' + mu w x = F t: the tension is mu w s, and the way is that of this equation."""
    rng = np.random.default_rng([71, seed])
    weight, mu, rate = rng.uniform(0.2, 2.0), rng.uniform(0.1, 0.8), rng.uniform(0.02, 0.1)
    stiff, m, zeta = weight * mu, 0.1, 1.0
    ways = []
    for dt in (0.004, 0.002):
        run = pulled(Tether(weight=weight, friction=mu), lambda t: rate * t, 2.0, dt)
        found, t = states(run), run.time
        assert_allclose(found["tension"], stiff * found["laid"], rtol=1e-12, atol=1e-15)
        assert_allclose(found["resistance"], found["tension"], rtol=1e-12, atol=1e-15)
        assert_array_equal(found["climb"], 0.0)
        ways.append((found["laid"] - run.joints[:, 0, 0] + run.joints[0, 0, 0])[-1])
        root = np.sqrt((zeta / 2 / m) ** 2 - stiff / m + 0j)
        p, q = -zeta / 2 / m + root, -zeta / 2 / m - root
        steady = rate * t / stiff - rate * zeta / stiff**2  # and A exp(p t) + B exp(q t) with x(0) = x'(0) = 0
        A = (-rate / stiff - q * rate * zeta / stiff**2) / (p - q)
        closed = (steady + A * np.exp(p * t) + (rate * zeta / stiff**2 - A) * np.exp(q * t)).real
        ways[-1] = np.abs(run.com[:, 0] - run.com[0, 0] - closed).max()
        assert run.energy.balance_error < 1e-12
    assert ways[1] < min(1e-6, 0.6 * ways[0]), ways


@pytest.mark.parametrize("ratio", [1.0, 1.3, 2.0])
def test_it_breaks_away_at_its_static_limit_and_not_before(ratio: float) -> None:
    """Pulled out, let go, and pulled ever harder: it slides once the pull is static_ratio mu w s."""

    def force(t: float) -> float:
        return 0.06 if t < 4.0 else 0.0 if t < 6.0 else 0.02 * (t - 6.0)

    run = pulled(Tether(weight=1.0, static_ratio=ratio), force, 14.0)
    found, t = states(run), run.time
    laid = found["laid"]
    limit = ratio * 0.3 * laid[t >= 5.0][0]
    before = (t >= 7.0) & (0.02 * (t - 6.0) < limit)
    rests = (t >= 7.0) & (0.02 * (t - 6.0) < 0.999 * limit)
    assert np.ptp(laid[before]) == 0.0
    assert np.ptp(run.joints[rests, 0, 0]) < 1e-5, "it sticks"
    assert_allclose(found["tension"][rests], 0.02 * (t[rests] - 6.0), rtol=2e-3)
    slides = np.flatnonzero((t >= 7.0) & (laid > laid[before][0]))[0]
    assert_allclose(found["tension"][slides - 1 : slides + 1].max(), limit, rtol=6e-3)
    assert laid[-1] > laid[slides] + 0.01
    assert_allclose(found["tension"][-1], 0.3 * laid[-1], rtol=1e-12)


def test_it_is_slack_until_the_tail_has_come_back() -> None:
    """Pulled out, pushed back and out again: nothing pulls before the old place, and never does it push."""

    def force(t: float) -> float:
        return (0.06, -0.06, 0.06)[int(t // 4.0)]

    run = pulled(Tether(weight=1.0), force, 11.9)
    found, x = states(run), run.joints[:, 0, 0] - run.joints[0, 0, 0]
    furthest = np.maximum.accumulate(x)
    assert (found["tension"] >= 0.0).all()
    assert x[800] < 0.1 < furthest[800], "it is pushed back by more than half"
    slack = x < furthest - 1e-5
    assert slack.sum() > 300
    assert_array_equal(found["tension"][slack], 0.0)
    assert_allclose(found["laid"], furthest, atol=3e-6)


def test_a_worm_that_backs_over_its_cable_draws_none_off_the_reel() -> None:
    """Pulled out by a, backed beyond the end by several free lengths and pulled out again: taut at the old place."""

    def force(t: float) -> float:
        return 0.06 if t < 4.0 else -0.4 if t < 7.0 else 0.4 if t < 9.4 else 0.1

    run = pulled(Tether(weight=1.0, free_length=0.1), force, 13.0)
    found, x = states(run), run.joints[:, 0, 0] - run.joints[0, 0, 0]
    furthest = np.maximum.accumulate(x)
    assert x.min() < -0.5, "beyond the end of the cable, which lies 0.1 m behind the start, and its free length"
    assert x[-1] > furthest[400] + 0.01, "it is drawn further at last"
    assert_allclose(found["laid"], furthest, atol=2e-5)
    back = x < furthest - 2e-5
    assert back.sum() > 400
    assert_array_equal(found["tension"][back], 0.0)
    assert_allclose(found["tension"][-1], 0.3 * found["laid"][-1], rtol=1e-9)
    assert run.energy.balance_error < 1e-12


@pytest.mark.parametrize("tilt", [-0.2, 0.15, 0.7, np.pi / 2])
def test_up_a_slope_and_in_an_upright_pipe_it_hangs(tilt: float) -> None:
    """T = w s (sin(theta) + mu cos(theta)) drawn up, and w s (sin(theta) - mu cos(theta)) at least when let down."""
    weight, mu = 0.5, 0.3
    run = uphill(tilt, Tether(weight=weight, friction=mu), push, 1.8)
    found = states(run)
    s = found["laid"]
    assert s[-1] > 0.1
    sine, cosine = np.sin(tilt), np.cos(tilt)
    assert_allclose(found["climb"], sine * s, rtol=1e-9, atol=1e-12)
    assert_allclose(found["resistance"], mu * weight * cosine * s, rtol=1e-9, atol=1e-12)
    sliding = np.flatnonzero(np.diff(s) > 1e-7) + 1
    assert len(sliding) > 50
    assert_allclose(found["tension"][sliding], weight * s[sliding] * (sine + mu * cosine), rtol=1e-6)
    assert run.energy.balance_error < 1e-12


def test_a_hanging_cable_slides_back_with_the_worm() -> None:
    """In an upright pipe the worm is let down: the cable always pulls by its hanging weight, and loses nothing."""

    run = uphill(np.pi / 2, Tether(weight=0.5, free_length=0.1), lambda t: 0.3 * np.sin(np.pi * t), 6.0)
    found, way = states(run), run.joints[:, 0, 0] - run.joints[0, 0, 0]
    far = found["laid"] > 0.003
    assert_allclose(found["tension"][far], 0.5 * found["laid"][far], rtol=1e-6)
    assert_allclose(found["tension"], 0.5 * found["laid"], atol=1e-3)
    assert_allclose(found["laid"], np.maximum(way, 0.0), atol=1e-5)
    assert (np.diff(found["laid"]) < -1e-4).sum() > 100
    assert abs(run.energy.friction_loss.sum()) < 1e-5
    assert run.energy.balance_error < 1e-12


def test_where_its_work_went() -> None:
    """Drawn up a slope by s: w sin(theta) s^2/2 is raised, mu w cos(theta) s^2/2 rubbed off."""
    tilt, weight, mu = 0.3, 0.5, 0.4
    run = uphill(tilt, Tether(weight=weight, friction=mu), push, 1.8)
    s = states(run)["laid"][-1]
    raised = 0.1 * G * np.sin(tilt) * (run.com[-1, 0] - run.com[0, 0])
    assert_allclose(run.energy.potential.sum() - raised, weight * np.sin(tilt) * s**2 / 2.0, rtol=1e-6)
    assert_allclose(run.energy.friction_loss.sum(), mu * weight * np.cos(tilt) * s**2 / 2.0, rtol=1e-6)


def test_on_level_ground_a_crawling_worm_feels_mu_w_s() -> None:
    """Though its tail rises and sinks; and it does not come as far."""
    runs = [
        done(simulate(Worm(load=load), Plane(), actuation=WAVE, duration=4.0)) for load in (Load(), Tether(weight=0.3))
    ]
    found = states(runs[1])
    s = found["laid"]
    assert s[-1] > 0.1
    assert np.abs(found["climb"]).max() < 1e-9
    assert (found["tension"] <= 0.3 * 0.3 * s * (1 + 1e-6)).all()
    sliding = np.flatnonzero(np.diff(s) > 1e-6) + 1
    assert_allclose(found["tension"][sliding], 0.09 * s[sliding], rtol=1e-6)
    assert runs[1].distance < runs[0].distance - 1e-3
    for run in runs:
        assert run.energy.balance_error < 1e-12


def random_load(rng: np.random.Generator, segments: int) -> tuple[Load, ...]:
    tether = Tether(
        weight=float(rng.uniform(0.0, 1.0)),
        friction=float(rng.uniform(0.0, 1.0)),
        static_ratio=float(rng.uniform(1.0, 1.5)),
        free_length=float(rng.uniform(0.02, 0.3)),
    )
    payload = Payload(mass=float(rng.uniform(0.0, 0.05)), joint=int(rng.integers(-1, segments + 1)))
    return [(tether,), (payload,), (payload, tether)][int(rng.integers(3))]


@pytest.mark.parametrize("seed", [25, 27])
def test_a_worm_in_a_pipe_comes_to_rest_with_a_tether_as_without(seed: int) -> None:
    rng = np.random.default_rng([99, seed])
    n = int(rng.integers(2, 9))
    bare = Worm(segments=n, half_height=0.3 / n, chamber_offset=0.18 / n)
    worm = Worm(segments=n, half_height=0.3 / n, chamber_offset=0.18 / n, load=random_load(rng, n)[-1:])
    tilt = float(rng.uniform(0.8, 2.0)), float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.0, np.pi / 2))
    pipe = Pipe(np.array([[0.0, 0.0, 0.0], [5.0 * np.cos(tilt[-1]), 0.0, 5.0 * np.sin(tilt[-1])]]), 0.6 / n)
    runs = [
        done(simulate(each, pipe, duration=0.01, state=State.straight(each, pipe, contraction=0.35)))
        for each in (bare, worm)
    ]
    assert_array_equal(runs[1].joints[0], runs[0].joints[0])
    assert states(runs[1])["laid"][0] == 0.0


@pytest.mark.parametrize("seed", range(12))
def test_the_ledger_closes_whatever_the_load(seed: int) -> None:
    """Random worms with random loads on random slopes and in pipes, both integrators, coarse and fine steps."""
    rng = np.random.default_rng([72, seed])
    n = int(rng.integers(2, 9))
    worm = Worm(segments=n, half_height=0.3 / n, chamber_offset=0.18 / n, load=random_load(rng, n))
    gait = TravellingWave(period=float(rng.uniform(0.8, 2.0)), bias=float(rng.uniform(-0.5, 0.5)))
    tilt = float(rng.uniform(0.0, np.pi / 2))
    pipe = Pipe(np.array([[0.0, 0.0, 0.0], 5.0 * np.array([np.cos(tilt), 0.0, np.sin(tilt)])]), 0.6 / n)
    world = [Plane(float(rng.uniform(-0.15, 0.15)), float(rng.uniform(-3, 3))), pipe][seed % 2]
    start = State.straight(worm, world, contraction=0.35 if world is pipe else 0.0)
    run = simulate(
        worm,
        world,
        Friction(0.1, 0.6, 0.6),
        gait,
        duration=2.0,
        dt=float(rng.choice([0.005, 0.01])),
        integrator=str(rng.choice(["bdf2", "implicit_euler"])),
        state=start,
    )
    assert len(run.newton_iterations) > 20, run.stop.sentence
    # walls press with many times the weight: rounding leaves 2e-12 J a step there, of a worm without loads too
    assert run.energy.balance_error < (3e-12 if world is pipe else 1e-12)
    assert (run.energy.friction_loss >= -1e-12).all()
    if "load_tension" in run.actuator_states:
        found = states(run)
        assert (found["tension"] >= -1e-12).all()
        assert (found["laid"] >= 0.0).all()


@pytest.mark.parametrize("gone", [0.0, 1.3])
def test_terms_of_a_tether_that_sticks_and_is_let_go(gone: float) -> None:
    """A stuck cable stores k y^2/2 and its damper loses b y'^2 dt; the rest of the step's work is numerical, O(dt)."""
    rest = []
    for dt in (0.004, 0.002):
        run = pulled(Tether(weight=1.0), lambda t: 0.06 if t < 4.0 else 0.01 * np.sin(gone * t), 6.0, dt)
        found, sums = states(run), {name: getattr(run.energy, name) for name in ("anchor", "friction_loss")}
        s = found["laid"][-1]
        assert_allclose(sums["friction_loss"].sum(), 0.3 * s**2 / 2.0, rtol=1e-6)
        assert 1e-12 < sums["anchor"].cumsum().max() < 1e-6, "a stiff spring stores little, and gives it back"
        assert sums["anchor"].cumsum().min() > -1e-12
        rest.append(abs(run.energy.numerical_loss.sum()))
    assert rest[1] < 0.8 * rest[0], rest
    assert rest[1] < 1e-3 * run.energy.work_external.sum()


def test_turned_and_mirrored_scenes_give_turned_and_mirrored_paths() -> None:
    angle, loads = 0.7, (Tether(weight=0.5), Payload(mass=0.03, joint=2))
    c, s = np.cos(angle), np.sin(angle)
    R, M = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.diag([1.0, -1.0, 1.0])
    worm = Worm(load=loads)

    def crawl(turn: float, heading: float, sign: float = 1.0) -> Result:
        plane = Plane(0.1, heading + turn)
        state, wave = State.straight(worm, plane, azimuth=turn), TravellingWave(period=1.0, bias=0.3 * sign)
        return done(simulate(worm, plane, actuation=wave, state=state, duration=3.0))

    first, turned, mirror = crawl(0.0, 0.4), crawl(angle, 0.4), crawl(0.0, -0.4, -1.0)
    assert np.abs(first.joints[-1, :, 1]).max() > 0.01, "it turns"
    origin = turned.joints[0, 0] - first.joints[0, 0] @ R.T
    assert_allclose(turned.joints, first.joints @ R.T + origin, rtol=0, atol=1e-8)
    assert_allclose(mirror.joints, first.joints @ M, rtol=0, atol=1e-8)
    for name in ("tension", "laid", "climb"):
        for other in (turned, mirror):
            assert_allclose(states(other)[name], states(first)[name], rtol=0, atol=1e-7)


# -- the payload ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("joint", [0, 2, -1])
def test_feet_carry_a_payload_where_it_is(joint: int) -> None:
    """Forces and moments balance about the common centre of mass; the worm's own does not know of it."""
    worm = Worm(load=Payload(mass=0.03, joint=joint))
    run = simulate(worm, Plane(), duration=0.02)
    force, place = (getattr(run, name)[-1].reshape(-1, 3) for name in ("contact_force", "points"))
    assert_allclose(force[:, 2].sum(), G * 0.13, rtol=1e-9)
    assert_allclose(np.cross(place, force).sum(axis=0)[1], -G * 0.13 * run.com_with_load[-1, 0], rtol=1e-9)
    assert_allclose(run.com_with_load, (0.1 * run.com + 0.03 * run.joints[:, joint]) / 0.13, rtol=1e-14)
    masses = (worm.joint_mass, worm.apex_mass.ravel())
    own = masses[0] @ run.joints[-1] + masses[1] @ run.apexes[-1].reshape(-1, 3)
    assert_allclose(run.com[-1], own / 0.1, rtol=1e-12, atol=1e-15)


def test_the_ends_of_a_floating_segment_move_as_their_masses_say() -> None:
    """Nothing acts from outside: the tail moves by m_head/m of the shortening, the payload's head by m_tail/m."""
    worm = Worm(segments=1, joint_mass_fraction=1.0, load=Payload(mass=0.15))
    shrink = worm3d.Command(np.full((1, 2), 0.2))
    run = done(simulate(worm, None, actuation=lambda t: shrink, duration=2.0, gravity=(0, 0, 0)))
    moved = run.joints[-1, :, 0] - run.joints[0, :, 0]
    assert_allclose(moved, np.array([0.2, -0.05]) / 0.25 * (moved[0] - moved[1]), rtol=1e-9)
    assert_allclose(run.com_with_load[-1], run.com_with_load[0], atol=1e-12)


def test_a_mass_on_a_spring_swings_at_its_own_period_and_bdf2_is_of_second_order() -> None:
    """The tail is held: omega^2 = k/l0/(m_head + M), to the square of the time step."""
    M, held = 0.05, np.array([[True] * 3, [False, True, True]])
    worm = Worm(segments=1, joint_mass_fraction=1.0, kelvin_voigt_time=0.0, load=Payload(mass=M), end_faces=False)
    omega, start = np.sqrt(13.0 / 1.0 / (0.05 + M)), 1e-4
    state = State(joints=[[0.0, 0.0, 0.0], [1.0 + start, 0.0, 0.0]])
    errors = []
    for dt in (0.004, 0.002, 0.001):
        run = simulate(worm, None, state=state, duration=0.4, dt=dt, gravity=(0, 0, 0), held=Held(held, True, True))
        errors.append(np.abs(run.joints[:, 1, 0] - 1.0 - start * np.cos(omega * run.time)).max() / start)
    assert errors[-1] < 1e-3
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.25)


def test_a_payload_falls_with_the_worm_and_the_ledger_knows_its_energy() -> None:
    worm = slider(Payload(mass=0.05))
    run = done(simulate(worm, None, duration=0.5))
    fallen = run.joints[0, 0, 2] - run.joints[-1, 0, 2]
    assert_allclose(run.joints[-1, 0, 2], run.joints[-1, 1, 2], atol=1e-12)
    assert_allclose(run.energy.potential.sum(), -0.15 * G * fallen, rtol=1e-12)
    assert_allclose(run.energy.kinetic.sum(), 0.15 * (G * 0.5) ** 2 / 2.0, rtol=1e-9)
    assert run.energy.balance_error < 1e-12


def test_both_costs_of_transport_are_reported() -> None:
    run = done(simulate(Worm(load=Payload(mass=0.03)), Plane(), actuation=WAVE, duration=3.0))
    summary = run.summary()
    assert_allclose(summary["cost_of_transport"], summary["work_contract_J"] / (0.1 * G * run.distance))
    both = summary["work_contract_J"] / (0.13 * G * summary["distance_with_load_m"])
    assert_allclose(summary["cost_of_transport_with_load"], both)
    assert abs(summary["distance_with_load_m"] - run.distance) > 1e-6
    bare = done(simulate(Worm(), Plane(), actuation=WAVE, duration=0.1))
    assert bare.summary()["cost_of_transport_with_load"] is None
    assert bare.reasons()["distance_with_load_m"] == "the worm carries no payload"


def test_a_payload_counts_where_chambers_would_be_pressed_flat() -> None:
    with pytest.raises(worm3d.LimitPointError):
        simulate(Worm(load=Payload(mass=1.0)), Plane(), duration=0.1)


# -- both -------------------------------------------------------------------------------------------------------------


def test_without_loads_the_bits_are_the_same() -> None:
    runs = [simulate(Worm(load=load), Plane(), actuation=WAVE, duration=0.5) for load in (Load(), ())]
    assert_array_equal(runs[0].joints, runs[1].joints)
    none = (Payload(mass=0.0), Tether(weight=0.0))
    light = simulate(Worm(load=none), Plane(), actuation=WAVE, duration=0.5)
    assert_allclose(light.joints, runs[0].joints, rtol=0, atol=1e-9)


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_a_run_that_is_cut_saved_and_loaded_goes_on_bit_for_bit(tmp_path: Path, integrator: str) -> None:
    worm = Worm(load=[Payload(mass=0.02, joint=3), Tether(weight=0.4, static_ratio=1.2)])
    given: dict[str, Any] = {"actuation": TravellingWave(period=1.0, bias=0.2), "integrator": integrator}
    whole = done(simulate(worm, Plane(0.05), duration=2.0, **given))
    first = done(simulate(worm, Plane(0.05), duration=0.8, **given))
    first.save(tmp_path / "first.nc")
    read = worm3d.load(tmp_path / "first.nc")
    assert read.worm.load == worm.load
    second = done(simulate(read.worm, read.world, duration=1.2, state=read.state, **given))
    assert_array_equal(second.joints, whole.joints[80:])
    assert list(whole.actuator_states) == [f"load_2_{name}" for name in Tether.states]
    for name, value in whole.actuator_states.items():
        assert_array_equal(second.actuator_states[name], value[80:])
        assert_array_equal(read.actuator_states[name], value[:81])


def test_a_worm_in_its_plane_and_on_the_clamped_ground_has_them() -> None:
    """The clamped ground bears the payload, (P9); in the plane the tether pulls as in space."""
    plain, loaded = (Worm.planar(mass=0.1, half_height=0.05), Worm.planar(mass=0.1, half_height=0.05))
    loaded = worm3d.Worm(**{f: getattr(loaded, f) for f in loaded.__dataclass_fields__} | {"load": Payload(mass=0.02)})
    runs = [simulate(worm, worm3d.ClampedGround(), duration=0.1) for worm in (plain, loaded)]
    more = runs[1].joint_load[-1] - runs[0].joint_load[-1]
    assert_allclose(more, [0.0] * 6 + [0.02 * G], atol=1e-9)
    towed = worm3d.Worm(**{f: getattr(plain, f) for f in plain.__dataclass_fields__} | {"load": Tether(weight=0.5)})
    run = done(simulate(towed, Plane(), Friction(0.05, 0.5), WAVE, duration=3.0))
    found = states(run)
    assert found["laid"][-1] > 0.02
    assert np.abs(run.joints[:, :, 1]).max() == 0.0
    assert (found["tension"] <= 0.15 * found["laid"] * (1 + 1e-6) + np.abs(0.5 * found["climb"]) + 1e-12).all()


@pytest.mark.parametrize("regime", [LOAD_FREE, LOAD_LOW, LOAD_STICKING, LOAD_HIGH])
@pytest.mark.parametrize("seed", range(3))
def test_derivatives(regime: float, seed: int) -> None:
    """Gradient and Hessian of the potential against differences, in each regime, of loads at random places."""
    rng, kinds = np.random.default_rng([73, seed]), (Payload, Tether)
    layout, made = kernels.layout(*kinds), compiled(loads=kinds)
    values = rng.uniform(0.5, 1.5, layout.rows)
    for name in ("0_joint", "regime"):
        layout.of(name, values)[:] = regime if name == "regime" else 0
    layout.of("1_free_length", values)[:] = 0.2
    for name, at in (("1_end_x_n", 0.0), ("1_end_y_n", 0.0), ("1_end_z_n", 0.0)):
        layout.of(name, values)[:] = at
    tail = slice(layout.first("x") + 3, layout.first("x") + 6)
    direction = rng.standard_normal(3)
    values[tail] = 0.3 * direction / np.linalg.norm(direction)
    x = slice(layout.first("x"), layout.first("x") + 6)

    def at(move: np.ndarray) -> np.ndarray:
        inputs, outputs = made["load_hessian"].allocate(1)
        inputs[:, 0] = values
        inputs[x, 0] += move
        evaluate(made["load_hessian"].address, inputs, outputs, 1)
        return outputs[:, 0].copy()

    h, here = 1e-6, at(np.zeros(6))
    moves = [at(h * e)[:7] - at(-h * e)[:7] for e in np.eye(6)]
    assert_allclose([each[0] / (2 * h) for each in moves], here[1:7], rtol=1e-6, atol=1e-6)
    curve = np.array([each[1:] / (2 * h) for each in moves])
    blocks = here[7:].reshape(2, 3, 3)
    assert_allclose(curve[:3, :3], blocks[0], rtol=1e-6, atol=1e-5)
    assert_allclose(curve[3:, 3:], blocks[1], rtol=1e-6, atol=1e-5)
    assert_allclose(curve[:3, 3:], 0.0, atol=1e-7)
    assert np.abs(here[1:7]).max() > 0.1


class Spring(Load):
    """A spring from a joint to the origin: a load of one's own."""

    @classmethod
    def respond(cls, s: Any) -> worm3d.LoadStep:
        energy = [1.5 * ca.sumsqr(x) for x in (s["x"], s["past"][:3])]
        return worm3d.LoadStep(energy[0], {"elastic": energy[0] - energy[1]})


class Wrong(Load):
    """A load whose term no ledger has."""

    @classmethod
    def respond(cls, s: Any) -> worm3d.LoadStep:
        return worm3d.LoadStep(ca.sumsqr(s["x"]), {"heat": 1.0})


@dataclass(frozen=True, eq=False, kw_only=True)
class Witness(Load):
    """No load, but one that keeps what it is given."""

    states: ClassVar[Mapping[str, str]] = {
        f"{name}{k}": "1" for name in ("tangent", "past", "velocity") for k in range(6)
    }
    joint: int = parameter(0, meaning="joint that it looks at", ge=0)

    @property
    def at(self) -> int:
        return self.joint

    @classmethod
    def respond(cls, s: Any) -> worm3d.LoadStep:
        given = {
            name: ca.vertcat(s[name], ca.SX.zeros(6 - s[name].numel())) for name in ("tangent", "past", "velocity")
        }
        return worm3d.LoadStep(
            0.0 * s["x"][0], {}, {f"{name}{k}": row[k] for name, row in given.items() for k in range(6)}
        )


@pytest.mark.parametrize("joint", range(4))
def test_a_load_sees_the_joint_that_it_acts_on(joint: int) -> None:
    """Places and velocities of the last two steps, and the tangent of the segment ahead; of the last one at the head.

    The worm flies, so that it rises and bends in all directions.
    """
    worm = Worm(segments=3, load=Witness(joint=joint))
    start = State.straight(worm, position=(0.0, 0.0, 1.0), azimuth=0.4)
    shaken = 0.2 * np.random.default_rng(7).standard_normal(start.joints.shape)
    run = done(simulate(worm, None, duration=0.1, state=start.with_changes(joint_velocity=shaken)))
    found = {
        name: np.column_stack([states(run)[f"{name}{k}"] for k in range(6)]) for name in ("tangent", "past", "velocity")
    }
    tangents = np.diff(run.joints, axis=1)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    assert np.ptp(tangents[-1], axis=0).min() > 1e-4
    assert_allclose(found["tangent"][2:, :3], tangents[1:-1, min(joint, 2)], rtol=0, atol=1e-9)
    assert_allclose(found["past"][2:], np.hstack([run.joints[1:-1, joint], run.joints[:-2, joint]]), rtol=0, atol=1e-12)
    speeds = run.joint_velocity[:, joint]
    assert_allclose(found["velocity"][2:], np.hstack([speeds[1:-1], speeds[:-2]]), rtol=0, atol=1e-12)


def test_a_load_of_ones_own() -> None:
    run = done(
        simulate(slider(Spring()), None, duration=0.5, gravity=(0, 0, 0), state=State(joints=[[1, 0, 0], [2, 0, 0]]))
    )
    assert run.com[-1, 0] < run.com[0, 0] - 0.1
    assert run.energy.balance_error < 1e-12
    with pytest.raises(ValueError, match=r"Wrong.respond: got the term 'heat', must be of"):
        simulate(slider(Wrong()), None, duration=0.1)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Worm(load=Payload(joint=7)), r"load.joint: got 7, must be from 0, the tail, to 6, or -1 for the head"),
        (
            lambda: Worm(load="tether"),
            r"load: got str, must be a worm3d.Load such as worm3d.Tether\(\), or some in a tuple",
        ),
        (lambda: Payload(mass=-1.0), r"mass: got -1.0 kg, must be finite and at least 0"),
        (lambda: Tether(static_ratio=0.5), r"static_ratio: got 0.5, must be finite and at least 1"),
        (lambda: Tether(free_length=0.0), r"free_length: got 0.0 m, must be finite and above 0"),
    ],
)
def test_what_is_refused(make: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()
