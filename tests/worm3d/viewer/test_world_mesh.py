"""Meshes as pictures: as they are, or with fewer triangles of the same shape."""

import numpy as np
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from worm3d.viewer import mesh


def test_a_small_mesh_is_drawn_as_it_is() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    drawn = mesh(ball.vertices, ball.faces, opacity=0.4)
    assert_array_equal(drawn.vertices, ball.vertices)
    assert_array_equal(drawn.faces, ball.faces)
    assert drawn.opacity == 0.4


def test_a_large_mesh_loses_triangles_not_its_shape() -> None:
    ball = trimesh.creation.icosphere(subdivisions=6)
    drawn = mesh(ball.vertices, ball.faces, most=5000)
    assert 1000 < len(drawn.faces) <= 5000 < len(ball.faces)
    assert_allclose(np.linalg.norm(drawn.vertices, axis=1), 1.0, rtol=0, atol=0.01)
    thinned = trimesh.Trimesh(drawn.vertices, drawn.faces, process=False)
    assert_allclose(thinned.volume, ball.volume, rtol=0.02)
    assert_allclose(thinned.area, ball.area, rtol=0.02)
