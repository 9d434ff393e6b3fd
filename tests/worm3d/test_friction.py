"""Friction that sticks, in 3D: the axial case, onset on slopes, no creep, loads, the set of forces, patches."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Patch, Plane, State, Status, Worm
from worm3d.physics.friction import ContactConstants

G = 9.81
BOTH = pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])

STIFF: dict[str, Any] = {
    "half_height": 0.005,
    "k_spring": 1e6,
    "k_torsion": 1e3,
    "k_yaw": 1e3,
    "k_twist": 1e3,
}
"""A bar: flat, so that forces along it hardly tilt it."""


def share(segments: int) -> np.ndarray:
    """Return weights of the joints that make a uniform load, shape (N+1, 1)."""
    weights = np.full((segments + 1, 1), 1.0 / segments)
    weights[[0, -1]] /= 2
    return weights


def uniform(worm: Worm, force: np.ndarray):
    """Return a constant external force shared uniformly."""
    forces = share(worm.segments) * force
    return lambda t: forces


def loads(result: worm3d.Result) -> np.ndarray:
    """Return the sum of all normal loads, shape (T,) [N]."""
    return result.normal_load.sum(axis=(1, 2)) + result.joint_load.sum(axis=1)


def all_slip(result: worm3d.Result) -> np.ndarray:
    """Return the slip of all contacts together, shape (T,) [m]."""
    return result.slip.sum(axis=(1, 2)) + result.joint_slip.sum(axis=1)


def axial(
    force: float, dt: float, integrator: str, slope: float = 0.0, heading: float = 0.0
) -> tuple[worm3d.Result, float]:
    """Push a stiff, flat worm of 1 m and 1 kg along its axis for 0.25 s; return the run and its kinetic energy."""
    worm, plane = Worm(mass=1.0, **STIFF), Plane(slope, heading)
    along = np.diff(State.straight(worm, plane).joints[[0, -1]], axis=0)[0]
    along /= np.linalg.norm(along)
    result = worm3d.simulate(
        worm,
        plane,
        Friction(0.4, 0.2, 0.3, static_ratio=2.0),
        duration=0.25,
        dt=dt,
        integrator=integrator,
        gravity=(0.0, 0.0, -9.80665),
        external_force=uniform(worm, force * along),
    )
    assert result.status is Status.DONE
    moved = result.com[-1] - result.com[0]
    assert np.linalg.norm(moved - (moved @ along) * along) < 1e-3 * abs(moved @ along) + 1e-5, "along the axis only"
    return result, 0.5 * float(result.momentum[-1] @ result.momentum[-1])


@BOTH
@pytest.mark.parametrize("dt", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(("sign", "mu_static"), [(1, 0.8), (-1, 0.4)], ids=["forward", "backward"])
def test_axial_friction(integrator: str, dt: float, sign: int, mu_static: float) -> None:
    """Above the threshold the energy is t^2/(2 m) (|F| - mu_k m g)^2, a constant net force; below nothing slips.

    PyElastica's friction case: mu_static 0.8 forward, 0.4 backward, mu_kinetic half of it.
    """
    weight = 9.80665

    def energy(factor: float) -> float:
        return 0.25**2 / 2 * (factor * mu_static * weight - mu_static / 2 * weight) ** 2

    for factor in (1.03, 1.1, 1.5) if dt > 1e-4 else (1.1,):
        result, kinetic = axial(sign * factor * mu_static * weight, dt, integrator)
        assert_allclose(kinetic, energy(factor), rtol=1e-3)
        assert np.sign(result.distance) == sign
    result, kinetic = axial(sign * 0.97 * mu_static * weight, dt, integrator)
    assert_array_equal(all_slip(result), 0.0)
    assert kinetic < 1e-6 * energy(1.1)


@BOTH
@pytest.mark.parametrize(("sign", "mu_static"), [(1, 0.8), (-1, 0.4)], ids=["forward", "backward"])
def test_axial_friction_on_a_tilted_plane(integrator: str, sign: int, mu_static: float) -> None:
    """The load is m g cos(slope), and the weight along the worm, m g sin(slope), helps or hinders the force.

    The worm lies along the steepest ascent, so that the force acts uphill for +1.
    """
    slope, weight = 0.2, 9.80665
    normal, downhill = weight * np.cos(slope), weight * np.sin(slope)
    threshold = mu_static * normal + sign * downhill
    _, kinetic = axial(sign * 1.1 * threshold, 1e-3, integrator, slope)
    net = 1.1 * threshold - sign * downhill - mu_static / 2 * normal
    assert_allclose(kinetic, 0.25**2 / 2 * net**2, rtol=1e-3)
    result, _ = axial(sign * 0.97 * threshold, 1e-3, integrator, slope)
    assert_array_equal(all_slip(result), 0.0)


def onset_slope(heading: float, mu_x: float, mu_l: float) -> float:
    """Return the slope on which a worm along x breaks loose: (t_x/mu_x)^2 + (t_l/mu_l)^2 = N^2, by bisection [rad]."""
    low, high = 0.0, 1.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        plane = Plane(middle, heading)
        normal, down = plane.axes[2], np.array([0.0, 0.0, -1.0])
        joints, left = plane.placed(np.array([0.0, 1.0]), 0.0, np.zeros(2), 0.0)
        holds = np.hypot(down @ (joints[1] - joints[0]) / mu_x, down @ left / mu_l) < -down @ normal
        low, high = (middle, high) if holds else (low, middle)
    return middle


DIRECTIONS = {
    "slides backward": (0.0, 0.5, 0.4),
    "slides forward": (np.pi, 0.3, 0.4),
    "slides to the right": (np.pi / 2, 0.5, 0.4),
    "slides to the left": (-np.pi / 2, 0.5, 0.4),
    "slides back and to the right": (np.deg2rad(37.0), 0.5, 0.4),
    "slides forward and to the left": (np.deg2rad(180.0 + 37.0), 0.3, 0.4),
}
"""Azimuth of the steepest ascent, the coefficient along the worm that counts, the lateral one."""


def slides(worm: Worm, slope: float, heading: float, ratio: float, integrator: str = "bdf2") -> bool:
    """Put a worm on a slope for 3 s; return whether it slips at the end."""
    plane = Plane(slope, heading)
    result = worm3d.simulate(
        worm, plane, Friction(0.3, 0.5, 0.4, static_ratio=ratio), duration=3.0, integrator=integrator
    )
    assert result.status is Status.DONE
    uphill = (result.com[-1] - result.com[0]) @ plane.axes[0]
    assert uphill <= 0.0
    return bool(all_slip(result)[-1] > 1e-6)


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_onset_of_sliding_is_at_the_friction_angle_of_its_direction(integrator: str, direction: str) -> None:
    """atan(mu) of the direction in which the weight pulls, to 0.5 %; oblique, the ellipse of the gauge.

    Sideways the default worm is a soft beam on end faces that carry more than their share: it sags by centimetres
    before it comes to rest. Without end faces, and stiff with them, it breaks loose as a whole.
    """
    heading, mu_x, mu_l = DIRECTIONS[direction]
    onset = onset_slope(heading, mu_x, mu_l)
    if "and" not in direction:
        assert_allclose(np.tan(onset), mu_l if "to the" in direction else mu_x, rtol=1e-12)
    mu = np.tan(onset)
    for worm in (Worm(end_faces=False), Worm(**STIFF)) if "to the" in direction else (Worm(), Worm(**STIFF)):
        assert not slides(worm, np.arctan(0.995 * mu), heading, 1.0, integrator)
        assert slides(worm, np.arctan(1.005 * mu), heading, 1.0, integrator)


@pytest.mark.parametrize("direction", ["slides backward", "slides forward", "slides to the left"])
def test_onset_with_static_above_kinetic(direction: str) -> None:
    """A soft worm yields between the kinetic and the static angle, a stiff one at the latter: all contacts together.

    Sideways even the stiff one is softer than its contacts, so that those with more than their share yield first.
    """
    heading, mu_x, mu_l = DIRECTIONS[direction]
    sideways = "to the" in direction
    mu = mu_l if sideways else mu_x
    soft = Worm(end_faces=not sideways)
    assert not slides(soft, np.arctan(0.98 * mu), heading, 1.2)
    assert slides(soft, np.arctan(1.2 * 1.002 * mu), heading, 1.2)
    stiff = Worm(**STIFF, end_faces=not sideways)
    assert not slides(stiff, np.arctan((1.15 if sideways else 1.195) * mu), heading, 1.2)
    assert slides(stiff, np.arctan(1.205 * mu), heading, 1.2)


CREEP = {
    "uphill": (0.15, 0.0, 6, 0.01, 1),
    "downhill": (0.025, np.pi, 6, 0.01, 1),
    "sideways": (0.15, np.pi / 2, 6, 0.01, 1),
    "oblique": (0.15, np.deg2rad(37.0), 6, 0.01, 1),
    "20 segments": (0.15, np.deg2rad(37.0), 20, 0.01, 5),
    "1 ms": (0.15, np.deg2rad(37.0), 6, 0.001, 50),
    "50 ms": (0.15, 0.0, 6, 0.05, 1),
    "50 ms oblique": (0.15, np.deg2rad(37.0), 6, 0.05, 1),
}
"""Slope, azimuth of the ascent, segments, dt [s], record_every."""


@pytest.mark.parametrize("name", CREEP)
def test_standing_on_a_slope_it_does_not_creep(name: str) -> None:
    """After 5 s of settling no joint moves by 1e-12 m in 60 s, and no anchor slips; Coulomb's law says zero."""
    slope, heading, segments, dt, every = CREEP[name]
    result = worm3d.simulate(Worm(segments=segments), Plane(slope, heading), duration=65.0, dt=dt, record_every=every)
    assert result.status is Status.DONE
    settled = round(5.0 / (dt * every))
    assert np.abs(result.joints[settled:] - result.joints[settled]).max() < 1e-12
    assert_array_equal(all_slip(result)[settled + 1 :], 0.0)
    assert np.abs(result.joints[settled] - result.joints[0]).max() < 0.01, "the displacement of settling"


