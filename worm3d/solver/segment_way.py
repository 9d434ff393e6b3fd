"""One segment whose length follows a given motion, compiled. Masses, weight and contact are left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.codegen import evaluate
from worm3d.machine.compiled import njit
from worm3d.physics.kernels import actuator, segment
from worm3d.values.arrays import FloatArray

KERNELS = ("segment_gradient", "segment_ledger", "actuator_end")
"""Kernels that `follow` calls."""

_HEAD = 5
"""Index of the x coordinate of the segment's front joint."""

_Q, _DQ, _LINK, _SPAN, _DT = segment.SEGMENT_LAYOUT.firsts("q", "dq", "link", "span", "dt")
_LENGTH_N, _ANGLE_N = segment.SEGMENT_LAYOUT.firsts("length_n", "angle_n")
_LENGTH_HAT, _ANGLE_HAT = segment.SEGMENT_LAYOUT.firsts("length_hat", "angle_hat")
_ELASTIC, _VISCOUS = (segment.LEDGER_TERMS.index(name) for name in ("elastic", "viscous_loss"))
_GIVES, _RUBS = (actuator.LEDGER_TERMS.index(name) for name in ("elastic", "hysteresis_loss"))
_STATES_OUT = actuator.LEDGER_ROWS + actuator.ACTUATORS_PER_SEGMENT


@njit
def follow(
    addresses: NDArray[np.int64],
    rows: FloatArray,
    slope: FloatArray,
    terms: FloatArray,
    end: FloatArray,
    places: tuple[int, int, int],
    hinged: bool,
    lengths: FloatArray,
    steps: FloatArray,
    found: FloatArray,
) -> None:
    """Fill `found` with forces and energies for a sequence of lengths.

    Parameters
    ----------
    addresses : ndarray of int, shape (3,)
        Addresses of `KERNELS`. The last address is used only if `states` is not 0.
    rows : ndarray, shape (R, lanes)
        Inputs of a segment along the x axis and of its friction, in the first lane.
    slope, terms, end : ndarray
        Outputs of the kernels (working memory).
    places : tuple of int
        Number of rows of the inputs of a segment with its segment law; first row of the states at the start of a step;
        number of states of the friction in the joints of a chamber. A first-order actuator has no states.
    hinged : bool
        Whether the angle of a chamber is the angle of its apex hinges. Otherwise the angle is the bend, which is 0.
    lengths, steps : ndarray, shape (T,)
        Lengths of the segment [m], and the time from the previous length to each length [s].
    found : ndarray, shape (4, T)
        Force [N], change of elastic energy, viscous loss, and loss to friction in the joints [J] at each length.
    """
    of_segment, first_state, states = places
    for k, length in enumerate(lengths):
        length_n = lengths[max(k - 1, 0)]
        angle_n = 2.0 * np.arcsin(length_n / (2.0 * rows[_LINK, 0])) if hinged else 0.0
        for side in range(actuator.ACTUATORS_PER_SEGMENT):
            rows[_LENGTH_N + side, 0] = rows[_LENGTH_HAT + side, 0] = length_n
            rows[_ANGLE_N + side, 0] = rows[_ANGLE_HAT + side, 0] = angle_n
        rows[_SPAN, 0] = rows[_DT, 0] = steps[k]
        rows[_Q + _HEAD, 0], rows[_DQ + _HEAD, 0] = length, length - length_n
        evaluate(addresses[0], rows, slope, 1)
        evaluate(addresses[1], rows[:of_segment], terms, 1)
        found[0, k], found[1, k], found[2, k] = slope[1 + _HEAD, 0], terms[_ELASTIC, 0], terms[_VISCOUS, 0]
        if states > 0:
            evaluate(addresses[2], rows, end, 1)
            found[1, k] += end[_GIVES, 0]
            found[3, k] = end[_RUBS, 0]
            for state in range(actuator.ACTUATORS_PER_SEGMENT * states):
                rows[first_state + state, 0] = end[_STATES_OUT + state, 0]
