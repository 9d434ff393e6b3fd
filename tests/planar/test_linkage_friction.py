"""Friction that sticks: the axial case, onset on slopes, no creep, loads, and the quantile law of crawling."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planar import linkage
from planar.linkage import Friction, Linkage
from planar.linkage.element import friction_gauge
from planar.linkage.ground import Ground
from planar.status import Status

G = 9.80665


def still(segments: int):
    return lambda t: np.zeros(segments)


def axial(force: float, dt: float) -> linkage.Run:
    """Push a stiff, flat worm of 1 m and 1 kg along its axis with a uniform force for 0.25 s."""
    worm = Linkage(segments=6, mass=1.0, half_height=0.005, k_spring=1e6, k_torsion=1e3, k_apex=0.0)
    share = np.zeros((7, 2))
    share[:, 0] = force / 6
    share[[0, -1], 0] /= 2
    return linkage.simulate(
        worm,
        still(6),
        duration=0.25,
        dt=dt,
        gravity=G,
        friction=Friction(0.4, 0.2, static_ratio=2.0),
        external_force=lambda t: share,
    )


def axial_energy(force: float, mu_kinetic: float) -> float:
    """t^2/(2 m) (|F| - mu_k m g)^2 at t = 0.25 s for 1 kg: kinetic energy under a constant net force."""
    return 0.25**2 / 2 * (abs(force) - mu_kinetic * G) ** 2


@pytest.mark.parametrize("dt", [1e-2, 1e-3, pytest.param(1e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("sign", "mu_static"), [(1, 0.8), (-1, 0.4)])
def test_axial_friction_in_both_directions(dt: float, sign: int, mu_static: float) -> None:
    threshold = mu_static * G
    for factor in (1.03, 1.1, 1.5):
        run = axial(sign * factor * threshold, dt)
        energy = 0.5 * (run.com_velocity[-1] ** 2).sum()
        assert_allclose(energy, axial_energy(factor * threshold, mu_static / 2), rtol=1e-3)
        assert np.sign(run.distance) == sign
    run = axial(sign * 0.97 * threshold, dt)
    assert run.slip.max() == 0.0
    assert 0.5 * (run.com_velocity[-1] ** 2).sum() < 1e-6 * axial_energy(1.1 * threshold, mu_static / 2)


@pytest.mark.parametrize("slope", [0.15, -0.025])
def test_standing_on_a_slope_it_does_not_creep(default_worm: Linkage, slope: float) -> None:
    run = linkage.simulate(default_worm, still(6), duration=25.0, slope=slope)
    settled = run.joints[500:]
    assert np.abs(settled - settled[0]).max() < 1e-12
    assert run.slip[500:].max() == 0.0
    assert np.abs(run.joints[500] - run.joints[0]).max() < 1e-4  # the displacement of settling


@pytest.mark.slow
@pytest.mark.parametrize(("uphill", "mu"), [(1, 0.5), (-1, 0.3)])
def test_onset_of_sliding_is_at_the_friction_angle_of_its_direction(
    default_worm: Linkage, uphill: int, mu: float
) -> None:
    """Head uphill it would slide backwards (0.5), head downhill forwards (0.3)."""

    def slides(angle: float, ratio: float) -> bool:
        run = linkage.simulate(
            default_worm, still(6), duration=3.0, slope=uphill * angle, friction=Friction(0.3, 0.5, ratio)
        )
        assert run.status is Status.DONE
        assert run.distance * uphill <= 0.0
        return bool(run.slip[-1].sum() > 1e-6)

    assert not slides(np.arctan(0.995 * mu), 1.0)
    assert slides(np.arctan(1.005 * mu), 1.0)
    # Static above kinetic: a soft worm's contacts yield one after the other, anywhere between the two angles,
    assert not slides(np.arctan(1.0 * mu), 1.2)
    assert slides(np.arctan(1.2 * mu), 1.2)
    # a stiff one's all together, at the static angle.
    default_worm = default_worm.with_changes(k_spring=1e6, k_torsion=1e6)
    assert not slides(np.arctan(1.18 * mu), 1.2)
    assert slides(np.arctan(1.21 * mu), 1.2)


def test_swapped_coefficients_mirror_the_motion(default_worm: Linkage) -> None:
    x = (np.arange(6) + 0.5) / 6

    def gait(t: float) -> np.ndarray:
        return 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2)))

    run = linkage.simulate(default_worm, gait, duration=4.0)
    mirrored = linkage.simulate(default_worm, lambda t: gait(t)[::-1], duration=4.0, friction=Friction(0.20, 0.03))
    joints = mirrored.joints[:, ::-1] * [-1.0, 1.0] + [1.0, 0.0]
    assert_allclose(joints, run.joints, rtol=0, atol=1e-10)
    assert run.distance > 0.1


def test_force_stays_inside_the_friction_cone(default_worm: Linkage) -> None:
    x = (np.arange(6) + 0.5) / 6
    gait = lambda t: 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2)))  # noqa: E731
    run = linkage.simulate(default_worm, gait, duration=4.0, friction=Friction(0.03, 0.20, 1.0))
    slid_forward = slid_back = 0
    for parts in run.steps:
        (part,) = parts
        rho = np.where(part.end.slide > 0.0, 0.03, 0.20) * np.abs(part.end.slide)
        assert (rho <= run.ground.yield_gauge * (1 + 1e-6)).all(), "the anchor's spring stays on the yield surface"
        # The momentum of the whole worm gives the friction force in sum: inside the cone of the loads.
        rise = worm_momentum(run, part.end) - worm_momentum(run, part.start)
        friction, load = rise / part.dt, part.end.load
        assert -0.03 * load.sum() - 1e-9 <= friction <= 0.20 * load.sum() + 1e-9
        touching = load[:, 0] > 0.0
        if (part.slip[touching, 0] > 1e-9).all():
            assert_allclose(friction, -0.03 * load.sum(), atol=1e-9)
            slid_forward += 1
        slid_back += int((part.slip < 0.0).any())
    assert slid_forward > 5
    assert slid_back > 5


def worm_momentum(run: linkage.Run, state) -> float:
    joints = run.worm.joint_mass @ state.joint_velocity[:, 0]
    return float(joints + (run.worm.apex_mass * state.apex_velocity[..., 0]).sum())


def pushed(force, segments: int = 6):
    """Return an external force along x, shared by the joints."""
    share = np.full(segments + 1, 1.0 / segments)
    share[[0, -1]] /= 2

    def external(t: float) -> np.ndarray:
        return np.column_stack([force(t) * share, np.zeros(segments + 1)])

    return external


def stiff(worm: Linkage) -> Linkage:
    return worm.with_changes(k_spring=1e6, k_torsion=1e4, half_height=0.005)


def test_a_contact_that_slid_sticks_again_with_the_static_limit(default_worm: Linkage) -> None:
    """Break loose, stop, and reload between the kinetic and the static limit: it holds."""
    weight, ratio = 0.981, 1.5

    def force(t: float) -> float:
        if t < 0.1:
            return 0.4 * weight  # above 0.2 * 1.5
        return 0.0 if t < 1.0 else 0.25 * weight  # above 0.2, below 0.3

    run = linkage.simulate(
        stiff(default_worm),
        still(6),
        duration=2.0,
        friction=Friction(0.2, 0.2, ratio),
        external_force=pushed(force),
    )
    slipping = run.slip.sum(axis=(1, 2)) > 0.0
    assert slipping[:10].all()
    assert not slipping[90:].any()
    kinetic = linkage.simulate(
        stiff(default_worm), still(6), duration=2.0, friction=Friction(0.2, 0.2, 1.0), external_force=pushed(force)
    )
    assert (kinetic.slip.sum(axis=(1, 2)) > 0.0)[-1], "with static_ratio 1 the same load makes it slide"


def test_without_friction_one_way_the_anchor_follows(default_worm: Linkage) -> None:
    """Pushed forward it slides freely; pushed back, the friction of that direction acts from where it is."""
    run = linkage.simulate(
        default_worm,
        still(6),
        duration=4.0,
        friction=Friction(0.0, 0.2, 1.0),
        external_force=pushed(lambda t: 0.1 if t < 1.0 else -0.1),
    )
    # 1 m/s^2 for a second, -1 m/s^2 for the next; then 0.1 N is less than 0.2 * 0.981 N, so it stays at 1 m.
    assert_allclose(run.distance, 1.0, atol=0.03)
    assert np.ptp(run.com[250:, 0]) < 1e-6


def test_coefficients_may_differ_by_decades(default_worm: Linkage) -> None:
    x = (np.arange(6) + 0.5) / 6
    gait = lambda t: 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2)))  # noqa: E731
    forward = np.full(6, 0.03)
    forward[2] = 1e-6
    for friction in (Friction(1e-5, 0.2), Friction(forward, 0.2)):
        run = linkage.simulate(default_worm, gait, duration=4.0, friction=friction)
        assert run.status is Status.DONE
        assert run.ledger.balance_error < 1e-9


def test_a_worm_facing_the_other_way_makes_the_mirrored_path(default_worm: Linkage) -> None:
    """Directions are those of the body, not of the world: in contact by both laws, and clamped."""
    x = (np.arange(6) + 0.5) / 6
    gait = lambda t: 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2)))  # noqa: E731
    for arguments in ({}, {"friction_law": "threshold"}, {"ground": "clamped"}):
        height = 0.0 if arguments.get("ground") == "clamped" else 0.05
        start = default_worm.rest() + np.array([0.0, height])
        run = linkage.simulate(default_worm, gait, duration=2.0, start=start, **arguments)
        turned = linkage.simulate(default_worm, gait, duration=2.0, start=start * [-1.0, 1.0], **arguments)
        assert_allclose(turned.joints * [-1.0, 1.0], run.joints, rtol=0, atol=1e-10)
        assert_allclose(turned.distance, run.distance, rtol=1e-9)
        assert run.distance > 0.05


def test_loads_balance_the_weight_at_rest(default_worm: Linkage) -> None:
    run = linkage.simulate(default_worm, still(6), duration=0.1)
    assert_allclose(run.normal_load[-1].sum(), 0.981, rtol=1e-9)
    assert_allclose(run.normal_load[-1, :, 1], 0.0)
    assert -run.apexes[-1, ..., 1].min() < 1e-4 * default_worm.l0


def test_without_friction_the_centre_of_mass_stays(default_worm: Linkage) -> None:
    x = (np.arange(6) + 0.5) / 6
    gait = lambda t: 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2)))  # noqa: E731
    run = linkage.simulate(default_worm, gait, duration=10.0, friction=Friction(0.0, 0.0))
    assert np.abs(run.com[:, 0] - run.com[0, 0]).max() < 1e-10


@pytest.mark.slow
def test_dragging_costs_exactly_the_forward_coefficient(default_worm: Linkage) -> None:
    """Loads that add up to the weight, all slipping forward: friction work = mu_f m g d, however they are shared."""
    pull = np.zeros((7, 2))
    pull[-1, 0] = 0.05
    run = linkage.simulate(
        default_worm, still(6), duration=20.0, friction=Friction(0.03, 0.2, 1.0), external_force=lambda t: pull
    )
    late = slice(1000, None)
    distance = run.com[-1, 0] - run.com[1000, 0]
    assert distance > 1.0
    assert run.slip[late, :, 0].min() > 0.0
    assert_allclose(run.ledger.friction_loss[late].sum() / (0.981 * distance), 0.03, rtol=1e-6)


@pytest.mark.parametrize("slope", [0.1, -0.05])
def test_dragging_uphill_costs_the_floor(default_worm: Linkage, slope: float) -> None:
    """Friction and weight together: (mu_f cos + sin) m g d, nothing slipping back."""
    pull = np.zeros((7, 2))
    pull[-1, 0] = 0.2
    run = linkage.simulate(
        default_worm,
        still(6),
        duration=4.0,
        slope=slope,
        friction=Friction(0.03, 0.2, 1.0),
        external_force=lambda t: pull,
    )
    late = slice(300, None)
    distance = run.com[-1, 0] - run.com[300, 0]
    assert (run.slip[late].sum(axis=(1, 2)) > 0.0).all()
    assert np.diff(run.apexes[late, :, 0, 0], axis=0).min() > 0.0, "nothing slips back"
    spent = run.ledger.friction_loss[late].sum() + run.ledger.potential[late].sum()
    assert_allclose(spent / (0.981 * distance), 0.03 * np.cos(slope) + np.sin(slope), rtol=1e-5)


def crawl(mu_forward: float, mu_backward: float, cycles: int, steps: int) -> tuple[np.ndarray, float]:
    """Crawl with N = 7 contacts of equal, constant load whose distances are prescribed.

    Segment lengths 1 + 0.3 sin(2 pi (i/6 - t/T)), T = 30 s. One unknown, the position X of the body, by implicit
    Euler with the friction law of `planar.linkage` and an inertia that is negligible. Returns X of contact 0
    over the steps, and the friction work over mu_forward m g d in the last cycle.
    """
    n, T = 7, 30.0
    dt, mu = T / steps, np.array([mu_forward, mu_backward])
    ground = Ground(0.0, 0.0, np.full(n, mu[0]), np.full(n, mu[1]), mu.min(), 1e-8, 1e-4)
    i = np.arange(6)

    def shape(t: float) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(1 + 0.3 * np.sin(2 * np.pi * (i / 6 - t / T)))])

    def gauge(s: float, s_n: float) -> tuple[float, float, float]:
        return friction_gauge(s, s_n, dt, mu[0], mu[1], ground)

    def force(s: float, s_n: float) -> float:
        y, coefficient, b = gauge(s, s_n)
        return -coefficient * np.sign(y) * min(1.0, abs(y) / b)

    path, work = [0.0], np.zeros(cycles * steps)
    anchor, slide = shape(0.0), np.zeros(n)
    for k in range(1, cycles * steps + 1):
        places = shape(k * dt)
        low, high = path[-1] - 1.0, path[-1] + 1.0
        for _ in range(52):  # the friction falls with X: bisection, to the last bit
            middle = 0.5 * (low + high)
            total = sum(force(middle + p - a, s) for p, a, s in zip(places, anchor, slide, strict=True))
            low, high = (middle, high) if total > 0.0 else (low, middle)
        for j in range(n):
            s = middle + places[j] - anchor[j]
            y, _, b = gauge(s, slide[j])
            excess = max(0.0, 1.0 - b / abs(y)) * y if y != 0.0 else 0.0
            anchor[j] += excess
            slide[j] = s - excess
            work[k - 1] += (mu[0] if excess > 0.0 else mu[1]) * abs(excess)
        path.append(middle)
    distance = path[-1] - path[-1 - steps]
    return np.array(path), work[-steps:].sum() / (n * mu_forward * distance)


@pytest.mark.slow
def test_crawling_with_equal_loads_follows_the_quantile_law() -> None:
    """V = -(load-weighted quantile of the relative velocities at mu_f/(mu_f + mu_b)): 1.8000 a cycle.

    Gidoni, Noselli, DeSimone 2014. With seven equal loads and 0.03/0.20, k = floor(7 * 0.03/0.23) = 0 contacts
    slip back; the work of friction is then mu_f m g d.
    """
    path, cost = crawl(0.03, 0.20, cycles=2, steps=600)
    assert_allclose(path[-1] - path[600], 1.8, rtol=5e-4)
    assert_allclose(cost, 1.0, rtol=0, atol=1e-6)


def quantile(values: np.ndarray, weights: np.ndarray, level: float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, level * total[-1])])


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["retrograde", "direct"])
@pytest.mark.parametrize(("mu_forward", "mu_backward"), [(0.03, 0.20), (0.10, 0.20), (0.20, 0.20)])
def test_quasi_static_crawling_follows_the_quantile_law(mu_forward: float, mu_backward: float, direction: str) -> None:
    """The true, changing loads of a stiff worm in a slow wave, over its second cycle, to 0.5 %."""
    n, T, steps = 7, 30.0, 800
    worm = Linkage(segments=n, mass=0.1, half_height=0.05, k_spring=1e4, k_torsion=10.0, k_apex=0.0)
    x, sign = (np.arange(n) + 0.5) / n, 1.0 if direction == "retrograde" else -1.0

    def gait(t: float) -> np.ndarray:
        return 0.1 * min(1.0, 4 * t / T) * np.sin(2 * np.pi * (x + sign * t / T))

    run = linkage.simulate(worm, gait, duration=2 * T, dt=T / steps, friction=Friction(mu_forward, mu_backward, 1.0))
    feet, loads = run.apexes[:, :, 0, 0], run.normal_load[1:, :, 0]
    relative = np.diff(feet - feet[:, :1], axis=0) / run.dt
    level = mu_forward / (mu_forward + mu_backward)
    law = np.array([-quantile(w, p, level) for w, p in zip(relative, loads, strict=True)])
    predicted, distance = law[steps:].sum() * run.dt, feet[-1, 0] - feet[steps, 0]
    assert_allclose(distance, predicted, rtol=5e-3)
    if mu_forward == mu_backward:  # anchoring by load alone: the two waves drive opposite ways
        assert distance * sign > 0.05
