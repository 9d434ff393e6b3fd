"""Order of the integrator, the ledger, momentum, and the limit of stiff links."""

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planar import linkage
from planar.linkage import Friction, Linkage
from planar.linkage.ledger import Ledger
from planar.linkage.newton import Newton
from planar.linkage.shape import apexes, cross_products, hinge_angles
from planar.published_worm import Net, Parameters
from planar.status import Status


def smooth(segments: int, amplitude: float = 0.15, period: float = 0.4):
    x = (np.arange(segments) + 0.5) / segments

    def gait(t: float) -> np.ndarray:
        return amplitude * np.sin(2 * np.pi * (x - t / period)) * np.sin(np.pi * t / period) ** 2

    return gait


def wave(segments: int, sign: float = 1.0, amplitude: float = 0.2, period: float = 2.0):
    """Return the rectified wave; sign +1 runs head to tail (retrograde)."""
    x = (np.arange(segments) + 0.5) / segments
    return lambda t: amplitude * np.maximum(0.0, np.sin(2 * np.pi * (x + sign * t / period)))


def lifted(worm: Linkage) -> np.ndarray:
    return worm.rest() + np.array([0.0, 1.0])


def in_the_air(worm: Linkage, dt: float, duration: float) -> linkage.Run:
    start = lifted(worm)
    start[:, 1] += 0.02 * np.sin(np.arange(len(start)))
    return linkage.simulate(
        worm, smooth(worm.segments), duration=duration, dt=dt, gravity=0.0, start=start, settle=False
    )


@pytest.fixture(scope="module")
def finer_and_finer(uneven_worm: Linkage) -> list[linkage.Run]:
    return [in_the_air(uneven_worm, dt, 0.4) for dt in (8e-4, 4e-4, 2e-4, 1e-4)]


@pytest.mark.slow
def test_implicit_euler_is_of_first_order(finer_and_finer: list[linkage.Run]) -> None:
    steps = [np.abs(a.joints[-1] - b.joints[-1]).max() for a, b in pairwise(finer_and_finer)]
    orders = np.log2(np.array(steps[:-1]) / steps[1:])
    assert_allclose(orders, 1.0, atol=0.15)
    assert steps[-1] < 2e-4


@pytest.mark.slow
def test_ledger_closes_with_every_term_on_its_own(uneven_worm: Linkage, default_worm: Linkage) -> None:
    runs = [
        linkage.simulate(default_worm, wave(6), duration=4.0),
        linkage.simulate(default_worm, wave(6), duration=4.0, friction=Friction(0.3, 0.5), slope=0.1),
        linkage.simulate(default_worm, wave(6), duration=4.0, ground="clamped"),
        linkage.simulate(uneven_worm, wave(4), duration=4.0, external_force=lambda t: np.full((5, 2), 0.01 * t)),
        in_the_air(uneven_worm, 0.01, 0.4),
    ]
    for run in runs:
        ledger = run.ledger
        assert run.status is Status.DONE
        assert ledger.balance_error < 1e-9
        incoming = np.abs(ledger.work_contract) + np.abs(ledger.numerical_loss) + ledger.viscous_loss
        assert (np.abs(ledger.residual) <= 1e-9 * incoming + 1e-13).all(), "each step closes, not only the sum"
        assert ledger.friction_loss.min() >= -1e-15
        assert ledger.viscous_loss.min() >= -1e-15
    threshold = linkage.simulate(default_worm, wave(6), duration=4.0, friction_law="threshold")
    assert threshold.ledger.balance_error < 1e-9  # its friction may do work on the worm, so it has no sign
    assert runs[0].work_friction > 1e-3
    assert np.abs(runs[1].ledger.potential).sum() > 1e-3


def test_numerical_loss_vanishes_with_the_time_step(finer_and_finer: list[linkage.Run]) -> None:
    losses = [run.ledger.numerical_loss.sum() for run in finer_and_finer[1:]]
    assert_allclose(np.log2(np.array(losses[:-1]) / losses[1:]), 1.0, atol=0.15)