@BOTH
@pytest.mark.parametrize(("slope", "heading"), [(0.0, 0.0), (0.15, 0.0), (0.15, np.deg2rad(37.0)), (0.15, -np.pi / 2)])
def test_loads_balance_the_weight_at_rest(integrator: str, slope: float, heading: float) -> None:
    """All contacts together carry m g cos(slope), however they share it."""
    for segments in (1, 6, 20):
        worm = Worm(segments=segments, length=min(1.0, segments / 6), mass=0.1 * min(1.0, segments / 6))
        result = worm3d.simulate(worm, Plane(slope, heading), duration=5.0, integrator=integrator, record_every=50)
        assert_allclose(loads(result)[-1], worm.mass * G * np.cos(slope), rtol=1e-8)
        assert_array_equal(result.normal_load[-1, :, [1, 4]], 0.0)
        assert result.normal_load.min() >= 0.0
        depth = -result.world.distance(result.points).min()
        assert 0.0 < depth < 1e-4 * worm.l0, "resting penetration"


def test_level_worm_shares_its_load_evenly_between_left_and_right() -> None:
    result = worm3d.simulate(Worm(), Plane(), duration=0.5)
    assert_allclose(result.normal_load[-1, :, 0], result.normal_load[-1, :, 3], rtol=1e-9)
    tilted = worm3d.simulate(Worm(), Plane(0.1, np.pi / 2), Friction(lateral=0.5), duration=5.0)
    left, right = tilted.normal_load[-1, :, 0].sum(), tilted.normal_load[-1, :, 3].sum()
    assert right > 1.1 * left, "left is uphill: the lower side carries more"


