"""Small feed-forward networks, for numbers, arrays and CasADi symbols.

The activation is f(v) = v/sqrt(1 + v^2). In the kernels, this function and its derivatives need only arithmetic and a
square root, which are computed for eight segments at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

ENERGY_SIZES, RADIUS_SIZES = (2, 6, 6, 1), (2, 6, 1)
"""Numbers of units of each layer of the networks N_U and N_R of a learned segment law."""


def weights_of(sizes: Sequence[int]) -> int:
    """Return the number of weights of a network: a matrix and a vector for each layer after the first."""
    return sum((given + 1) * units for given, units in pairwise(sizes))


def network(weights: Any, sizes: Sequence[int], inputs: Sequence[Any]) -> Any:
    """Return the output of a network with one output. The last layer is linear.

    Parameters
    ----------
    weights : ndarray or SX, shape (W,)
        For each layer, the matrix row by row, then the vector.
    sizes : sequence of int
        Number of units of each layer, inputs first.
    inputs : sequence of number, ndarray or SX
    """
    values, at = list(inputs), 0
    for k, (given, units) in enumerate(pairwise(sizes)):
        bias = at + given * units
        sums = [
            sum((weights[at + given * row + c] * value for c, value in enumerate(values)), weights[bias + row])
            for row in range(units)
        ]
        values, at = sums if k == len(sizes) - 2 else [_activation(each) for each in sums], bias + units
    return values[0]


def _activation(v: Any) -> Any:
    return v / (1.0 + v * v) ** 0.5