def test_stored_energies_are_those_of_the_end_states(default_worm: Linkage, uneven_worm: Linkage) -> None:
    """Each change of energy, summed over the run, against its closed form at both ends."""
    for worm, arguments in (
        (default_worm, {"friction": Friction(0.3, 0.5)}),
        (uneven_worm, {"external_force": lambda t: np.full((5, 2), 0.02 * t)}),
    ):
        n = worm.segments
        run = linkage.simulate(worm, wave(n), duration=1.23, **arguments)
        ledger, ground, a = run.ledger, run.ground, worm.link_length

        def stored(k: int, worm: Linkage = worm, run: linkage.Run = run, ground=ground, a=a) -> dict[str, float]:
            state = run.first if k == 0 else run.steps[-1][-1].end
            points, length = run.apexes[k], run.length[k]
            angle = hinge_angles(length, a) - hinge_angles(np.full(worm.segments, worm.l0), a)
            elastic = (worm.k_spring * worm.l0 / 2 * (1 - length / state.l_cmd) ** 2).sum()
            elastic += (worm.k_apex * angle**2).sum()
            elastic += (worm.k_torsion / 2 * (cross_products(run.joints[k]) - worm.cross0) ** 2).sum()
            depth = np.maximum(0.0, -points[..., 1])
            forward, backward = ground.mu_forward[:, None], ground.mu_backward[:, None]
            rho = np.where(state.slide > 0.0, forward, -backward) * state.slide
            speed = (worm.joint_mass[:, None] * state.joint_velocity**2).sum()
            speed += (worm.apex_mass[..., None] * state.apex_velocity**2).sum()
            return {
                "elastic": elastic,
                "penetration": 0.5 * ground.stiffness * (depth**2).sum(),
                "anchor": (state.load * rho**2).sum() / (2 * ground.yield_gauge),
                "kinetic": 0.5 * speed,
                "potential": worm.total_mass * 9.81 * run.com[k, 1],
            }

        end, start = stored(-1), stored(0)
        for name in end:
            change = end[name] - start[name]
            assert_allclose(getattr(ledger, name).sum(), change, rtol=1e-7, atol=1e-15, err_msg=name)
            assert change != 0.0, name


@pytest.mark.slow
def test_numerical_loss_in_contact_vanishes_with_the_time_step(default_worm: Linkage) -> None:
    gait = smooth(6, 0.05, 1.0)
    losses = [
        linkage.simulate(default_worm, gait, duration=0.5, dt=dt, friction=Friction(2.0, 2.0)).ledger
        for dt in (4e-4, 2e-4)
    ]
    totals = [np.abs(ledger.numerical_loss.sum()) for ledger in losses]
    assert totals[1] < 0.65 * totals[0]
    assert totals[1] < 0.02 * losses[1].viscous_loss.sum()


def test_loads_that_change_stored_anchor_energy_are_booked(default_worm: Linkage) -> None:
    """A worm held by its anchors on a slope is pressed down: the anchors' energy rises with the load."""
    down = np.zeros((7, 2))
    down[:, 1] = -0.02
    run = linkage.simulate(
        default_worm,
        lambda t: np.zeros(6),
        duration=2.0,
        slope=0.1,
        friction=Friction(2.0, 2.0),
        external_force=lambda t: down * (t > 1.0),
    )
    press = run.ledger.load_change[100]
    assert press > 0.0
    assert run.slip.max() == 0.0
    assert run.ledger.balance_error < 1e-9


def test_threshold_law_without_slip_has_no_anchors(default_worm: Linkage) -> None:
    run = linkage.simulate(default_worm, wave(6), duration=1.0, friction_law="threshold", velocity_threshold=10.0)
    assert run.ledger.balance_error < 1e-9
    np.testing.assert_array_equal(run.ledger.friction_loss, 0.0)
    assert run.ledger.viscous_loss.min() >= 0.0


