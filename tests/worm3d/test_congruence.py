"""J^T K J added to a matrix in bands, against numpy."""

import numpy as np

from worm3d.machine.compiled import njit
from worm3d.machine.vectors import add_congruent


@njit
def _add(to: int, pitch: int, jacobian: int, more: int, stride: int) -> None:
    add_congruent(to, pitch, jacobian, more, stride)


def at(array: np.ndarray, place: int) -> int:
    return int(array.ctypes.data + 8 * place)


def test_a_congruent_matrix_is_added_to_the_rows_of_a_band() -> None:
    """Rows of 16, in each of which it begins one number earlier than in the row above."""
    rng = np.random.default_rng(5)
    J, K = rng.normal(size=(3, 8)), rng.normal(size=(3, 3))
    band, numbers = rng.normal(size=(10, 16)), rng.normal(size=(9, 5))
    numbers[:, 2] = K.ravel()
    expected = band.copy()
    for r, row in enumerate(J.T @ K @ J):
        expected[1 + r, 8 - r : 16 - r] += row
    _add(at(band, 16 + 8), 8 * 15, at(J, 0), at(numbers, 2), 8 * 5)
    np.testing.assert_allclose(band, expected, rtol=0, atol=1e-14)
    outside = np.ones(band.shape, dtype=bool)
    for r in range(8):
        outside[1 + r, 8 - r : 16 - r] = False
    np.testing.assert_array_equal(band[outside], expected[outside])
