"""The energy ledger: closed at every step, with energies, works and losses that closed forms confirm."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import TravellingWave
from worm3d import ClampedGround, Command, Friction, Held, Patch, Plane, Result, State, Status, Worm, simulate
from worm3d.physics.friction import ContactConstants
from worm3d.recorded.energy import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY, TERMS, Energy

INTEGRATORS = ("implicit_euler", "bdf2")
N = 6
TURN = TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5)
SLOPE = Plane(0.1, 0.7)
OMEGA, SPEED = np.array([3.0, 1.0, -2.0]), np.array([0.5, 0.1, 0.3])
PATCHES = Plane(patches=(Patch(0.0, along=(0.3, 0.6)), Patch(3.0, along=(0.6, 0.8))))


def uneven_worm(**changes: Any) -> Worm:
    """Return a worm in which every parameter counts and differs along the body."""
    rng = np.random.default_rng(4)
    values = {
        "half_height": rng.uniform(0.045, 0.055, N),
        "k_spring": rng.uniform(10.0, 20.0, N),
        "k_torsion": rng.uniform(2.0, 10.0, N - 1),
        "k_yaw": rng.uniform(0.4, 0.8, N - 1),
        "k_twist": rng.uniform(0.4, 0.8, N - 1),
        "cross0": rng.uniform(-0.02, 0.02, N - 1),
        "k_apex": rng.uniform(0.01, 0.03, N),
    }
    return Worm(**values | changes)


def tumbling(worm: Worm) -> State:
    """Return a straight worm in the air that turns like a rigid body."""
    state = State.straight(worm, position=(0.0, 0.0, 5.0), azimuth=0.4)
    roll_rate = float((state.joints[1] - state.joints[0]) @ OMEGA / worm.l0)
    return state.with_changes(joint_velocity=np.cross(OMEGA, state.joints) + SPEED, roll_rate=roll_rate)


def forced(t: float) -> Command:
    """Return a turning wave with chamber forces."""
    return TravellingWave(amplitude=0.1, force=0.4, bias=0.3, hinge=0.4).bind(Worm())(t)


def pushes(t: float) -> np.ndarray:
    f = np.zeros((N + 1, 3))
    f[:, 0], f[2, 1], f[4, 2] = 0.02 * np.sin(3 * t), 0.05 * np.cos(2 * t), 0.03 * t
    return f


CASES: dict[str, dict[str, Any]] = {
    "flat": {"actuation": TravellingWave()},
    "slope": {"world": SLOPE, "actuation": TravellingWave(), "ground": Friction(0.3, 0.5, 0.4)},
    "turning": {"actuation": TURN},
    "turning on a slope": {"world": SLOPE, "actuation": TURN},
    "flight": {"world": None, "actuation": TURN, "state": tumbling(Worm())},
    "clamped": {"world": ClampedGround(), "actuation": TravellingWave()},
    "clamped turning": {"world": ClampedGround(), "actuation": TURN},
    "chamber forces": {"actuation": forced},
    "external forces": {"actuation": TURN, "external_force": pushes},
    "medium": {"worm": uneven_worm(drag=0.5), "actuation": TURN},
    "uneven": {"worm": uneven_worm(), "world": SLOPE, "actuation": TURN, "ground": Friction(0.3, 0.6, 0.4, 1.3)},
    "held tail": {"actuation": TravellingWave(), "held": Held(np.arange(N + 1)[:, None] == 0)},
    "dropped": {"actuation": TURN, "state": State.straight(Worm(), Plane(), (0.0, 0.0, 0.05)), "settle_first": False},
    "patches": {"world": PATCHES, "actuation": TURN},
    "rate limit": {"worm": Worm(rate_limit=0.5, actuator_lag=0.0), "actuation": TURN},
    "planar": {"worm": Worm.planar(), "actuation": TravellingWave(amplitude=0.1)},
}


def crawl(case: dict[str, Any], **changes: Any) -> Result:
    arguments = {"worm": Worm(), "world": Plane(), "duration": 2.4} | case | changes
    result = simulate(arguments.pop("worm"), arguments.pop("world"), **arguments)
    assert result.status is Status.DONE, result.stop.sentence
    return result


def absolute(result: Result) -> np.ndarray:
    """Return the sum of the absolute terms of each row [J]."""
    return np.sum(
        [np.abs(getattr(result.energy, name)) for name in (*SUPPLIED_ENERGY, *STORED_ENERGY, *LOST_ENERGY)], axis=0
    )


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", CASES)
def test_ledger_closes_at_every_step(name: str, integrator: str) -> None:
    result = crawl(CASES[name], integrator=integrator)
    energy, scale = result.energy, absolute(result)[1:]
    assert energy.balance_error < 1e-9
    assert scale.min() > 1e-5
    assert np.abs(energy.residual[1:] / scale).max() < 1e-9
    assert energy.viscous_loss.min() >= 0.0
    assert energy.viscous_loss.sum() > 1e-4
    if "clamped" not in name:  # whose friction (P10) goes by the velocity of the predictor
        assert energy.friction_loss.min() >= 0.0
    assert (energy.friction_loss.sum() > 1e-4) == (name != "flight")


def test_ledger_closes_over_rows_of_many_steps_and_halved_ones() -> None:
    """A wave of square jumps, steps halved among them, in rows of seven."""

    def jumps(t: float) -> Command:
        return Command(np.full((N, 2), 0.3 * (np.floor(10 * t) % 2)))

    result = crawl({"actuation": jumps, "worm": Worm(actuator_lag=0.0)}, record_every=7, dt=0.01, duration=2.1)
    assert np.abs(result.energy.residual[1:] / absolute(result)[1:]).max() < 1e-9
    assert_allclose(np.diff(result.time), 0.07, rtol=1e-12)


def transported(a: np.ndarray, b: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rotate d by the smallest rotation from a to b: rows, by Rodrigues' formula."""
    axis, c = np.cross(a, b), np.sum(a * b, axis=1)[:, None]
    s = np.linalg.norm(axis, axis=1)[:, None]
    n = axis / np.maximum(s, 1e-300)
    return c * d + s * np.cross(n, d) + (1 - c) * np.sum(n * d, axis=1)[:, None] * n


