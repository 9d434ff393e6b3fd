"""The compiled mesh: distance by the tricubic spline of a grid of signed distances.

With the spline d(X), its gradient and Hessian, m = |grad d| (1 but for the grid's errors) and a cell as unit,

    g = psi d,    psi = 1 + (1/max(m, 1/2) - 1) phi,    phi = (1 + (d/w)^2)^-2                        (M1)

so that the gradient of g is a unit vector on the surface d = 0, which (M1) does not move, and g is d a cell away from it,
also beside edges, where the spline is rounded and m is small. Of the Hessian of g the terms that vanish with d are left
out. More than `BAND` cells outside g is read linearly between the spline's coefficients: it only tells how far it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.codegen.emit import FINE, WRONG_SHAPE
from worm3d.compiled import inner
from worm3d.worlds import table
from worm3d.worlds.table import Weights

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

BAND = 2.0
"""Cells outside the surface from which on distances are read linearly."""

NARROW = 0.2
"""w of (M1), in cells."""

ROWS_IN, ROWS_OUT = 3 + 11, 11
"""Point; address of coefficients (2), nodes along each axis, first node, cell, side of the solid, grip."""

_COEFFICIENTS, _NODES, _FIRST, _CELL, _SIDE, _GRIP = 3, 5, 8, 11, 12, 13


@inner
def _row(c: SingleArray, k: int, w: Weights, w_1: Weights, w_2: Weights) -> tuple[float, float, float]:
    """Return value and derivatives of a row of four coefficients."""
    a, b, d, e = c[k], c[k + 1], c[k + 2], c[k + 3]
    return (
        w[0] * a + w[1] * b + w[2] * d + w[3] * e,
        w_1[0] * a + w_1[1] * b + w_1[2] * d + w_1[3] * e,
        w_2[0] * a + w_2[1] * b + w_2[2] * d + w_2[3] * e,
    )


@inner
def _spline(out: FloatArray, k: int, c: SingleArray, nodes: tuple[int, int, int], x: float, y: float, z: float) -> None:
    """Write value, gradient and Hessian of the spline at a place in nodes as rows 0 to 9 of lane k."""
    i, r = table.cell(x, nodes[0])
    j, s = table.cell(y, nodes[1])
    l, t = table.cell(z, nodes[2])
    (u, u_1, u_2), (v, v_1, v_2), (w, w_1, w_2) = table.cubic(r), table.cubic(s), table.cubic(t)
    d = d_x = d_y = d_z = d_xx = d_xy = d_xz = d_yy = d_yz = d_zz = 0.0
    for a in range(4):
        p = p_y = p_z = p_yy = p_yz = p_zz = 0.0
        first = ((i - 1 + a) * nodes[1] + j - 1) * nodes[2] + l - 1
        for b in range(4):
            q, q_z, q_zz = _row(c, first + b * nodes[2], w, w_1, w_2)
            p += v[b] * q
            p_y += v_1[b] * q
            p_yy += v_2[b] * q
            p_z += v[b] * q_z
            p_yz += v_1[b] * q_z
            p_zz += v[b] * q_zz
        d += u[a] * p
        d_x += u_1[a] * p
        d_xx += u_2[a] * p
        d_y += u[a] * p_y
        d_xy += u_1[a] * p_y
        d_yy += u[a] * p_yy
        d_z += u[a] * p_z
        d_xz += u_1[a] * p_z
        d_yz += u[a] * p_yz
        d_zz += u[a] * p_zz
    out[0, k], out[1, k], out[2, k], out[3, k] = d, d_x, d_y, d_z
    out[4, k], out[5, k], out[6, k], out[7, k], out[8, k], out[9, k] = d_xx, d_xy, d_xz, d_yy, d_yz, d_zz


@inner
def _linear(out: FloatArray, k: int, c: SingleArray, nodes: tuple[int, int, int], x: float, y: float, z: float) -> None:
    """Write what is linear between the nearest coefficients, and unit gradient, likewise."""
    i, r = table.cell(x, nodes[0])
    j, s = table.cell(y, nodes[1])
    l, t = table.cell(z, nodes[2])
    near = (i * nodes[1] + j) * nodes[2] + l
    far = near + nodes[1] * nodes[2]
    low, low_y = (1.0 - t) * c[near] + t * c[near + 1], (1.0 - t) * c[near + nodes[2]] + t * c[near + nodes[2] + 1]
    high, high_y = (1.0 - t) * c[far] + t * c[far + 1], (1.0 - t) * c[far + nodes[2]] + t * c[far + nodes[2] + 1]
    up = (1.0 - r) * ((1.0 - s) * (c[near + 1] - c[near]) + s * (c[near + nodes[2] + 1] - c[near + nodes[2]]))
    up += r * ((1.0 - s) * (c[far + 1] - c[far]) + s * (c[far + nodes[2] + 1] - c[far + nodes[2]]))
    ahead, left = (1.0 - s) * (high - low) + s * (high_y - low_y), (1.0 - r) * (low_y - low) + r * (high_y - high)
    size = np.sqrt(ahead * ahead + left * left + up * up)
    size = size if size > 0.0 else 1.0
    out[0, k] = (1.0 - r) * ((1.0 - s) * low + s * low_y) + r * ((1.0 - s) * high + s * high_y)
    out[1, k], out[2, k], out[3, k] = ahead / size, left / size, up / size
    for row in range(6):
        out[4 + row, k] = 0.0


@inner
def _unit(out: FloatArray, k: int) -> None:
    """Turn d, its gradient and Hessian in rows 0 to 9 into those of g (M1)."""
    d, x, y, z = out[0, k], out[1, k], out[2, k], out[3, k]
    size = np.sqrt(x * x + y * y + z * z)
    m = max(size, 0.5)
    square = (d / NARROW) ** 2
    phi = 1.0 / (1.0 + square) ** 2
    slope = -4.0 * d / NARROW**2 / (1.0 + square) ** 3
    psi = 1.0 + (1.0 / m - 1.0) * phi
    along = psi + d * (1.0 / m - 1.0) * slope
    turn = phi / m**3 if size > 0.5 else 0.0
    xx, xy, xz, yy, yz, zz = out[4, k], out[5, k], out[6, k], out[7, k], out[8, k], out[9, k]
    h_x, h_y, h_z = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
    out[0, k] = psi * d
    out[1, k], out[2, k], out[3, k] = along * x - turn * d * h_x, along * y - turn * d * h_y, along * z - turn * d * h_z
    out[4, k] = psi * xx - turn * 2.0 * x * h_x
    out[5, k] = psi * xy - turn * (x * h_y + y * h_x)
    out[6, k] = psi * xz - turn * (x * h_z + z * h_x)
    out[7, k] = psi * yy - turn * 2.0 * y * h_y
    out[8, k] = psi * yz - turn * (y * h_z + z * h_y)
    out[9, k] = psi * zz - turn * 2.0 * z * h_z


@inner
def _outside(place: float, nodes: int) -> float:
    """Return how far a place lies beyond the grid, signed, in nodes."""
    return min(place - 1.0, 0.0) + max(place - (nodes - 2.0), 0.0)


@inner
def look(out: FloatArray, k: int, c: SingleArray, nodes: tuple[int, int, int], x: float, y: float, z: float, side: float) -> None:
    """Write distance, normal and curvature at a place in nodes as rows 0 to 9 of lane k, a cell as unit."""
    i, _ = table.cell(x, nodes[0])
    j, _ = table.cell(y, nodes[1])
    l, _ = table.cell(z, nodes[2])
    # The nearest coefficient and the distance differ by a cell's diagonal at most, and a little.
    if side * c[(i * nodes[1] + j) * nodes[2] + l] > BAND + 2.0:
        _linear(out, k, c, nodes, x, y, z)
    else:
        _spline(out, k, c, nodes, x, y, z)
        _unit(out, k)
    away_x, away_y, away_z = _outside(x, nodes[0]), _outside(y, nodes[1]), _outside(z, nodes[2])
    away = np.sqrt(away_x * away_x + away_y * away_y + away_z * away_z)
    if away > 0.0:  # beyond the grid, and outside the mesh
        out[0, k] += away
        out[1, k], out[2, k], out[3, k] = away_x / away, away_y / away, away_z / away
    for r in range(10):
        out[r, k] *= side


def mesh(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points; the kernel of `Mesh`."""
    if rows_in != ROWS_IN or rows_out != ROWS_OUT or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    p, out = table.doubles(inputs, rows_in, lanes_in), table.doubles(outputs, rows_out, lanes_out)
    if count == 0:
        return FINE
    nodes = int(p[_NODES, 0]), int(p[_NODES + 1, 0]), int(p[_NODES + 2, 0])
    place = table.address(p[_COEFFICIENTS, 0], p[_COEFFICIENTS + 1, 0])
    c = table.singles(place, nodes[0] * nodes[1] * nodes[2])
    x_0, y_0, z_0, cell = p[_FIRST, 0], p[_FIRST + 1, 0], p[_FIRST + 2, 0], p[_CELL, 0]
    side, grip = p[_SIDE, 0], p[_GRIP, 0]
    for k in range(count):
        look(out, k, c, nodes, (p[0, k] - x_0) / cell, (p[1, k] - y_0) / cell, (p[2, k] - z_0) / cell, side)
        out[0, k] *= cell
        for r in range(4, 10):
            out[r, k] /= cell
        out[10, k] = grip
    return FINE
