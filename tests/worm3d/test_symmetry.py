"""Turned, mirrored, shifted and tilted scenes give turned, mirrored, shifted and tilted paths."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import Gait, TravellingWave
from planar.linkage import ground as planar_ground
from worm3d import ClampedGround, Command, Friction, Plane, Result, State, Status, Worm, simulate
from worm3d.physics import contact
from worm3d.physics.friction_laws import Coulomb

WAVE = TravellingWave()
TURN = TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5)
GAITS = pytest.mark.parametrize("gait", [WAVE, TURN], ids=["wave", "turn"])
SLOPES = pytest.mark.parametrize("slope", [0.0, 0.1], ids=["flat", "slope"])


def rotation(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    """Return the matrix of a rotation (Rodrigues)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def done(result: Result) -> Result:
    assert result.status is Status.DONE, result.stop.sentence
    return result


@GAITS
@SLOPES
def test_a_scene_turned_about_the_vertical_gives_the_turned_path(slope: float, gait: Gait) -> None:
    """Place, azimuth and the slope's heading turned by the same angle; 10 s, 1e-9 m."""
    worm, angle = Worm(), 0.7
    R, at = rotation((0.0, 0.0, 1.0), angle), np.array([0.1, 0.2])
    runs = []
    for turn, position in ((0.0, at), (angle, R[:2, :2] @ at)):
        plane = Plane(slope, 0.4 + turn)
        state = State.straight(worm, plane, position, azimuth=0.2 + turn)
        runs.append(done(simulate(worm, plane, actuation=gait, state=state)))
    first, turned = runs
    assert_allclose(turned.joints, first.joints @ R.T, rtol=0, atol=1e-9)
    assert_allclose(turned.points, first.points @ R.T, rtol=0, atol=1e-8)
    assert_allclose(turned.heading - turned.heading[0], first.heading - first.heading[0], rtol=0, atol=1e-8)
    assert_allclose(turned.distance, first.distance, rtol=0, atol=1e-9)
    assert np.linalg.norm(first.com[-1] - first.com[0]) > 0.2, "it goes somewhere"


def mirrored(gait: Gait, worm: Worm) -> Callable[[float], Command]:
    """Return a gait with left and right exchanged and hinges turned the other way."""
    own = gait.bind(worm)

    def actuation(t: float) -> Command:
        c = own(t)
        return Command(c.contraction[:, ::-1], hinge=-c.hinge, force=c.force[:, ::-1])

    return actuation


@GAITS
@SLOPES
def test_mirrored_commands_give_the_mirrored_path(slope: float, gait: Gait) -> None:
    """y -> -y; chambers and apexes change sides, axial vectors (directors) get a sign; 10 s, 1e-10 m."""
    worm, M = Worm(), np.array([1.0, -1.0, 1.0])
    left, right = (done(simulate(worm, Plane(slope), actuation=a)) for a in (gait, mirrored(gait, worm)))
    assert_allclose(right.joints, left.joints * M, rtol=0, atol=1e-10)
    assert_allclose(right.directors, -left.directors * M, rtol=0, atol=1e-9)
    assert_allclose(right.bend, -left.bend, rtol=0, atol=1e-9)
    assert_allclose(right.chamber_length, left.chamber_length[:, :, ::-1], rtol=0, atol=1e-10)
    assert_allclose(right.normal_load, left.normal_load[:, :, [3, 4, 5, 0, 1, 2]], rtol=0, atol=1e-6)
    assert (np.abs(left.heading[-1] - left.heading[0]) > 0.5) == (gait is TURN), "the turning gait turns"


CASES = {
    "all break away at the first step": (TravellingWave(), Friction(1e-3, 0.2, 0.2, static_ratio=1.5), 0.0),
    "on a slope": (TravellingWave(bias=0.2), Friction(static_ratio=1.5), 0.1),
    "turning": (TURN, Friction(static_ratio=2.0), 0.0),
    "alike in all directions": (TravellingWave(amplitude=0.2), Friction(0.2, 0.2, 0.2, static_ratio=1.5), 0.0),
    "quickly uphill": (TravellingWave(period=0.7, bias=0.1), Friction(0.3, 0.3, 0.1, static_ratio=1.3), 0.2),
    "free forward": (TravellingWave(bias=0.1, hinge=0.3), Friction(0.0, 0.2, 0.2, static_ratio=1.5), 0.05),
}
"""Gait, friction and slope."""


