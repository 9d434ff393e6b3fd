"""Vector instructions on addresses against numpy."""

import numpy as np
import pytest

from worm3d.machine import vectors
from worm3d.machine.compiled import njit


@njit
def _transpose(to: int, to_stride: int, source: int, stride: int) -> None:
    vectors.transpose(to, to_stride, source, stride)


@njit
def _sums(eight: int, source: int) -> None:
    vectors.add_rows(eight, 8, source, 8, 1)


@njit
def _move_and_clear(to: int, source: int, count: int, empty: int, size: int) -> None:
    vectors.move(to, source, count)
    vectors.clear(empty, size)


@njit
def _totals(to: int, source: int, stride: int, count: int) -> None:
    vectors.totals(to, source, stride, count)


@njit
def _greatest(source: int, count: int) -> float:
    return float(vectors.greatest(source, count))


@njit
def _repeat(to: int, stride: int, source: int) -> None:
    vectors.repeat_8(to, stride, source)


@njit
def _transpose_places(to: int, to_stride: int, source: int, stride: int) -> None:
    vectors.transpose_places(to, to_stride, source, stride)


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


def test_transpose_places_writes_the_axes_of_each_point_together():
    source, to = np.random.default_rng(0).normal(size=(24, 11)), np.full((10, 27), 7.0)
    _transpose_places(at(to, 28), 27, at(source, 2), 11)
    expected = source[:, 2:10].reshape(3, 8, 8).transpose(2, 1, 0)  # axis, point, lane
    np.testing.assert_array_equal(to[1:9, 1:25], expected.reshape(8, 24))
    to[1:9, 1:25] = 7.0
    assert (to == 7.0).all(), "and nothing else"


def test_repeat_writes_a_vector_into_eight_rows():
    source, to = np.arange(1.0, 12.0), np.zeros((9, 10))
    _repeat(at(to, 1), 10, at(source, 2))
    np.testing.assert_array_equal(to[:8, 1:9], np.tile(source[2:10], (8, 1)))
    to[:8, 1:9] = 0.0
    assert not to.any(), "and nothing else"


def test_sums_change_their_own_places_only():
    source, before = np.arange(1.0, 25.0), np.linspace(0.0, 1.0, 24)
    eight, expected = before.copy(), before.copy()
    _sums(at(eight, 2), at(source, 1))
    expected[2:10] += source[1:9]
    np.testing.assert_array_equal(eight, expected)


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


@pytest.mark.parametrize("count", [0, 1, 5, 8, 9, 24, 31])
def test_totals_are_those_of_eight_rows(count):
    values, sums = np.random.default_rng(count).normal(size=(8, 43)), np.full(10, 7.0)
    values[:, count:] = np.nan
    _totals(at(sums, 1), at(values), 43, count)
    np.testing.assert_allclose(sums[1:9], values[:, :count].sum(axis=1), rtol=1e-14, atol=1e-15)
    assert sums[0] == sums[9] == 7.0


@pytest.mark.parametrize("place", [0, 3, 7, 8, 21])
def test_greatest_is_found_wherever_it_stands(place):
    values = np.random.default_rng(place).uniform(-1.0, 1.0, 24)
    values[place] = 2.0
    assert _greatest(at(values), 24) == 2.0
    assert _greatest(at(values - 5.0), 24) == 0.0
