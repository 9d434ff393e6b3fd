"""The solver for symmetric banded systems against a dense one."""

import numpy as np
import pytest
from bands import banded

from worm3d.machine.banded import B, cholesky_solve

SIZES = [1, 2, 8, 12, 13, 33, 100]


def random_band(n, seed):
    rng = np.random.default_rng(seed)
    distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return np.where(distance <= B, rng.normal(size=(n, n)), 0.0), rng.normal(size=n)


@pytest.mark.parametrize("n", SIZES)
def test_cholesky_solves_a_definite_system(n):
    A, b = random_band(n, n)
    A = 0.5 * (A + A.T) + 2.0 * (B + 1) * np.eye(n)
    x = b.copy()
    assert cholesky_solve(banded(A), x)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("n", SIZES)
def test_cholesky_uses_the_upper_triangle_only(n):
    A, b = random_band(n, n)
    A = 0.5 * (A + A.T) + 2.0 * (B + 1) * np.eye(n)
    x = b.copy()
    assert cholesky_solve(banded(np.triu(A)), x)
    np.testing.assert_allclose(A @ x, b, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("bad", [-1.0, 0.0, np.nan])
def test_cholesky_refuses_what_is_not_definite(bad):
    A = np.eye(20)
    A[7, 7] = bad
    assert not cholesky_solve(banded(A), np.ones(20))


def test_cholesky_refuses_an_indefinite_matrix_with_a_positive_diagonal():
    A = np.eye(20)
    A[3, 5] = A[5, 3] = 1.1
    assert not cholesky_solve(banded(A), np.ones(20))