TURNING = TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5)


def friction_force(result: worm3d.Result) -> np.ndarray:
    """Return the sum of all friction forces in each step of implicit Euler, shape (S, 3) [N].

    The momentum of an implicit Euler step: (P_{n+1} - P_n)/dt = m g + normal loads + friction.
    """
    normal = result.world.axes[2]
    weight = result.worm.mass * result.gravity
    total = np.diff(result.momentum, axis=0) / result.dt - weight
    return total - (total @ normal)[:, None] * normal


def reach(result: worm3d.Result, ground: Friction, direction: np.ndarray) -> np.ndarray:
    """Return the support function of the set of friction forces, shape (S,) [N]: the most along a direction.

    Per contact and unit load it is sqrt((mu_x u_x)^2 + (mu_l u_l)^2), with u in the axes of the segment at the start
    of the step; a force towards the head opposes motion towards the tail: mu_x is mu_backward for u_x > 0.
    """
    normal = result.world.axes[2]
    edges = np.diff(result.joints[:-1], axis=1)
    along = edges - (edges @ normal)[..., None] * normal
    along /= np.linalg.norm(along, axis=2)[..., None]
    u_x, u_l = along @ direction, np.cross(normal, along) @ direction
    most = np.hypot(np.where(u_x > 0.0, ground.backward, ground.forward) * u_x, ground.lateral * u_l)
    of_segments = result.normal_load[1:].sum(axis=2) + result.joint_load[1:, :-1]
    return (of_segments * most).sum(axis=1) + result.joint_load[1:, -1] * most[:, -1]


