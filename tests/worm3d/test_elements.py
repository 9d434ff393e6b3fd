"""The symbolic kinematics: directions, closed form, and the planar model as the special case."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from planar.linkage import shape
from worm3d.physics import elements


def values(expression: ca.SX) -> np.ndarray:
    """Return the numbers of an expression without free symbols."""
    return np.array(ca.evalf(expression), dtype=float).squeeze()


def vector(*numbers: float) -> ca.SX:
    return ca.SX(list(map(float, numbers)))


X, Y = vector(1, 0, 0), vector(0, 1, 0)


def straight(roll: float = 0.0) -> elements.Frame:
    return elements.frame(vector(2, 0, 0), ca.SX(roll), X, Y)


def rhombi(lengths: list[ca.SX], a: float, b: float) -> list[tuple[ca.SX, ca.SX]]:
    """Return the half-heights and outward distances of chambers that are rhombi with links a at the offset b."""
    heights = [elements.half_height(ca.SX(a), length) for length in lengths]
    return [(h, b + h) for h in heights]


def test_frame_of_a_straight_segment_points_forward_left_and_up() -> None:
    f = straight()
    assert_allclose(values(f.length), 2.0)
    assert_allclose(values(f.t), [1, 0, 0])
    assert_allclose(values(f.d), [0, 1, 0])
    assert_allclose(values(f.u), [0, 0, 1])
    rolled = straight(0.3)
    assert_allclose(values(rolled.d), [0, np.cos(0.3), np.sin(0.3)], atol=1e-15)


def test_transport_is_a_rotation_without_twist() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 3))
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    d = np.cross(a, rng.standard_normal(3))
    carried = values(elements.transport(vector(*a), vector(*b), vector(*d)))
    assert_allclose(np.linalg.norm(carried), np.linalg.norm(d))
    assert_allclose(carried @ b, 0.0, atol=1e-14)
    axis = np.cross(a, b)
    assert_allclose(carried @ axis, d @ axis, rtol=1e-12)  # the axis of the rotation stays
    turned_side, side = np.cross(b, carried), np.cross(a, d)
    assert_allclose(turned_side @ axis, side @ axis, rtol=1e-12)  # turned with it, not mirrored


def test_bend_to_the_left_shortens_the_left_chamber() -> None:
    left, right = (values(c) for c in elements.chamber_lengths(ca.SX(0.2), ca.SX(0.5), ca.SX(0.03)))
    assert_allclose(left, 0.2 - 0.015)
    assert_allclose(right, 0.2 + 0.015)


def test_apexes_stand_in_the_order_of_the_notation() -> None:
    f = straight()
    lengths = elements.chamber_lengths(f.length, ca.SX(0.4), ca.SX(0.3))
    a, b, h = 1.2, 0.3, np.sqrt(1.2**2 - np.array([1.88, 2.12]) ** 2 / 4)
    points = [values(p) for p in elements.apexes(vector(1, 0, 0), f, rhombi(lengths, a, b), ca.SX(b))]
    expected = [[1, b, -h[0]], [1, b, h[0]], [1, b + h[0], 0], [1, -b, -h[1]], [1, -b, h[1]], [1, -b - h[1], 0]]
    assert_allclose(points, expected, atol=1e-15)


def turned(yaw: float, pitch: float) -> elements.Frame:
    """Return a segment ahead that points to the left (yaw > 0) and up (pitch > 0)."""
    tip = vector(np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch))
    return elements.frame(tip, ca.SX(0), X, Y)


def strains(second: elements.Frame, bends: float = 0.0, hinge: float = 0.0, cross0: float = 0.0) -> np.ndarray:
    parts = elements.joint_strains(elements.joint_angles(straight(), second), ca.SX(bends), ca.SX(hinge), ca.SX(cross0))
    return np.array([values(part) for part in parts])


def test_strains_tell_up_from_down_and_left_from_right() -> None:
    assert_allclose(strains(turned(0.4, 0.0)), [0.0, np.sin(0.4), 0.0], atol=1e-15)
    assert_allclose(strains(turned(0.0, 0.4)), [-np.sin(0.4), 0.0, 0.0], atol=1e-15)
    assert_allclose(strains(turned(0.4, 0.0), bends=0.8), 0.0, atol=1e-15)  # bends of both segments, shared
    assert_allclose(strains(turned(0.4, 0.0), hinge=0.4), 0.0, atol=1e-15)
    assert_allclose(strains(turned(0.0, 0.4), cross0=np.sin(0.4)), 0.0, atol=1e-15)
    rolled = elements.frame(X, ca.SX(0.3), X, Y)
    assert_allclose(strains(rolled)[2], 0.3)


def test_twist_is_free_of_bending() -> None:
    """A director carried without twist has no twist strain, however the joint is bent."""
    second = turned(0.3, -0.2)
    assert_allclose(strains(second)[2], 0.0, atol=1e-14)


def test_in_the_plane_it_is_the_planar_model() -> None:
    rng = np.random.default_rng(2)
    joints = np.array([[0.0, 0.3], [0.9, 0.4], [1.9, 0.1]]) + 0.05 * rng.standard_normal((3, 2))
    a = np.array([0.7, 0.8])
    space = [vector(x, 0.0, z) for x, z in joints]
    frames = [elements.frame(space[i + 1] - space[i], ca.SX(0), X, Y) for i in range(2)]
    planar_apexes, planar_cross = shape.apexes(joints, a), shape.cross_products(joints)
    for i, f in enumerate(frames):
        lengths = elements.chamber_lengths(f.length, ca.SX(0.0), ca.SX(0.0))
        points = elements.apexes((space[i] + space[i + 1]) / 2, f, rhombi(lengths, a[i], 0.0), ca.SX(0.0))
        for chamber in (0, 3):
            assert_allclose(values(points[chamber])[[0, 2]], planar_apexes[i, 0], rtol=1e-13)
            assert_allclose(values(points[chamber + 1])[[0, 2]], planar_apexes[i, 1], rtol=1e-13)
        assert_allclose(
            values(elements.hinge_angle(ca.SX(a[i]), lengths[0])), shape.hinge_angles(values(f.length), a[i])
        )
    pitch, yaw, twist = elements.joint_strains(
        elements.joint_angles(*frames), ca.SX(0), ca.SX(0), ca.SX(planar_cross[0])
    )
    assert_allclose(values(pitch), 0.0, atol=1e-14)  # c.d = -cross
    assert_allclose([values(yaw), values(twist)], 0.0, atol=1e-14)


@pytest.mark.parametrize("length", [0.1, 0.17, 0.19])
def test_chamber_energy_is_half_of_p7(length: float) -> None:
    k, l0, commanded = 13.0, 1 / 6, 0.15
    energy = elements.chamber_energy(ca.SX(k), ca.SX(l0), ca.SX(length), ca.SX(commanded))
    assert_allclose(values(energy), 0.5 * k * l0 / 2 * (1 - length / commanded) ** 2)
    assert_allclose(values(elements.half_height(ca.SX(0.12), ca.SX(length))), np.sqrt(0.0144 - length**2 / 4))


@pytest.mark.parametrize("roll", [0.0, 1.0, -2.5])
def test_face_touches_a_wall_with_its_rim_or_its_middle(roll: float) -> None:
    """A level disc stands on its lowest rim point; tilted by phi that lies R cos(phi) below and is turned with it.

    Wherever the segment has rolled to; the place once chosen then rolls with it.
    """
    p, R, floor = vector(0, 0, 1), ca.SX(0.05), vector(0, 0, 1)

    def place(edge: ca.SX, wall: ca.SX, rolled_on: float = 0.0, radius: ca.SX = R) -> np.ndarray:
        frame = elements.frame(edge, ca.SX(roll), X, vector(0, 1, 0))
        later = elements.frame(edge, ca.SX(roll + rolled_on), X, vector(0, 1, 0))
        return values(elements.face_point(p, later, radius, elements.nearest_rim(frame, wall)))

    assert_allclose(place(X, floor), [0, 0, 0.95], atol=1e-7)
    tilted = vector(np.cos(0.3), 0, np.sin(0.3))
    assert_allclose(place(tilted, floor), [0.05 * np.sin(0.3), 0, 1 - 0.05 * np.cos(0.3)], atol=1e-7)
    assert_allclose(place(X, X), [0, 0, 1], atol=1e-15)
    assert_allclose(place(X, floor, radius=ca.SX(0.0)), [0, 0, 1])
    # Rolling on by a right angle turns the left side up: what was below comes to the left... of x, that is to -y or y.
    assert_allclose(np.abs(place(X, floor, rolled_on=np.pi / 2)), [0, 0.05, 1], atol=1e-7)
