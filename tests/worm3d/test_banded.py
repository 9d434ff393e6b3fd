"""Banded solvers against dense ones."""

import numpy as np
import pytest

from worm3d.banded import WIDTH, B, cholesky_solve, lu_factor, lu_solve

SIZES = [1, 2, 8, 12, 13, 33, 100]


def banded(dense):
    band = np.zeros((len(dense) + B, WIDTH))
    for i, row in enumerate(dense):
        for j in range(max(0, i - B), min(len(dense), i + B + 1)):
            band[i, B + j - i] = row[j]
    return band


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


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("n", SIZES)
def test_lu_solves_an_unsymmetric_system(n, sign):
    """Definite or not: diagonals of either sign; twice with the same working memory."""
    A, b = random_band(n, n)
    A += np.diag(3.0 * (B + 1) * np.where(np.arange(n) % 3 == 1, sign, 1.0))
    band, padded = banded(A), np.zeros(n + 2 * B)
    lu_factor(band, np.zeros(n), 0)
    for right in (b, b[::-1].copy()):
        x = right.copy()
        lu_solve(band, x, padded)
        np.testing.assert_allclose(A @ x, right, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("start", [0, 5, 13, 40, 59])
def test_lu_goes_on_where_rows_have_changed(start):
    """Factors of the rows before `start` are kept; a band that differs from there on, in rows and columns."""
    n = 60
    A, b = random_band(n, 3)
    A += 3.0 * (B + 1) * np.eye(n)
    changed, noise = A.copy(), random_band(n, 4)[0]
    changed[start:, start:] += noise[start:, start:]
    band, pivots = banded(A), np.zeros(n)
    lu_factor(band, pivots, 0)
    band[start:] = banded(changed)[start:]
    lu_factor(band, pivots, start)
    x = b.copy()
    lu_solve(band, x, np.zeros(n + 2 * B))
    np.testing.assert_allclose(changed @ x, b, rtol=1e-10, atol=1e-12)


def test_lu_leaves_a_coordinate_that_nothing_holds():
    """A singular system with a solution: a roll that neither mass nor spring holds, here even after elimination."""
    A, b = random_band(20, 1)
    A += 3.0 * (B + 1) * np.eye(20)
    A[7], A[:, 7], b[7] = 0.0, 0.0, 0.0
    A[12, [12, 13]] = A[13, [12, 13]] = 0.0
    A[12, :] = A[:, 12] = A[13, :] = A[:, 13] = 0.0
    A[12:14, 12:14], b[12:14] = [[1.0, 1.0], [1.0, 1.0]], 2.0
    x, band = b.copy(), banded(A)
    lu_factor(band, np.zeros(20), 0)
    lu_solve(band, x, np.zeros(20 + 2 * B))
    np.testing.assert_allclose(A @ x, b, rtol=1e-10, atol=1e-12)
    assert x[7] == 0.0


def test_lu_passes_nan_on():
    A = np.eye(20)
    A[7, 7] = np.nan
    band, x = banded(A), np.ones(20)
    lu_factor(band, np.zeros(20), 0)
    lu_solve(band, x, np.zeros(20 + 2 * B))
    assert np.isnan(x[7])