@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_friction_stays_inside_its_set_and_reaches_its_border(slope: float) -> None:
    """The momentum of the whole worm gives the force; the anchors' springs stay on the yield surface."""
    ground, worm = Friction(0.03, 0.20, 0.15, static_ratio=1.0), Worm()
    result = worm3d.simulate(
        worm, Plane(slope, 0.6), ground, actuation=TURNING, duration=6.0, integrator="implicit_euler"
    )
    assert result.status is Status.DONE
    force, closest = friction_force(result), np.inf
    for angle in np.arange(16) * np.pi / 8:
        direction = np.cos(angle) * result.world.axes[0] + np.sin(angle) * result.world.axes[1]
        gap = reach(result, ground, direction) - force @ direction
        assert gap.min() > -1e-9
        closest = min(closest, gap.min())
    assert closest < 1e-2 * worm.mass * G, "some step is near the border"
    assert result.slip.min() >= 0.0
    assert result.joint_slip.min() >= 0.0
    assert result.energy.friction_loss.min() >= 0.0
    assert result.energy.friction_loss.sum() > 1e-3
    # Beyond the surface it may only be turned by the segment's axes; the return never lets it grow there.
    gauge, (before, after) = ContactConstants.of(worm, ground, G).yield_gauge, anchored_gauge(result, ground)
    assert (after <= np.maximum(gauge, before) * (1 + 1e-6)).all()
    assert 0.9 * gauge < after.max() < 2.0 * gauge, "the dampers carry the rest of the limit until they relax"


def anchored_gauge(result: worm3d.Result, ground: Friction) -> tuple[np.ndarray, np.ndarray]:
    """Return rho of the displacement of each apex from its anchor before and after each step, (S, N, 6) twice [m].

    Both in the axes of the segment at the start of the step; 0 where nothing touches after it.
    """
    normal = result.world.axes[2]
    edges = np.diff(result.joints[:-1], axis=1)
    along = edges - (edges @ normal)[..., None] * normal
    along /= np.linalg.norm(along, axis=2)[..., None]
    off = result.apexes - result.anchors[:, :, :6]

    def rho(s: np.ndarray) -> np.ndarray:
        s_x = np.einsum("tnad,tnd->tna", s, along)
        s_l = np.einsum("tnad,tnd->tna", s, np.cross(normal, along))
        gauge = np.hypot(np.where(s_x > 0.0, ground.forward, ground.backward) * s_x, ground.lateral * s_l)
        return np.where(result.normal_load[1:] > 0.0, gauge, 0.0)

    return rho(off[:-1]), rho(off[1:])


@BOTH
@pytest.mark.parametrize(
    ("azimuth", "mu"), [(0.0, 0.03), (np.pi, 0.20), (np.pi / 2, 0.12), (-np.pi / 2, 0.12)], ids="fblr"
)
def test_dragging_costs_exactly_the_coefficient_of_its_direction(integrator: str, azimuth: float, mu: float) -> None:
    """Everything slips one way: friction's loss is mu m g d, and momentum grows by F - mu m g, whoever carries what."""
    worm = Worm(**STIFF)
    direction, pull = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), 0.3
    result = worm3d.simulate(
        worm,
        Plane(),
        Friction(0.03, 0.20, 0.12, static_ratio=1.0),
        duration=1.0,
        integrator=integrator,
        external_force=uniform(worm, pull * direction),
    )
    late = slice(30, None)
    way = (result.com[-1] - result.com[29]) @ direction
    assert way > 0.2
    assert_allclose(result.energy.friction_loss[late].sum() / (worm.mass * G * way), mu, rtol=2e-4)
    assert_allclose(result.momentum[-1] @ direction, pull - mu * worm.mass * G, rtol=1e-3)
    oblique = result.com[-1] - result.com[0]
    assert np.linalg.norm(oblique - (oblique @ direction) * direction) < 1e-3 * way