def test_p11_is_the_contraction_force_times_the_motion() -> None:
    """One free segment that contracts: the force -(dE/dl at the command - dE/dl at rest) along it, times dl."""
    worm = Linkage(segments=1, mass=0.1, k_apex=0.0)
    run = linkage.simulate(
        worm, lambda t: np.array([min(0.2, t)]), duration=0.5, gravity=0.0, start=lifted(worm), settle=False
    )
    cmd, length = worm.l0 * (1.0 - run.contraction[1:, 0]), run.length[:, 0]

    def slope(l0: float, command: np.ndarray | float) -> np.ndarray:
        return -13.0 * l0 / command * (1.0 - length[1:] / command)

    expected = -(slope(worm.l0, cmd) - slope(worm.l0, worm.l0)) * np.diff(length)
    assert_allclose(run.ledger.work_contract_p11, expected, rtol=1e-10, atol=1e-15)
    assert run.ledger.work_contract_p11.sum() > 0.0


def test_a_step_that_does_not_converge_is_taken_in_halves(
    default_worm: Linkage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refusing every full step gives the run at half the step, with forces, slip and ledger of all parts."""
    arguments = {
        "duration": 1.0,
        "external_force": lambda t: np.full((7, 2), 0.004 * t) * [1.0, 0.0],
    }
    solve = Newton.solve

    def refuse_full_steps(self: Newton, q: np.ndarray, now) -> object:
        solution = solve(self, q, now)
        return replace(solution, converged=solution.converged and now.dt != 0.01)

    halves = linkage.simulate(default_worm, wave(6), dt=0.005, **arguments)
    monkeypatch.setattr(Newton, "solve", refuse_full_steps)
    run = linkage.simulate(default_worm, wave(6), dt=0.01, **arguments)
    assert run.status is Status.DONE
    assert run.halved_steps == 100
    assert_allclose(run.joints, halves.joints[::2], rtol=0, atol=1e-12)
    assert_allclose(run.slip, halves.slip[::2] + halves.slip[1::2], rtol=0, atol=1e-12)
    assert_allclose(run.ledger.work_external.sum(), halves.ledger.work_external.sum(), rtol=1e-9)
    assert run.ledger.balance_error < 1e-9


def test_never_converging_ends_with_its_name(default_worm: Linkage, monkeypatch: pytest.MonkeyPatch) -> None:
    solve = Newton.solve

    def never_late(self: Newton, q: np.ndarray, now) -> object:
        solution = solve(self, q, now)
        return replace(solution, converged=solution.converged and not 0.0 < now.l_cmd[0] < 0.15)

    monkeypatch.setattr(Newton, "solve", never_late)
    run = linkage.simulate(default_worm, lambda t: np.full(6, 0.0 if t < 0.045 else 0.2), duration=1.0)
    assert run.status is Status.NO_CONVERGENCE
    assert run.joints.shape == (5, 7, 2)


def test_settling_keeps_the_loads_and_the_place(default_worm: Linkage) -> None:
    run = linkage.simulate(default_worm, lambda t: np.zeros(6), duration=0.1, slope=0.1)
    assert_allclose(run.normal_load[0].sum(), 0.981 * np.cos(0.1), rtol=1e-9)
    assert_allclose(run.joints[0, :, 0].mean(), default_worm.rest()[:, 0].mean(), atol=1e-9)


def test_internal_forces_keep_momentum(uneven_worm: Linkage) -> None:
    run = in_the_air(uneven_worm.with_changes(drag=0.0), 0.01, 1.0)
    assert np.abs(run.com - run.com[0]).max() < 1e-12
    assert np.ptp(run.length) > 0.01, "it did move"


def test_falls_along_the_discrete_parabola(uneven_worm: Linkage) -> None:
    """Implicit Euler: z_k = -g dt^2 k (k + 1)/2, whatever the worm does inside."""
    worm = uneven_worm.with_changes(drag=0.0)
    run = linkage.simulate(worm, smooth(4), duration=0.2, dt=0.01, start=lifted(worm), settle=False)
    k = np.arange(21)
    assert_allclose(run.com[:, 1] - run.com[0, 1], -9.81e-4 * k * (k + 1) / 2, rtol=0, atol=1e-12)


def spring_net(worm: Linkage, joints: np.ndarray, k_link: float, dt: float, steps: int, dense) -> np.ndarray:
    """Integrate the worm as nodes and springs (3N+1 of them), by implicit Euler; return its joints at the end."""
    net = Net(worm.segments, Parameters(length=worm.length, k_link=k_link, mass=1.0, connector_mass=0.5))
    points = apexes(joints, worm.link_length)
    x = net.rest.copy()
    x[net.main], x[net.bottom], x[net.top] = joints, points[:, 0], points[:, 1]
    mass = np.empty(len(x))
    mass[net.main], mass[net.bottom], mass[net.top] = worm.joint_mass, worm.apex_mass[:, 0], worm.apex_mass[:, 1]
    M, q, v = np.repeat(mass, 2), x.ravel(), np.zeros(x.size)
    for _ in range(steps):
        start, guess = q, q + dt * v
        for _ in range(60):
            gradient, hessian = net.p7_gradient_and_band(guess)[0], dense(net, guess)
            step = np.linalg.solve(np.diag(M) / dt**2 + hessian, M * (guess - start - dt * v) / dt**2 + gradient)
            guess = guess - step
            if np.abs(step).max() < 1e-14:
                break
        q, v = guess, (guess - start) / dt
    return q.reshape(-1, 2)[net.main]


def test_stiff_links_converge_to_the_linkage_at_first_order(dense_hessian) -> None:
    """A released, stretched and bent chain of springs: the error falls as 1/k_link."""
    worm = Linkage(segments=3, mass=0.1, k_torsion=0.0, k_apex=0.0, kelvin_voigt_time=0.0)
    start = lifted(worm) * [0.9, 1.0]
    start[1, 1] += 0.03
    run = linkage.simulate(worm, lambda t: np.zeros(3), duration=0.1, dt=0.005, gravity=0.0, start=start, settle=False)
    moved = np.abs(run.joints[-1] - start).max()
    errors = [
        np.abs(spring_net(worm, start, k_link, 0.005, 20, dense_hessian) - run.joints[-1]).max()
        for k_link in (1e4, 1e5, 1e6, 1e7)
    ]
    assert moved > 0.01
    assert_allclose(np.log10(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.05)
    assert errors[-1] < 1e-6 * moved * 10


def test_viscous_medium_slows_a_pushed_worm(default_worm: Linkage) -> None:
    """(P8): under a force F on frictionless ground the speed tends to F/drag."""
    worm = default_worm.with_changes(drag=0.5)
    share = np.full((7, 1), 1 / 6) * [1.0, 0.0]
    share[[0, -1]] /= 2
    run = linkage.simulate(
        worm, lambda t: np.zeros(6), duration=3.0, friction=Friction(0.0, 0.0), external_force=lambda t: 0.1 * share
    )
    assert_allclose(run.com_velocity[-1, 0], 0.1 / 0.5, rtol=1e-3)
    assert_allclose(run.ledger.work_external.sum(), 0.1 * run.distance, rtol=1e-3)


def test_paper_and_ledger_agree_on_friction(default_worm: Linkage) -> None:
    """(P13) is minus the loss, up to what the anchors store and damp."""
    run = linkage.simulate(default_worm, wave(6), duration=4.0)
    assert_allclose(-run.ledger.work_friction_p13.sum(), run.work_friction, rtol=0.02)


def test_observer_and_bad_commands_keep_what_was_computed(default_worm: Linkage) -> None:
    run = linkage.simulate(default_worm, wave(6), duration=1.0, observer=lambda k: k < 10)
    assert run.status is Status.INTERRUPTED
    assert run.joints.shape == (11, 7, 2)

    def broken(t: float) -> np.ndarray:
        return np.full(6, np.nan if t > 0.055 else 0.1)

    run = linkage.simulate(default_worm, broken, duration=1.0)
    assert run.status is Status.BAD_COMMAND
    assert run.joints.shape == (6, 7, 2)
    assert np.isfinite(run.joints).all()
    assert "step 6, t = 0.06 s" in run.stop.sentence

    run = linkage.simulate(
        default_worm, wave(6), duration=1.0, external_force=lambda t: np.zeros((7 if t < 0.025 else 6, 2))
    )
    assert run.status is Status.BAD_COMMAND
    assert run.joints.shape == (3, 7, 2)

    run = linkage.simulate(default_worm, lambda t: np.full(6, np.nan), duration=1.0)
    assert run.joints.shape == (1, 7, 2)
    assert run.ledger.balance_error == 0.0
    assert run.work_contract == 0.0


def test_two_runs_are_equal_to_the_bit(default_worm: Linkage) -> None:
    first, second = (linkage.simulate(default_worm, wave(6), duration=1.0) for _ in range(2))
    np.testing.assert_array_equal(first.joints, second.joints)


@pytest.mark.parametrize("contraction", [-0.6, 0.97])
def test_impossible_commands_end_with_a_reason(default_worm: Linkage, contraction: float) -> None:
    run = linkage.simulate(default_worm, lambda t: np.full(6, contraction), duration=1.0)
    assert np.isfinite(run.joints).all()
    if contraction < 0.0:
        assert run.status is Status.FLATTENED


def test_what_a_landing_takes_is_no_numerical_loss(default_worm: Linkage) -> None:
    """A fall from 0.3 m: impact is what is lost, nothing in flight, and below 5 % is the integrator's at 10 ms."""
    x = default_worm.l0 * np.arange(default_worm.segments + 1.0)
    start = np.column_stack([x, np.full_like(x, 0.3 + float(np.max(default_worm.half_height)))])
    losses = []
    for dt in (0.01, 2e-3, 5e-4):
        run = linkage.simulate(default_worm, lambda t: np.zeros(6), duration=0.4, dt=dt, start=start)
        ledger, aloft = run.ledger, run.apexes[1:, ..., 1].min(axis=(1, 2)) > 0.0
        lost = -float(ledger.kinetic.sum() + ledger.potential.sum())
        assert run.status is Status.DONE
        assert ledger.balance_error < (1e-12 if dt == 0.01 else 1e-10)
        assert abs(ledger.numerical_loss.sum()) < 0.05 * lost
        assert aloft.sum() > 20
        assert not ledger.impact[aloft].any()
        losses.append(float(ledger.impact.sum()))
    assert_allclose(losses, losses[-1], rtol=0.1)
    assert losses[-1] > 0.8 * lost


@pytest.mark.parametrize(("gap", "settled"), [(0.0, True), (1e-9, True), (1e-4, False)])
def test_what_touches_the_ground_is_settled_and_what_does_not_falls(
    default_worm: Linkage, gap: float, settled: bool
) -> None:
    x = default_worm.l0 * np.arange(7.0)
    start = np.column_stack([x, np.full(7, 0.05 + gap)])
    run = linkage.simulate(default_worm, lambda t: np.zeros(6), duration=0.01, start=start)
    assert bool(run.first.load.sum() > 0.1) is settled
    assert bool(np.abs(run.joints[0] - start).max() == 0.0) is not settled


def test_a_ledger_with_nan_does_not_balance() -> None:
    """The error of the balance is NaN then, not 0."""
    terms = {each.name: np.ones(3) for each in fields(Ledger)}
    assert np.isnan(Ledger(**terms | {"numerical_loss": np.array([0.0, np.nan, 0.0])}).balance_error)
    assert Ledger.empty().balance_error == 0.0