def crawl(
    gait: Any, ground: Friction, plane: Plane, azimuth: float = 0.0, at: tuple[float, float] = (0.0, 0.0), **more: Any
) -> Result:
    worm = Worm()
    state = State.straight(worm, plane, np.array(at), azimuth)
    return done(simulate(worm, plane, ground, gait, duration=1.0, state=state, **more))


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
@pytest.mark.parametrize("name", CASES)
def test_contacts_break_away_alike_wherever_the_world_is(name: str, integrator: str) -> None:
    """Turned, shifted and mirrored, to 1e-9 m: rounding once decided which slide at a symmetric start, by 2e-4 m."""
    gait, ground, slope = CASES[name]
    first = crawl(gait, ground, Plane(slope, 0.3), integrator=integrator)
    assert first.breakaways.sum() > 0
    for angle, at in (
        (0.5, (0.0, 0.0)),
        (1.3, (0.0, 0.0)),
        (-2.9, (0.3, 0.1)),
        (0.0, (30.0, -20.0)),
        (2.0, (-7.0, 9.0)),
    ):
        R, shift = rotation((0.0, 0.0, 1.0), angle), np.array(at)
        plane = Plane(slope, 0.3 + angle)
        turned = crawl(gait, ground, plane, angle, tuple(shift), integrator=integrator)
        origin = turned.joints[0, 0] - first.joints[0, 0] @ R.T
        assert_allclose(turned.joints, first.joints @ R.T + origin, rtol=0, atol=1e-9)
    mirror = crawl(mirrored(gait, Worm()), ground, Plane(slope, -0.3), integrator=integrator)
    assert_allclose(mirror.joints, first.joints * [1.0, -1.0, 1.0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("azimuth", [0.7, 2.5])
def test_a_clamped_worm_that_is_pushed_aside_goes_the_turned_and_the_mirrored_way(azimuth: float) -> None:
    """(P9) and (P10) along and across the body, wherever that points."""
    worm, ground, push = Worm(), Friction(0.03, 0.2, 0.1), np.array([0.0, 0.03, 0.0])

    def pushed(angle: float, side: float) -> Result:
        force = np.tile(rotation((0.0, 0.0, 1.0), angle) @ (side * push), (7, 1))
        state, gait = State.straight(worm, ClampedGround(), azimuth=angle), TravellingWave(period=0.5)
        return done(simulate(worm, ClampedGround(), ground, gait, 0.5, state=state, external_force=lambda t: force))

    first = pushed(0.0, 1.0)
    assert np.ptp(first.com[:, 1]) > 0.01
    turned = first.joints @ rotation((0.0, 0.0, 1.0), azimuth).T
    found = pushed(azimuth, 1.0).joints
    assert_allclose(found - found[0, 0], turned - turned[0, 0], rtol=0, atol=1e-9)
    assert_allclose(pushed(0.0, -1.0).joints, first.joints * [1.0, -1.0, 1.0], rtol=0, atol=1e-9)


def test_a_worm_elsewhere_does_the_same() -> None:
    shift, worm, plane = np.array([30.0, -20.0, 0.0]), Worm(), Plane()
    runs = [
        done(simulate(worm, plane, actuation=TURN, state=State.straight(worm, plane, at), duration=4.0))
        for at in (np.zeros(2), shift[:2])
    ]
    assert_allclose(runs[1].joints, runs[0].joints + shift, rtol=0, atol=1e-8)


def test_a_slope_is_a_level_plane_under_a_tilted_gravity() -> None:
    """Plane(slope) turned about y into the level: gravity then leans back by the slope, g (-sin, 0, -cos)."""
    slope, worm = 0.15, Worm()
    R = rotation((0.0, -1.0, 0.0), slope)  # lifts x
    tilted = done(simulate(worm, Plane(slope), actuation=TURN, duration=4.0))
    lean = 9.81 * np.array([-np.sin(slope), 0.0, -np.cos(slope)])
    level = done(simulate(worm, Plane(), actuation=TURN, duration=4.0, gravity=lean))
    assert_allclose(tilted.joints, level.joints @ R.T, rtol=0, atol=1e-9)
    assert_allclose(tilted.energy.work_contract.sum(), level.energy.work_contract.sum(), rtol=1e-9)
    ideal = done(simulate(worm, Plane(), actuation=TURN, duration=4.0))
    assert np.abs(ideal.joints - level.joints).max() > 1e-3, "the slope matters"


def test_free_flight_is_the_same_in_every_direction() -> None:
    """Pose, motion, gravity and forces under any rotation; with every kind of command and stiffness at work."""
    rng = np.random.default_rng(8)
    n = 5
    worm = Worm(segments=n, k_torsion=1.0, cross0=0.1, k_apex=0.02, drag=0.1, mass=0.2)
    joints = State.straight(worm, position=(0.0, 0.0, 20.0)).joints + 0.005 * rng.standard_normal((n + 1, 3))
    base = State(joints=joints, bend=rng.uniform(-0.2, 0.2, n), joint_velocity=rng.standard_normal((n + 1, 3)))
    push, wave = 0.1 * rng.standard_normal((n + 1, 3)), TravellingWave(bias=0.4, hinge=0.5, force=0.2, period=0.5)
    R = rotation((1.0, -2.0, 0.5), 2.0)

    def fly(turn: np.ndarray) -> Result:
        arguments: dict[str, Any] = {
            "state": base.with_changes(
                joints=base.joints @ turn.T,
                directors=base.directors @ turn.T,
                joint_velocity=base.joint_velocity @ turn.T,
                roll_rate=np.linspace(-1, 1, n),
                bend_rate=np.linspace(1, 2, n),
            ),
            "gravity": turn @ [0.0, 0.0, -9.81],
            "external_force": lambda t: np.cos(5 * t) * push @ turn.T,
        }
        return done(simulate(worm, None, actuation=wave, duration=1.0, **arguments))

    plain, turned = fly(np.eye(3)), fly(R)
    assert_allclose(turned.joints, plain.joints @ R.T, rtol=0, atol=1e-10)
    assert_allclose(turned.directors, plain.directors @ R.T, rtol=0, atol=1e-9)
    assert_allclose(turned.angular_momentum, plain.angular_momentum @ R.T, rtol=0, atol=1e-10)


def test_swapped_friction_and_reversed_wave_mirror_the_path_fore_and_aft() -> None:
    """A worm facing the other way: tail and head, forward and backward, direct and retrograde exchanged."""
    worm = Worm(end_faces=False)
    there = done(simulate(worm, Plane(), Friction(0.03, 0.2, 0.2), WAVE, duration=4.0))

    def reversed_wave(t: float) -> Command:
        return Command(WAVE.bind(worm)(t).contraction[::-1])

    back = done(simulate(worm, Plane(), Friction(0.2, 0.03, 0.2), reversed_wave, duration=4.0))
    assert_allclose(back.joints[:, ::-1] * [-1.0, 1.0, 1.0] + [1.0, 0.0, 0.0], there.joints, rtol=0, atol=1e-8)
    assert abs(there.distance) > 0.05


@pytest.mark.parametrize(("share", "breaks"), [(1.0 - 5e-10, True), (1.0 - 2e-9, False), (1.0, True)])
@pytest.mark.parametrize("way", [(1.0, 0.0), (-1.0, 0.0), (0.6, -0.8)], ids=["forward", "backward", "across"])
def test_a_contact_breaks_away_from_1e_9_below_its_limit_on(way: tuple[float, ...], share: float, breaks: bool) -> None:
    """(C6): the limit is eta = c_0 r. The planar model, (G4), has the same margin."""
    mu, c_0, r = np.array([0.05, 0.2, 0.3]), 1.3, 2e-6
    of = contact.Coefficients(contact.Directions(*map(ca.SX, mu)), contact.Directions(*map(ca.SX, (1.0, 1.0, 1.0))))
    law = contact.Step(ca.SX(r), ca.SX(c_0), ca.SX.zeros(2), ca.SX(0.01), Coulomb, {})
    along = np.array(way) * [mu[0] if way[0] > 0.0 else mu[1], mu[2]]
    y = np.array(way) / np.linalg.norm(along) * c_0 * r * share
    assert (float(contact.static_excess(ca.SX(y), of, law)) > 0.0) == breaks
    assert planar_ground.LIMIT_TOLERANCE == contact.YIELD_TOLERANCE
