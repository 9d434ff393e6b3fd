"""Shapes that are refused: the angles by which a joint is bent, and what chambers and hinges ask for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import TravellingWave
from worm3d import Plane, State, Status, Worm, simulate
from worm3d.physics.kernels import joint, point, segment
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver.evaluate import LENGTHS, TANGENT
from worm3d.solver.guard import BEND, joint_angles, refused

N = 5


def angles(tangents: np.ndarray, bend: np.ndarray, hinge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles of joints for tangents (3, N), chamber bends (N,) and hinges (N - 1,), in wider arrays."""
    rest, segments, joints = np.full((TANGENT + 3, 8), 7.0), np.full((60, 8), 7.0), np.full((60, 8), 7.0)
    rest[TANGENT:, :N] = tangents
    segments[segment.SEGMENT_LAYOUT.first("q") + BEND, :N] = bend
    joints[joint.JOINT_LAYOUT.first("hinge"), : N - 1] = hinge
    return joint_angles({"rest": rest, "segment_in": segments, "joint_in": joints}, N)


def test_a_straight_body_has_no_angle_at_its_joints_whichever_way_it_lies() -> None:
    """The product of two equal unit vectors may be above 1 by rounding, which is the cosine of no angle."""
    above = 0
    for seed in range(200):
        t = np.random.default_rng(seed).standard_normal((3, 1))
        t = np.repeat(t / np.linalg.norm(t), N, axis=1)
        above += np.sum(t[:, 0] ** 2) > 1.0
        enclosed, asked = angles(t, np.zeros(N), np.zeros(N - 1))
        assert_allclose(enclosed, 0.0, rtol=0, atol=1e-7)
        assert_allclose(asked, 0.0)
    assert above > 10


@pytest.mark.parametrize("seed", range(3))
def test_a_bent_body_has_the_angles_of_its_turns_and_its_chambers_and_hinges_ask_for_their_sum(seed: int) -> None:
    """Each chamber bend is shared by the joints at both ends of its segment; left and right count alike."""
    random = np.random.default_rng(seed)
    turns, bend, hinge = (random.uniform(-1.5, 1.5, size) for size in (N - 1, N, N - 1))
    azimuth = np.concatenate([[0.4], 0.4 + np.cumsum(turns)])
    enclosed, asked = angles(np.array([np.cos(azimuth), np.sin(azimuth), 0.0 * azimuth]), bend, hinge)
    assert_allclose(enclosed, np.abs(turns), rtol=1e-7)
    assert_allclose(asked, [abs(bend[k] / 2 + bend[k + 1] / 2 + hinge[k]) for k in range(N - 1)])


def arrays_of(rest: float, distance: np.ndarray) -> dict[str, np.ndarray]:
    """Return arrays of segments with chambers of one length, and of points at distances (8, N), in wider ones."""
    points = np.full((60, POINTS_PER_SEGMENT * 8), -1.0)
    lanes = points[point.POINT_LAYOUT.first("distance")].reshape(POINTS_PER_SEGMENT, 8)
    lanes[:, :N] = distance
    return {"rest": np.full((60, 8), rest), "longest": np.linspace(0.2, 0.3, 8)[None], "point_in": points}


@pytest.mark.parametrize("deepest", range(N + 1))
def test_the_deepest_joint_is_named_that_of_the_head_too(deepest: int) -> None:
    """The rear faces of the segments are the joints from the tail on, the front face of the head is the last joint.

    Apexes below the segments may be deeper: they are no joints.
    """
    distance = np.full((POINTS_PER_SEGMENT, N), 1.0)
    distance[:6] = -0.5
    distance[6] = 0.001
    distance[7, -1] = 0.002
    distance[6 if deepest < N else 7, min(deepest, N - 1)] = -0.013
    segment_of, reason = refused(arrays_of(0.1, distance), N, Status.SUNK)
    assert segment_of == min(deepest, N - 1)
    assert reason.startswith(f"joint {deepest} is 0.013 m deep; press on it less")


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("longest", range(N))
def test_the_chamber_that_is_longest_beside_its_links_is_named(longest: int, side: int) -> None:
    arrays = arrays_of(0.1, np.ones((POINTS_PER_SEGMENT, N)))
    arrays["rest"][LENGTHS + side, longest] = 1.01 * arrays["longest"][0, longest]
    found, reason = refused(arrays, N, Status.FLATTENED)
    assert found == longest
    length = f"{arrays['rest'][LENGTHS + side, longest]:.4g}"
    assert reason.startswith(f"segment {longest}, whose {('left', 'right')[side]} chamber is {length} m long")
    assert refused(arrays, N, Status.DONE) == (0, "")


@pytest.mark.parametrize("place", [(30.0, -20.0), (-30.0, 20.0)])
def test_a_worm_is_judged_by_its_shape_and_not_by_where_it_lies(place: tuple[float, float]) -> None:
    """It crawls as at the origin, though its places are larger numbers than any angle that is refused."""
    worm, gait = Worm(), TravellingWave(amplitude=0.3, bias=0.2, period=0.5)
    ways = []
    for at in ((0.0, 0.0), place):
        state = State.straight(worm, Plane(), at)
        run = simulate(worm, Plane(), actuation=gait, duration=0.5, state=state)
        assert run.status is Status.DONE, run.stop.sentence
        ways.append(run.joints - run.joints[0, 0])
    assert_allclose(ways[1], ways[0], rtol=0, atol=1e-7)