def test_sliding_obliquely_follows_the_associated_flow() -> None:
    """Friction opposes oblique motion by -N grad rho: (mu_x^2 v_x, mu_l^2 v_l)/rho(v), not along the velocity.

    A worm at velocity (1, 1) m/s; over a first short while its momentum changes by that force.
    """
    worm, mu_f, mu_l = Worm(**STIFF), 0.1, 0.4
    standing = worm3d.simulate(worm, Plane(), duration=0.01).state
    start = standing.with_changes(joint_velocity=np.tile([1.0, 1.0, 0.0], (7, 1)), time=0.0)
    result = worm3d.simulate(
        worm, Plane(), Friction(mu_f, 0.8, mu_l, static_ratio=1.0), duration=0.05, dt=1e-3, state=start
    )
    change = (result.momentum[40] - result.momentum[10]) / 0.03
    v = result.com_velocity[25]
    rho = np.hypot(mu_f * v[0], mu_l * v[1])
    law = -worm.mass * G * np.array([mu_f**2 * v[0], mu_l**2 * v[1]]) / rho
    assert_allclose(change[:2], law, rtol=1e-2)


def test_coefficients_of_each_segment_act_on_that_segment() -> None:
    """Dragged forward, the worm feels sum mu_i N_i: with friction on one segment only, that segment's load alone."""
    worm = Worm(**STIFF)
    for segment in (0, 2, 5):
        for name, sign in (("forward", 1.0), ("backward", -1.0)):
            mu = np.zeros(6)
            mu[segment] = 0.8
            ground = Friction(**({"forward": 0.0, "backward": 0.0, "lateral": 0.3, "static_ratio": 1.0} | {name: mu}))
            result = worm3d.simulate(
                worm,
                Plane(),
                ground,
                duration=0.2,
                integrator="implicit_euler",
                external_force=uniform(worm, np.array([sign * 0.5, 0.0, 0.0])),
            )
            carried = result.normal_load[-1, segment].sum() + result.joint_load[-1, segment]
            if segment == 5:
                carried += result.joint_load[-1, 6]
            felt = 0.5 - sign * (result.momentum[-1, 0] - result.momentum[-2, 0]) / result.dt
            assert 0.05 < carried / (worm.mass * G) < 0.5
            assert_allclose(felt, 0.8 * carried, rtol=1e-6)


def stopping_distance(plane: Plane, ground: Friction) -> float:
    """Return how far a stiff worm slides from 0.5 m/s along its axis [m]."""
    worm = Worm(**STIFF)
    start = worm3d.simulate(worm, plane, ground, duration=0.01).state
    start = start.with_changes(joint_velocity=np.tile([0.5, 0.0, 0.0], (7, 1)), time=0.0)
    result = worm3d.simulate(worm, plane, ground, duration=4.0, dt=2e-3, state=start, record_every=20)
    assert np.linalg.norm(result.com_velocity[-1]) < 1e-4
    return result.distance


def test_a_slippery_patch_counts_where_it_lies() -> None:
    """Stopping distance v^2/(2 mu grip g): on a patch, beside it, and where two overlap the last one."""
    ground = Friction(0.2, 0.9, 0.9, static_ratio=1.0)
    free = 0.5**2 / (2 * 0.2 * G)
    everywhere, nowhere = Patch(0.25), Patch(0.25, along=(5.0, 6.0))
    beside = Patch(0.25, across=(0.5, 2.0))
    assert_allclose(stopping_distance(Plane(), ground), free, rtol=0.01)
    assert_allclose(stopping_distance(Plane(patches=(everywhere,)), ground), 4.0 * free, rtol=0.01)
    assert_allclose(stopping_distance(Plane(patches=(nowhere, beside)), ground), free, rtol=0.01)
    assert_allclose(stopping_distance(Plane(patches=(everywhere, Patch(0.5))), ground), 2.0 * free, rtol=0.01)


