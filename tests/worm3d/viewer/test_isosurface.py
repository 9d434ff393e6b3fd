"""Surfaces from distances: closed, in the right place, seen from the side where the distance is positive."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from worm3d.viewer.world import isosurface

SPACING = 0.1
MIDDLE = np.array([0.1, 0.0, -0.2])


def grid(low: float, high: float, spacing: float = SPACING) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    side = np.arange(low, high, spacing)
    return np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1), np.full(3, low)


def ball(sign: float, spacing: float) -> trimesh.Trimesh:
    points, origin = grid(-1.5, 1.5, spacing)
    mesh = isosurface(sign * (np.linalg.norm(points - MIDDLE, axis=-1) - 1.0), origin, spacing)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ball_is_closed_and_seen_from_where_the_distance_is_positive(sign: float) -> None:
    coarse, fine = ball(sign, SPACING), ball(sign, 0.5 * SPACING)
    assert coarse.is_watertight
    assert np.abs(np.linalg.norm(coarse.vertices - MIDDLE, axis=1) - 1.0).max() < 0.05 * SPACING
    exact = sign * 4.0 / 3.0 * np.pi
    assert abs(fine.volume - exact) < 0.004 * abs(exact)
    assert_allclose((coarse.volume - exact) / (fine.volume - exact), 4.0, rtol=0.1, err_msg="of second order")


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_plane_lies_where_the_distance_is_zero(axis: int) -> None:
    points, origin = grid(-0.5, 0.5)
    mesh = isosurface(points[..., axis] - 0.03, origin, SPACING)
    assert_allclose(mesh.vertices[:, axis], 0.03, atol=1e-12)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    assert (normal[:, axis] > 0.0).all()
    assert_allclose(0.5 * normal[:, axis].sum(), (points.shape[0] - 2) ** 2 * SPACING**2, rtol=1e-12)


def test_there_is_nothing_where_the_sign_does_not_change() -> None:
    points, origin = grid(0.5, 1.0)
    assert not len(isosurface(points[..., 0], origin, SPACING).faces)
