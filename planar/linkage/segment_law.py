"""Segment laws: energy and half-height of a segment as functions of its length and its command.

In the plane, both chambers of a segment coincide. A segment has the length l, the length at rest l0, the commanded
length l_cmd = l0 (1 - c) and the half-height h, and s = 1 - l/l_cmd. The segment laws are

    rhombus     U = s^2 k l0/2                     h = sqrt(a^2 - l^2/4), and apex hinges (`planar.linkage`)
    hydrostat   U = s^2 k l0/2                     h = h0 sqrt(l0/l), constant volume                        (PL1)
    learned     U = s^2 (k l0/2 + 2 E N_U(x, y))   h = R_mid + R_scale N_R(x, y)                             (PL2)
                x = (l/l0 - x_mid)/x_half          y = (c - y_mid)/y_half

N_U and N_R are feed-forward networks with the activation f(v) = v/sqrt(1 + v^2) and with 6 neurons in each hidden
layer: N_U has two hidden layers, N_R has one. The weights of a network are stored layer by layer, first the matrix row
by row, then the constants. Each damper of a length has the constant tau k/l0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

RHOMBUS, HYDROSTAT, LEARNED = 0, 1, 2
"""Kinds of segment laws."""

NEURONS = 6
"""Number of neurons in a hidden layer of a network."""
ENERGY_LAYERS, RADIUS_LAYERS = 2, 1
"""Numbers of hidden layers of N_U and N_R."""


class SegmentLaw(NamedTuple):
    """Constants of the segments' law, for the compiled functions. Only a learned law uses scales and weights."""

    kind: int
    l0: float
    k_spring: FloatArray
    """(N,)"""
    link_length: FloatArray
    """(N,) length a of the links of a rhombus."""
    half_height: FloatArray
    """(N,) h0."""
    scales: FloatArray
    """(7,) x_mid, x_half, y_mid, y_half, E, R_mid and R_scale of (PL2)."""
    energy: FloatArray
    """(67,) weights of N_U."""
    radius: FloatArray
    """(25,) weights of N_R."""


@njit
def network(
    weights: FloatArray, layers: int, x: float, y: float, along_x: float, along_y: float
) -> tuple[float, float, float]:
    """Return the value of a network with `layers` hidden layers, and the first two derivatives along a direction."""
    value, first, second = np.zeros(NEURONS), np.zeros(NEURONS), np.zeros(NEURONS)
    value[0], value[1], first[0], first[1] = x, y, along_x, along_y
    v, v1, v2 = np.empty(NEURONS), np.empty(NEURONS), np.empty(NEURONS)
    given, at = 2, 0
    for layer in range(layers + 1):
        rows = 1 if layer == layers else NEURONS
        for r in range(rows):
            v[r], v1[r], v2[r] = weights[at + rows * given + r], 0.0, 0.0
            for c in range(given):
                weight = weights[at + r * given + c]
                v[r] += weight * value[c]
                v1[r] += weight * first[c]
                v2[r] += weight * second[c]
        if layer == layers:
            return v[0], v1[0], v2[0]
        for r in range(rows):
            f = 1.0 / np.sqrt(1.0 + v[r] * v[r])  # f' = f^3, f'' = -3 v f^5 with this f
            value[r], first[r] = v[r] * f, f**3 * v1[r]
            second[r] = f**3 * v2[r] - 3.0 * v[r] * f**5 * v1[r] * v1[r]
        given, at = rows, at + rows * (given + 1)
    return np.nan, np.nan, np.nan  # never reached


@njit
def _scaled(length: float, l_cmd: float, law: SegmentLaw) -> tuple[float, float]:
    """Return x and y of (PL2)."""
    scales = law.scales
    return (length / law.l0 - scales[0]) / scales[1], (1.0 - l_cmd / law.l0 - scales[2]) / scales[3]


@njit
def spring(i: int, length: float, l_cmd: float, law: SegmentLaw) -> tuple[float, float, float]:
    """Return U of segment i without apex hinges, dU/dl and d2U/dl2."""
    k, l0, stretch = law.k_spring[i], law.l0, 1.0 - length / l_cmd
    if law.kind != LEARNED:
        return 0.5 * k * l0 * stretch**2, -k * l0 / l_cmd * stretch, k * l0 / l_cmd**2
    x, y = _scaled(length, l_cmd, law)
    n, n1, n2 = network(law.energy, ENERGY_LAYERS, x, y, 1.0 / (l0 * law.scales[1]), 0.0)
    stiff, twice = 0.5 * k * l0 + 2.0 * law.scales[4] * n, 2.0 * law.scales[4]
    return (
        stretch**2 * stiff,
        -2.0 * stretch / l_cmd * stiff + stretch**2 * twice * n1,
        2.0 / l_cmd**2 * stiff - 4.0 * stretch / l_cmd * twice * n1 + stretch**2 * twice * n2,
    )


