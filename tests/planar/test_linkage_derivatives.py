"""Gradient and Hessian of a step against central differences, and each energy against its closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planar.linkage import Friction, Linkage, regimes
from planar.linkage.element import BY_LAW, HALF_BANDWIDTH, NO_BAND, OPEN, ROWS, SLIDE, STICK, Body, Now, evaluate
from planar.linkage.ground import Ground
from planar.linkage.shape import apexes, apexes_by_law, cross_products, diagonals, hinge_angles
from planar.linkage.step import body_of

N, SIZE = 4, 10


def ground_of_scale(worm: Linkage, stiffness: float) -> Ground:
    """Return a ground soft enough for finite differences, every branch of the friction within reach."""
    ground = Ground.of(worm, Friction(0.3, 0.5), 9.81)
    return ground._replace(stiffness=stiffness, damping=5.0, yield_gauge=0.01, gauge_damping=2.0)


def some_step(worm: Linkage, height: float = 0.07) -> tuple[np.ndarray, Now]:
    """Return joints, and a step that does not start at rest, with everything switched on."""
    rng = np.random.default_rng(1)
    joints = worm.rest() + 0.01 * rng.standard_normal((N + 1, 2)) + [0.0, height]
    points = apexes_by_law(joints, np.full(N, worm.l0), worm.segment_law)
    length, _ = diagonals(joints)
    now = Now(
        dt=0.01,
        l_cmd=worm.l0 * (1.0 - rng.uniform(0.0, 0.3, N)),
        force=rng.standard_normal((N + 1, 2)),
        gravity=np.array([0.3, -9.81]),
        joint_hat=joints + 0.01 * rng.standard_normal(joints.shape),
        apex_hat=points + 0.01 * rng.standard_normal(points.shape),
        joint_n=joints + 0.001,
        length_n=length + 0.01,
        cross_n=cross_products(joints) + 0.1,
        angle_n=hinge_angles(length, worm.link_length) + 0.1 if worm.has_links else np.zeros(N),
        depth_n=np.abs(0.001 * rng.standard_normal((N, 2))),
        anchor=points[..., 0] + np.array([[0.004], [-0.05], [0.05], [-0.004]]),  # stuck and sliding, both ways
        direction=np.array([1.0, 1.0, 1.0, -1.0]),
        slide_n=0.003 * rng.standard_normal((N, 2)),
        cap=np.tile([1.0, 1.2], (N, 1)),
        load=np.abs(rng.standard_normal((N, 2))),
        push=rng.standard_normal((N, 2)),
        regime=np.full((N, 2), BY_LAW),
    )
    return joints.ravel(), now


def dense(band: np.ndarray) -> np.ndarray:
    matrix = np.zeros((SIZE, SIZE))
    for i in range(SIZE):
        for j in range(max(0, i - HALF_BANDWIDTH), min(SIZE, i + HALF_BANDWIDTH + 1)):
            matrix[i, j] = band[2 * HALF_BANDWIDTH + i - j, j]
    return matrix


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("kind", ["rhombus", "hydrostat", "learned"])
def test_against_central_differences(uneven_worm: Linkage, law_worm: Linkage, kind: str, coupled: bool) -> None:
    other = {"half_height": None, "k_spring": 13.0, "length": 1.0, "segment": law_worm.segment}
    changes = other if kind == "learned" else {"segment": kind}
    worm = uneven_worm if kind == "rhombus" else uneven_worm.with_changes(k_apex=0.0, **changes)
    q, now = some_step(worm, 0.07 if kind != "learned" else 0.055)
    body, ground = body_of(worm), ground_of_scale(worm, 1000.0)
    assert len(set(regimes.of_law(q, body.segment_law, ground, now).ravel())) > 1, "some apexes touch the ground"
    gradient, band = np.zeros(SIZE), np.zeros((ROWS, SIZE))
    evaluate(q, body, ground, now, coupled, gradient, band)
    matrix, step = dense(band), 1e-7
    for i, e in enumerate(step * np.eye(SIZE)):
        above, below = np.zeros(SIZE), np.zeros(SIZE)
        rise = evaluate(q + e, body, ground, now, coupled, above, NO_BAND)
        rise -= evaluate(q - e, body, ground, now, coupled, below, NO_BAND)
        if not coupled:
            assert_allclose(gradient[i], rise / (2 * step), rtol=1e-6, atol=1e-6)
        assert_allclose(matrix[:, i], (above - below) / (2 * step), rtol=1e-6, atol=1e-4)
    asymmetry = np.abs(matrix - matrix.T).max()
    assert (asymmetry > 1.0) == coupled, "the loads of the friction couple the directions, one way only"


def test_given_regimes_against_central_differences(uneven_worm: Linkage) -> None:
    """Where each contact has any regime, right or wrong; with that of the law the residual is the law's."""
    q, now = some_step(uneven_worm)
    q[1::2] -= 0.03  # all bottoms touch
    body, ground = body_of(uneven_worm), ground_of_scale(uneven_worm, 1000.0)
    law, given, band, step = np.zeros(SIZE), np.zeros(SIZE), np.zeros((ROWS, SIZE)), 1e-7
    evaluate(q, body, ground, now, True, law, NO_BAND)
    own = now._replace(regime=regimes.of_law(q, body.segment_law, ground, now))
    assert len(set(own.regime.ravel())) > 3
    evaluate(q, body, ground, own, True, given, NO_BAND)
    assert_allclose(given, law, rtol=1e-12, atol=1e-12)
    other = now._replace(regime=np.array([[OPEN, STICK], [STICK + 1, SLIDE], [SLIDE + 1, OPEN], [STICK, SLIDE]]))
    evaluate(q, body, ground, other, True, given, band)
    matrix = dense(band)
    for i, e in enumerate(step * np.eye(SIZE)):
        above, below = np.zeros(SIZE), np.zeros(SIZE)
        evaluate(q + e, body, ground, other, True, above, NO_BAND)
        evaluate(q - e, body, ground, other, True, below, NO_BAND)
        assert_allclose(matrix[:, i], (above - below) / (2 * step), rtol=1e-6, atol=1e-4)