def elastic(result: Result, row: int, at: int | None = None) -> float:
    """Return the elastic energy (E4), (E5) of a recorded row [J], under the commands of the row `at`."""
    worm, at = result.worm, row if at is None else at
    edges = np.diff(result.joints[row], axis=0)
    length = np.linalg.norm(edges, axis=1)
    t, d = edges / length[:, None], result.directors[row]
    u = np.cross(t, d)
    offset = worm.chamber_offset * result.bend[row]
    chambers = np.column_stack([length - offset, length + offset])
    commanded = worm.l0 * (1.0 - result.contraction[at])
    energy = (worm.k_spring[:, None] * worm.l0 / 4 * (1 - chambers / commanded) ** 2).sum()
    angles = 2 * np.arcsin(chambers / (2 * worm.link_length[:, None]))
    rest = 2 * np.arcsin(worm.l0 / (2 * worm.link_length[:, None]))
    energy += (worm.k_apex[:, None] / 2 * (angles - rest) ** 2).sum()
    c = np.cross(t[:-1], t[1:])
    across, up = (v[:-1] + v[1:] for v in (d, u))
    pitch = np.sum(c * across, axis=1) / np.linalg.norm(across, axis=1) + worm.cross0
    yaw = np.sum(c * up, axis=1) / np.linalg.norm(up, axis=1)
    yaw -= np.sin((result.bend[row][:-1] + result.bend[row][1:]) / 2 + result.hinge[at])
    carried = transported(t[:-1], t[1:], d[:-1])
    turn = np.cross(carried, d[1:])
    twist = np.arctan2(np.sum(turn * t[1:], axis=1), np.sum(carried * d[1:], axis=1))
    stiffness = np.array([worm.k_torsion, worm.k_yaw, worm.k_twist])
    return float(energy + (stiffness / 2 * np.array([pitch, yaw, twist]) ** 2).sum())


