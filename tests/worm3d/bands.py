"""Matrices in bands, as `worm3d.machine.banded` keeps them, and whole."""

import numpy as np

from worm3d.machine.banded import BAND_COLUMNS, B


def banded(whole: np.ndarray) -> np.ndarray:
    """Return the band of a matrix, shape (n + B, BAND_COLUMNS)."""
    band = np.zeros((len(whole) + B, BAND_COLUMNS))
    for i, row in enumerate(whole):
        for j in range(max(0, i - B), min(len(whole), i + B + 1)):
            band[i, B + j - i] = row[j]
    return band


def dense(band: np.ndarray) -> np.ndarray:
    """Return the matrix of a band of n rows, shape (n, n)."""
    size = len(band)
    matrix = np.zeros((size, size))
    for i in range(size):
        for j in range(max(0, i - B), min(size, i + B + 1)):
            matrix[i, j] = band[i, B + j - i]
    return matrix