def potential(worm: Linkage, q: np.ndarray, now: Now, **changes: object) -> float:
    body: Body = body_of(worm)._replace(
        joint_mass=np.zeros(N + 1), apex_mass=np.zeros((N, 2)), joint_drag=np.zeros(N + 1)
    )
    no_contact = Ground.none(N)
    return evaluate(q, body, no_contact, now._replace(**changes), False, np.zeros(SIZE), NO_BAND)


def test_energies_are_those_of_the_equations(uneven_worm: Linkage) -> None:
    """(P7), (P6), apex hinges and Kelvin-Voigt dampers, summed as their formulas stand."""
    q, now = some_step(uneven_worm)
    joints, a, dt, tau = q.reshape(-1, 2), uneven_worm.link_length, 0.01, 0.03
    length, _ = diagonals(joints)
    angle, rest = hinge_angles(length, a), hinge_angles(np.full(N, 0.2), a)
    cross = cross_products(joints)
    k, kt, ka = uneven_worm.k_spring, uneven_worm.k_torsion, uneven_worm.k_apex
    expected = (k * 0.2 / 2 * (1 - length / now.l_cmd) ** 2).sum()
    expected += (kt / 2 * (cross - uneven_worm.cross0) ** 2).sum()
    expected += 2 * (ka / 2 * (angle - rest) ** 2).sum()
    expected += (tau * k / 0.2 / (2 * dt) * (length - now.length_n) ** 2).sum()
    expected += (tau * kt / (2 * dt) * (cross - now.cross_n) ** 2).sum()
    expected += 2 * (tau * ka / (2 * dt) * (angle - now.angle_n) ** 2).sum()
    assert_allclose(
        potential(uneven_worm, q, now, force=np.zeros((N + 1, 2)), push=np.zeros((N, 2))), expected, rtol=1e-12
    )


def test_rhombus_keeps_its_links(uneven_worm: Linkage) -> None:
    """(2 h)^2 + l^2 = (2 a)^2, and each apex is a link's length from both joints."""
    q, _ = some_step(uneven_worm)
    joints, a = q.reshape(-1, 2), uneven_worm.link_length
    points = apexes(joints, a)
    for end in (joints[:-1], joints[1:]):
        for side in (0, 1):
            assert_allclose(np.linalg.norm(points[:, side] - end, axis=1), a, rtol=1e-13)
    assert (points[:, 0, 1] < points[:, 1, 1]).all(), "bottom comes first"
    length, _ = diagonals(joints)
    height = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    assert_allclose(height**2 + length**2, (2 * a) ** 2, rtol=1e-13)


def test_out_of_reach_is_infinite(uneven_worm: Linkage) -> None:
    q, now = some_step(uneven_worm)
    q[-2] += 1.0
    assert potential(uneven_worm, q, now) == np.inf