def speeds(result: Result, integrator: str) -> np.ndarray:
    """Return the velocities of all mass points at the end by the integrator's difference, shape (M, 3) [m/s]."""
    x = np.concatenate([result.joints, result.apexes.reshape(len(result.time), -1, 3)], axis=1)
    if integrator == "bdf2":
        return (3 * x[-1] - 4 * x[-2] + x[-3]) / (2 * result.dt)
    return (x[-1] - x[-2]) / result.dt


def resting_energy(result: Result, row: int, normal: np.ndarray, stiffness: np.ndarray) -> float:
    """Return k/2 depth^2 of all points that may touch, the joints' faces once each [J]."""
    depth = np.maximum(0.0, -(result.points[row] @ normal))
    return float(stiffness[0]) / 2 * float((depth[:, :7] ** 2).sum() + depth[-1, 7] ** 2)


def anchored_energy(result: Result, friction: Friction, normal: np.ndarray, constants: ContactConstants) -> float:
    """Return N rho(s)^2/(2 rho_b) at the end, s from the anchors in the tangents at the start of the last step [J]."""
    edges = np.diff(result.joints[-2], axis=0)
    along = edges - (edges @ normal)[:, None] * normal
    along /= np.linalg.norm(along, axis=1)[:, None]
    left = np.cross(normal, along)
    away = result.points[-1] - result.anchors[-1]
    s_x, s_l = np.einsum("npk,nk->np", away, along), np.einsum("npk,nk->np", away, left)
    mu_x = np.where(s_x > 0.0, float(friction.forward), float(friction.backward))
    load = np.zeros((result.worm.segments, 8))
    load[:, :6], load[:, 6], load[-1, 7] = result.normal_load[-1], result.joint_load[-1, :-1], result.joint_load[-1, -1]
    rho_squared = (mu_x * s_x) ** 2 + (float(friction.lateral) * s_l) ** 2
    return float((load * rho_squared).sum()) / (2 * constants.yield_gauge)


@pytest.mark.parametrize("contact_stiffness", [None, 400.0])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_stored_energies_are_those_of_the_end_states(integrator: str, contact_stiffness: float | None) -> None:
    """Each change of energy, summed over a run, against its closed form at both ends, computed from places alone."""
    friction = Friction(0.3, 0.6, 0.4, 1.3, contact_stiffness=contact_stiffness)
    result = crawl(CASES["uneven"], integrator=integrator, ground=friction, duration=1.23)
    worm, energy, normal = result.worm, result.energy, SLOPE.axes[2]
    constants = ContactConstants.of(worm, friction, 9.81)
    mass = np.concatenate([worm.joint_mass, worm.apex_mass.ravel()])
    heights = [mass @ np.concatenate([result.joints[k], result.apexes[k].reshape(-1, 3)])[:, 2] for k in (0, -1)]
    rested = [resting_energy(result, k, normal, constants.stiffness) for k in (0, -1)]
    expected = {
        "kinetic": float(mass / 2 @ (speeds(result, integrator) ** 2).sum(axis=1)),
        "potential": 9.81 * (heights[1] - heights[0]),
        "elastic": elastic(result, -1) - elastic(result, 0),
        "penetration": rested[1] - rested[0],
        "anchor": anchored_energy(result, friction, normal, constants),
    }
    for name, change in expected.items():
        assert abs(change) > 1e-9, name
        assert_allclose(getattr(energy, name).sum(), change, rtol=1e-7, atol=1e-14, err_msg=name)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_kinetic_energy_of_a_flight_is_that_of_rotation_and_fall(integrator: str) -> None:
    """At the start m v^2/2 of a rigid body, at the end of the integrator's own velocities."""
    result = crawl(CASES["flight"], integrator=integrator, duration=0.3)
    mass = np.concatenate([result.worm.joint_mass, result.worm.apex_mass.ravel()])
    x = np.concatenate([result.joints[0], result.apexes[0].reshape(-1, 3)])
    v = np.cross(OMEGA, x) + SPEED
    energies = [float(mass / 2 @ (each**2).sum(axis=1)) for each in (v, speeds(result, integrator))]
    assert_allclose(result.energy.kinetic.sum(), energies[1] - energies[0], rtol=1e-10)
    assert energies[0] > 0.01
    drop = result.com[-1, 2] - result.com[0, 2]
    assert_allclose(result.energy.potential.sum(), 0.1 * 9.81 * drop, rtol=1e-11)