def test_patches_lie_along_the_steepest_ascent_and_to_its_left() -> None:
    """On a slope that holds only where it is not slippery the worm slides where the patch is, in the plane's axes."""
    heading, ground = np.deg2rad(37.0), Friction(0.3, 0.3, 0.3, static_ratio=1.0)
    at = np.array([1.0, 2.0])
    level = Plane(0.2, heading)
    middle = State.straight(Worm(), level, position=at).joints.mean(axis=0)
    along, across = middle @ level.axes[0], middle @ level.axes[1]
    for patch, expected in (
        (Patch(0.1, along=(along - 1, along + 1)), True),
        (Patch(0.1, across=(across - 1, across + 1)), True),
        (Patch(0.1, along=(-along - 1, -along + 1)), False),
        (Patch(0.1, across=(-across - 1, -across + 1)), False),
        (Patch(0.1, along=(across - 1, across + 1), across=(along - 1, along + 1)), False),
    ):
        plane = Plane(0.2, heading, patches=(patch,))
        worm = Worm(end_faces=False)
        result = worm3d.simulate(worm, plane, ground, duration=1.0, state=State.straight(worm, plane, at))
        assert (all_slip(result)[-1] > 1e-6) == expected, patch


def test_half_a_body_on_a_slippery_patch() -> None:
    """Three of six segments grip: the worm stands on a slope of atan(0.45 mu), and slides on one of atan(0.55 mu)."""
    ground = Friction(0.6, 0.6, 0.6, static_ratio=1.0)
    worm = Worm(**STIFF)
    for share_held, expected in ((0.45, False), (0.55, True)):
        plane = Plane(np.arctan(share_held * 0.6), 0.0, patches=(Patch(0.0, along=(0.5, 9.0)),))
        result = worm3d.simulate(worm, plane, ground, duration=1.0)
        assert (all_slip(result)[-1] > 1e-6) == expected


def test_a_contact_that_slid_sticks_again_with_the_static_limit() -> None:
    """Break loose, stop, and reload between the kinetic and the static limit: it holds; kinetic alone would not."""
    worm = Worm(**STIFF)
    weights, weight = share(6), worm.mass * G

    def force(t: float) -> np.ndarray:
        pull = 0.4 if t < 0.1 else 0.0 if t < 1.0 else 0.25
        return weights * np.array([0.0, pull * weight, 0.0])

    def slipping(ratio: float) -> np.ndarray:
        ground = Friction(0.1, 0.1, 0.2, static_ratio=ratio)
        return all_slip(worm3d.simulate(worm, Plane(), ground, duration=2.0, external_force=force)) > 0.0

    static = slipping(1.5)
    assert static[1:10].all()
    assert not static[90:].any()
    assert slipping(1.0)[-1]


@pytest.mark.parametrize("gait", [TURNING, TravellingWave(amplitude=0.3, rectified=True, bias=0.7, hinge=-1.0)])
@BOTH
def test_without_friction_the_centre_of_mass_stays(integrator: str, gait: TravellingWave) -> None:
    """On level ground no force acts along it: whatever the gait, the centre of mass stays over its place."""
    result = worm3d.simulate(Worm(), Plane(), Friction(0.0, 0.0, 0.0), actuation=gait, integrator=integrator)
    assert result.status is Status.DONE
    assert np.abs(result.com[:, :2] - result.com[0, :2]).max() < 1e-11
    assert np.abs(result.joints - result.joints[0]).max() > 0.02
    assert_allclose(result.energy.friction_loss, 0.0, atol=1e-15)


@pytest.mark.parametrize("slope", [0.0, 0.04])
def test_swapping_forward_and_backward_mirrors_the_motion(slope: float) -> None:
    """A worm with its head where its tail was, coefficients swapped, makes the mirrored path."""
    gait = TravellingWave(amplitude=0.3, bias=0.3).bind(Worm())

    def reversed_gait(t: float) -> worm3d.Command:
        command = gait(t)
        return worm3d.Command(command.contraction[::-1])

    run = worm3d.simulate(Worm(), Plane(slope), Friction(0.03, 0.20, 0.15), actuation=gait, duration=4.0)
    mirrored = worm3d.simulate(Worm(), Plane(-slope), Friction(0.20, 0.03, 0.15), actuation=reversed_gait, duration=4.0)
    # In the axes of each plane, from the middle of the body at the start; left stays left.
    there, here = (each.joints @ each.world.axes.T for each in (mirrored, run))
    there, here = (joints - joints[0].mean(axis=0) * [1.0, 0.0, 0.0] for joints in (there, here))
    assert_allclose(there[:, ::-1] * [-1.0, 1.0, 1.0], here, rtol=0, atol=1e-10)
    assert abs(run.distance) > 0.05


