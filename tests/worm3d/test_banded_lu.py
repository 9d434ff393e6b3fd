"""LU factors of banded matrices against a dense solver."""

import numpy as np
import pytest
from bands import banded

from worm3d.machine.banded import BAND_COLUMNS, BLOCK_SIZE, B, lu_factor, lu_solve

SIZES = [*range(1, 15), 33, 35, 100, 205]
GROUP = 13


def coupled(n):
    """Which coordinates share a group."""
    found = np.zeros((n, n), dtype=bool)
    for first in range(0, n, BLOCK_SIZE):
        found[first : first + GROUP, first : first + GROUP] = True
    return found


def random_matrix(n, seed):
    rng = np.random.default_rng(seed)
    return np.where(coupled(n), rng.normal(size=(n, n)), 0.0), rng.normal(size=n)


def dominant(n, seed):
    A, b = random_matrix(n, seed)
    return A + 3.0 * (B + 1) * np.eye(n), b


def factors_of(A):
    factors = np.full((len(A) + B, BAND_COLUMNS), np.nan)
    lu_factor(banded(A), factors)
    return factors


def solved(factors, b):
    x = b.copy()
    lu_solve(factors, x)
    return x


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("n", SIZES)
def test_an_unsymmetric_system_is_solved(n, sign):
    """Definite or not: diagonals of either sign; twice with the same factors."""
    A, b = random_matrix(n, n)
    A += np.diag(3.0 * (B + 1) * np.where(np.arange(n) % 3 == 1, sign, 1.0))
    factors = factors_of(A)
    for right in (b, b[::-1].copy()):
        x = solved(factors, right)
        np.testing.assert_allclose(A @ x, right, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(x, np.linalg.solve(A, right), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("n", [35, 205])
def test_pivots_need_not_dominate(n):
    """Symmetric positive definite, far from diagonally dominant, and in units that differ as metres and radians do."""
    rng = np.random.default_rng(n)
    A = 1e-3 * np.eye(n)
    for first in range(0, n - GROUP + 1, BLOCK_SIZE):
        root = rng.normal(size=(GROUP, 4))
        A[first : first + GROUP, first : first + GROUP] += root @ root.T
    units = np.where(np.arange(n) % BLOCK_SIZE > 2, 1e-2, 1e2)
    A, b = units[:, None] * A * units, units * rng.normal(size=n)
    x = solved(factors_of(A), b)
    backward = np.abs(A @ x - b) / (np.abs(A) @ np.abs(x))
    assert backward.max() < 1e-12
    np.testing.assert_allclose(units * x, units * np.linalg.solve(A, b), rtol=1e-9, atol=1e-9 * np.abs(units * x).max())


@pytest.mark.parametrize("n", SIZES)
def test_nothing_beyond_the_arrays_is_read_or_written(n):
    A, b = dominant(n, n)
    around = np.full((n + B + 40, BAND_COLUMNS), np.nan)
    band, factors, x = (np.full(shape, np.nan) for shape in (around.shape, around.shape, n + 40))
    band[20 : 20 + n + B], x[20 : 20 + n] = banded(A), b
    lu_factor(band[20 : 20 + n + B], factors[20 : 20 + n + B])
    lu_solve(factors[20 : 20 + n + B], x[20 : 20 + n])
    np.testing.assert_allclose(A @ x[20 : 20 + n], b, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(band[20 : 20 + n + B], banded(A))
    for array in (band, factors):
        assert np.isnan(array[:20]).all()
        assert np.isnan(array[20 + n + B :]).all()
    assert np.isnan(x[:20]).all()
    assert np.isnan(x[20 + n :]).all()


@pytest.mark.parametrize("alone", range(4 * BLOCK_SIZE))
@pytest.mark.parametrize("pair", [(0, 1), (3, 4), (4, 5), (1, 12), (8, 9), (9, 11), (15, 16), (18, 19)])
def test_a_coordinate_that_nothing_holds_stays(alone, pair):
    """A singular system with a solution: a roll that neither mass nor spring holds, or none after elimination."""
    n = 4 * BLOCK_SIZE
    A, b = dominant(n, 1)
    i, j = pair
    for k in {alone, i, j}:
        A[k], A[:, k], b[k] = 0.0, 0.0, 0.0
    if alone not in pair:
        A[np.ix_(pair, pair)] = 1.0
        b[[i, j]] = 2.0
    x = solved(factors_of(A), b)
    np.testing.assert_allclose(A @ x, b, rtol=1e-10, atol=1e-12)
    assert x[alone] == 0.0
    assert x[j] == 0.0


@pytest.mark.parametrize("size", [0.5, 2.0])
@pytest.mark.parametrize("k", range(10, 15))
def test_a_pivot_vanishes_beside_its_diagonal_entry_only(k, size):
    """What elimination leaves of it is compared with what it was."""
    n = 4 * BLOCK_SIZE
    A = np.eye(n)
    A[k - 7, k] = A[k, k - 7] = 1.0
    A[k, k] += size * 1e-14
    x = solved(factors_of(A), np.eye(n)[k])
    left = A[k, k] - 1.0
    assert x[k] == (pytest.approx(1.0 / left, rel=1e-10) if left > 1e-14 * A[k, k] else 0.0)


@pytest.mark.parametrize("place", [(3, 3), (7, 7), (7, 9), (9, 7), (13, 5), (5, 13), (19, 19)])
def test_nan_is_passed_on(place):
    """It reaches the solution; later matrices do not know of it."""
    A, b = dominant(20, 2)
    bad = A.copy()
    bad[place] = np.nan
    factors = factors_of(bad)
    assert np.isnan(solved(factors, b)[place[0]])
    lu_factor(banded(A), factors)
    np.testing.assert_allclose(A @ solved(factors, b), b, rtol=1e-10, atol=1e-12)