def test_work_of_actuators_is_that_of_changing_rest_lengths_and_hinges() -> None:
    """The integral of (dE/dcommand) dcommand over a step lies between its values at the shapes before and after.

    E(shape; commands_{n+1}) - E(shape; commands_n), for the shapes n and n+1; they differ by less and less with dt.
    """
    for dt, spread in ((0.01, 0.3), (0.001, 0.03)):
        result = crawl(CASES["turning"], duration=0.5, dt=dt)
        work, steps = result.energy.work_contract[1:], range(len(result.time) - 1)
        before = np.array([elastic(result, k, at=k + 1) - elastic(result, k) for k in steps])
        after = np.array([elastic(result, k + 1) - elastic(result, k + 1, at=k) for k in steps])
        assert (work >= np.minimum(before, after) - 1e-12).all()
        assert (work <= np.maximum(before, after) + 1e-12).all()
        assert np.abs(before - after).sum() < spread * work.sum()
        assert_allclose(result.energy.work_contract_positive[1:], np.maximum(work, 0.0), rtol=1e-14)


def test_work_of_forces_is_force_times_motion() -> None:
    """Chamber forces contract: -F dl; external forces: F.dx; both at the force of the step's end."""
    still = {"actuation": lambda t: Command(np.zeros((N, 2)), force=forced(t).force)}
    result = crawl(CASES["external forces"] | still, duration=0.5)
    external = [np.sum(pushes(t) * dx) for t, dx in zip(result.time[1:], np.diff(result.joints, axis=0), strict=True)]
    assert_allclose(result.energy.work_external[1:], external, rtol=1e-12, atol=1e-17)
    work = -np.sum(result.force[1:] * np.diff(result.chamber_length, axis=0), axis=(1, 2))
    assert_allclose(result.energy.work_contract[1:], work, rtol=1e-10, atol=1e-16)
    assert result.energy.work_contract.sum() > 1e-3, "they shorten the chambers"


def steady(drag: float, pull: float) -> Callable[[float], np.ndarray]:
    share = np.full(N + 1, 1 / N)
    share[[0, -1]] /= 2
    return lambda t: pull * share[:, None] * [1.0, 0.0, 0.0]


def test_medium_takes_the_power_of_a_steady_pull() -> None:
    """(P8): under a force F shared like the drag the speed tends to F/drag, and the medium loses F^2/drag a second."""
    worm = Worm(drag=2.0, joint_mass_fraction=1.0)
    state = State.straight(worm, position=(0.0, 0.0, 1.0))
    case = {"worm": worm, "world": None, "state": state, "external_force": steady(2.0, 0.1)}
    result = crawl(case, gravity=(0.0, 0.0, 0.0))
    assert_allclose(result.com_velocity[-1], [0.05, 0.0, 0.0], rtol=1e-9, atol=1e-12)
    assert_allclose(result.energy.viscous_loss[-1], 0.1**2 / 2.0 * result.dt, rtol=1e-6)