@njit
def half_height(i: int, length: float, l_cmd: float, law: SegmentLaw) -> tuple[float, float, float]:
    """Return h of segment i without links, dh/dl and d2h/dl2."""
    if law.kind == HYDROSTAT:
        h = law.half_height[i] * np.sqrt(law.l0 / length)
        return h, -0.5 * h / length, 0.75 * h / length**2
    x, y = _scaled(length, l_cmd, law)
    n, n1, n2 = network(law.radius, RADIUS_LAYERS, x, y, 1.0 / (law.l0 * law.scales[1]), 0.0)
    return law.scales[5] + law.scales[6] * n, law.scales[6] * n1, law.scales[6] * n2


@njit
def _widening(length: float, l_cmd: float, law: SegmentLaw) -> float:
    """Return dh/dl_cmd at a constant length; only the half-height of a learned law depends on the command."""
    if law.kind != LEARNED:
        return 0.0
    x, y = _scaled(length, l_cmd, law)
    _, slope, _ = network(law.radius, RADIUS_LAYERS, x, y, 0.0, -1.0 / (law.l0 * law.scales[3]))
    widening: float = law.scales[6] * slope
    return widening


@njit
def slenderness(i: int, square: float, l_cmd: float, law: SegmentLaw) -> tuple[float, float, float]:
    """Return w = h/l of segment i, dw/ds and d2w/ds2 with s = l^2 = `square`, for (K1) and (K2)."""
    if law.kind == RHOMBUS:
        a = law.link_length[i]
        w = np.sqrt(max(a * a / square - 0.25, 0.0))
        w1 = -a * a / (2.0 * square * square * w)
        return w, w1, (a * a / (square * square * square) - w1 * w1) / w
    length = np.sqrt(square)
    h, h1, h2 = half_height(i, length, l_cmd, law)
    w = h / length
    along = (h1 - w) / length  # dw/dl
    curve = (h2 - 2.0 * along) / length  # d2w/dl2
    return w, 0.5 * along / length, 0.25 * (curve - along / length) / square


@njit
def has_shape(i: int, square: float, law: SegmentLaw) -> bool:
    """Return whether segment i with the squared length `square` has a shape: its links reach, and it is not a point."""
    low, high = 1e-8 * law.l0**2, np.inf
    if law.kind == RHOMBUS:
        low, high = 1e-8 * law.link_length[i] ** 2, 4.0 * law.link_length[i] ** 2 * (1.0 - 1e-12)
    return bool(low < square < high)


class Values(NamedTuple):
    """Values of a segment law for many segments and instants, each array of the same shape."""

    energy: FloatArray
    """U without apex hinges [J]."""
    tension: FloatArray
    """dU/dl [N]."""
    height: FloatArray
    """h [m]; NaN for a rhombus, for which `planar.linkage.shape` has the formula."""
    along: FloatArray
    """dh/dl; NaN for a rhombus."""
    widening: FloatArray
    """dh/dl_cmd."""


def values(length: FloatArray, l_cmd: FloatArray | float, law: SegmentLaw) -> Values:
    """Return the values of a segment law for lengths and commanded lengths of the shape (..., N) [m]."""
    both = np.array(np.broadcast_arrays(length, l_cmd))
    out = np.full((len(Values._fields), length.size), np.nan)
    _fill(both[0].ravel(), both[1].ravel(), law, out)
    return Values(*out.reshape(-1, *length.shape))


@njit
def _fill(length: FloatArray, l_cmd: FloatArray, law: SegmentLaw, out: FloatArray) -> None:
    segments = len(law.k_spring)
    for k in range(len(length)):
        i = k % segments
        out[0, k], out[1, k], _ = spring(i, length[k], l_cmd[k], law)
        out[4, k] = _widening(length[k], l_cmd[k], law)
        if law.kind != RHOMBUS:
            out[2, k], out[3, k], _ = half_height(i, length[k], l_cmd[k], law)
