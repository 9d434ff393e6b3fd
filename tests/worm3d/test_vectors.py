"""Vector instructions on addresses against numpy."""

import numpy as np
import pytest
from numba import njit

from worm3d import vectors


@njit
def _transpose(to: int, to_stride: int, source: int, stride: int) -> None:
    vectors.transpose(to, to_stride, source, stride)


@njit
def _sums(eight: int, sixteen: int, less: int, source: int) -> None:
    vectors.add_8(eight, source)
    vectors.add_16(sixteen, source)
    vectors.subtract_8(less, source)


@njit
def _move_and_clear(to: int, source: int, count: int, empty: int, size: int) -> None:
    vectors.move(to, source, count)
    vectors.clear(empty, size)


@njit
def _total(source: int, count: int) -> float:
    return float(vectors.total(source, count))


def at(array: np.ndarray, index: int = 0) -> int:
    return array.ctypes.data + 8 * index


def test_transpose_writes_rows_as_columns():
    source, to = np.random.default_rng(0).normal(size=(9, 11)), np.full((10, 13), 7.0)
    _transpose(at(to, 14), 13, at(source, 12), 11)
    np.testing.assert_array_equal(to[1:9, 1:9], source[1:9, 1:9].T)
    to[1:9, 1:9] = 7.0
    assert (to == 7.0).all(), "and nothing else"


def test_sums_change_their_own_places_only():
    source, before = np.arange(1.0, 25.0), np.linspace(0.0, 1.0, 24)
    eight, sixteen, less = before.copy(), before.copy(), before.copy()
    _sums(at(eight, 2), at(sixteen, 2), at(less, 2), at(source, 1))
    for after, count, sign in ((eight, 8, 1.0), (sixteen, 16, 1.0), (less, 8, -1.0)):
        expected = before.copy()
        expected[2 : 2 + count] += sign * source[1 : 1 + count]
        np.testing.assert_array_equal(after, expected)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 41])
def test_move_and_clear_take_as_many_as_they_are_told(count):
    source, to, empty = np.arange(50.0), np.zeros(50), np.ones(50)
    _move_and_clear(at(to), at(source), count, at(empty), count)
    np.testing.assert_array_equal(to, np.where(np.arange(50) < count, source, 0.0))
    np.testing.assert_array_equal(empty, np.arange(50) >= count)


@pytest.mark.parametrize("count", [0, 1, 5, 8, 9, 24, 31])
def test_total_ignores_what_stands_behind(count):
    values = np.random.default_rng(count).normal(size=40)
    values[count:] = np.nan
    assert _total(at(values), count) == pytest.approx(values[:count].sum(), rel=1e-14, abs=1e-15)