@pytest.mark.parametrize(("integrator", "order"), [("implicit_euler", 1.0), ("bdf2", 2.0)])
def test_numerical_loss_vanishes_with_the_time_step(integrator: str, order: float) -> None:
    """What the integrator loses in the flight of a bent, released worm falls with its order."""
    worm = Worm(k_torsion=0.3, k_yaw=0.3, k_apex=0.02, kelvin_voigt_time=0.02)
    case = {"worm": worm, "world": None, "state": tumbling(worm).with_changes(bend=0.3), "duration": 0.4}
    losses = [crawl(case, integrator=integrator, dt=dt).energy.numerical_loss.sum() for dt in (5e-4, 2.5e-4, 1.25e-4)]
    assert losses[-1] > 0.0
    assert_allclose(np.log2(np.array(losses[:-1]) / losses[1:]), order, atol=0.15)


@pytest.mark.parametrize("name", ["flat", "dropped", "external forces", "medium", "clamped turning"])
def test_the_work_is_split_into_what_it_went_to(name: str) -> None:
    """Friction, damping, impacts, the integrator and what is gained; the cost of transport is split in proportion."""
    result = crawl(CASES[name])
    figures = result.summary()
    work, *parts = (
        float(figures[f"work_{each}_J"] or 0.0)
        for each in ("contract", "friction", "damping", "impact", "numerical", "gained")
    )
    external = float(figures["work_external_J"] or 0.0)
    assert (external != 0.0) == (name == "external forces")
    assert_allclose(sum(parts), work + external, rtol=1e-9)
    damping = [figures[f"work_damping_{each}_J"] for each in ("material", "medium")]
    assert_allclose(sum(damping), figures["work_damping_J"], rtol=1e-12)  # type: ignore[arg-type]
    assert (damping[1] > 1e-4) == (name == "medium")  # type: ignore[operator]
    costs = [figures[f"cost_of_transport_{each}"] for each in ("friction", "damping", "impact", "numerical", "gained")]
    if figures["cost_of_transport"] is None:
        assert costs == [None] * 5
    else:
        per = result.worm.mass * 9.81 * result.distance
        assert_allclose(costs, np.array(parts) / per, rtol=1e-12)


def test_most_of_the_default_worms_work_is_damped_by_its_material() -> None:
    """97 % of what is not gained, over whole waves."""
    result = crawl(CASES["flat"], duration=6.0)
    uses = result.energy.uses
    assert_allclose(uses["damping"] / (sum(uses.values()) - uses["gained"]), 0.98, atol=0.02)


@pytest.mark.parametrize("world", [None, Plane()], ids=["air", "plane"])
@pytest.mark.parametrize("segments", [*range(1, 13), 17, 20])
def test_the_ledger_is_finite_and_closes_for_every_number_of_segments(segments: int, world: Plane | None) -> None:
    """Kernels run on four or eight lanes at once: lanes without a segment count for nothing."""
    worm = Worm(segments=segments, length=0.2 * segments, mass=0.02 * segments)
    gravity = (0.0, 0.0, 0.0 if world is None else -9.81)
    run = simulate(worm, world, actuation=TravellingWave(amplitude=0.1), duration=0.1, dt=0.005, gravity=gravity)
    terms = np.array([getattr(run.energy, name) for name in (*STORED_ENERGY, *LOST_ENERGY, *SUPPLIED_ENERGY)])
    assert np.isfinite(terms).all()
    assert np.abs(run.energy.residual.sum()) < 1e-10 * max(np.abs(terms).sum(), 1e-6)


@pytest.mark.parametrize("term", [*STORED_ENERGY, *LOST_ENERGY, *SUPPLIED_ENERGY])
def test_a_ledger_with_nan_does_not_balance(term: str) -> None:
    """The error of the balance is NaN then, not 0."""
    rows = np.ones((3, len(TERMS)))
    rows[1, TERMS.index(term)] = np.nan
    assert np.isnan(Energy.of(rows).balance_error)
    assert Energy.of(np.zeros((3, len(TERMS)))).balance_error == 0.0