def test_coefficients_may_differ_by_decades() -> None:
    forward = np.full(6, 0.03)
    forward[2] = 1e-6
    for ground in (Friction(1e-5, 0.2, 0.2), Friction(forward, 0.2, 1.5), Friction(0.03, 0.2, 0.0)):
        result = worm3d.simulate(Worm(), Plane(), ground, actuation=TURNING, duration=4.0)
        assert result.status is Status.DONE
        assert result.energy.balance_error < 1e-9


@pytest.mark.parametrize("end_faces", [True, False])
@pytest.mark.parametrize("heading", [np.pi / 2, -0.7])
def test_moments_balance_on_a_slope(heading: float, end_faces: bool) -> None:
    """At rest, forces and moments of contacts and weight about the centre of mass are zero: friction has its lever."""
    worm, slope = Worm(end_faces=end_faces), 0.15
    result = worm3d.simulate(worm, Plane(slope, heading), Friction(0.5, 0.5, 0.5), duration=6.0, record_every=600)
    arms, weight = result.points[-1] - result.com[-1], np.array([0.0, 0.0, -9.81])
    of_contacts = np.cross(arms, result.contact_force[-1]).sum(axis=(0, 1))
    of_weight = worm.joint_mass @ np.cross(result.joints[-1] - result.com[-1], weight)
    of_weight += np.einsum("na,nad->d", worm.apex_mass, np.cross(arms[:, :6], weight))
    normal = result.world.axes[2]
    overturning = worm.mass * 9.81 * np.sin(slope) * (result.com[-1] @ normal)
    np.testing.assert_allclose(of_contacts + of_weight, 0.0, rtol=0, atol=1e-6 * overturning)
    np.testing.assert_allclose(result.contact_force[-1].sum(axis=(0, 1)) + worm.mass * weight, 0.0, rtol=0, atol=1e-8)


def test_a_face_that_rolls_does_not_slip() -> None:
    """A worm that stands on its end faces and is pulled sideways rolls: the anchors go with it, and nothing slips."""
    worm, ground = Worm(segments=2, k_spring=1e4, k_twist=100.0, actuator_lag=0.0), Friction(0.5, 0.5, 0.5)
    long = np.full((2, 2), -0.01)
    start = worm3d.simulate(worm, Plane(), ground, lambda t: worm3d.Command(long), duration=2.0).state
    run = worm3d.simulate(
        worm,
        Plane(),
        ground,
        lambda t: worm3d.Command(long),
        duration=0.3,
        dt=0.001,
        state=start,
        external_force=lambda t: np.full((3, 3), [0.0, 0.01, 0.0]),
    )
    assert run.normal_load[-1].sum() == 0.0, "on its faces"
    moved, turned = run.joints[-1, 0, 1] - run.joints[0, 0, 1], -np.arcsin(run.directors[-1, :, 2])
    assert moved > 5e-3
    np.testing.assert_allclose(moved, 0.05 * turned, rtol=1e-2)
    assert run.joint_slip[:, [0, -1]].sum() < 0.01 * moved


@pytest.mark.parametrize("steps", [4.5, 7.6])
def test_what_slides_comes_to_rest_by_kinetic_friction_alone(steps: float) -> None:
    """No step of a worm that slides to rest takes more than mu_k N, though static friction would stop it sooner."""
    worm, mu, dt = Worm(**STIFF), 0.2, 1e-3
    ground = Friction(mu, mu, mu, static_ratio=2.0)
    start = worm3d.simulate(worm, Plane(), ground, duration=0.1).state
    start = start.with_changes(joint_velocity=np.tile([steps * mu * G * dt, 0.0, 0.0], (7, 1)), time=0.0)
    run = worm3d.simulate(worm, Plane(), ground, state=start, duration=0.02, dt=dt, integrator="implicit_euler")
    braking = -np.diff(run.momentum[:, 0]) / dt
    assert (braking <= mu * loads(run)[1:] * (1.0 + 1e-6)).all()
    assert abs(run.momentum[-1, 0]) < 1e-3 * run.momentum[0, 0]
