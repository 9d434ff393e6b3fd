"""The compiled mesh: distance by the tricubic spline of a grid of signed distances.

With the spline d(X), its gradient and Hessian, m = |grad d| (1 but for the grid's errors) and a cell as unit,

    g = psi d,    psi = 1 + (1/max(m, 1/2) - 1) phi,    phi = (1 + (d/w)^2)^-2                        (M1)

so that the gradient of g is a unit vector on the surface d = 0, which (M1) does not move, and g is d a cell away from
it, also beside edges, where the spline is rounded and m is small. Of the Hessian of g the terms that vanish with d are
left out. Where the nearest coefficient says that the point is farther outside than `CONTACT`, a parameter, d is read
linearly between the coefficients: it only tells how far away the surface is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.codegen.emit import FINE, WRONG_SHAPE
from worm3d.compiled import inner
from worm3d.worlds import table
from worm3d.worlds.table import Jet, Weights

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

CONTACT = 2.8
"""Cells: the point is then a cell from the surface at least, as the node before it is at most sqrt(3) away."""

NARROW = 0.2
"""w of (M1), in cells."""

ROWS_IN, ROWS_OUT = 3 + 12, 11
"""Point; address of coefficients (2), nodes along each axis, first node, cell, side of the solid, grip, `CONTACT`."""

_COEFFICIENTS, _NODES, _FIRST, _CELL, _SIDE, _GRIP, _CONTACT = 3, 5, 8, 11, 12, 13, 14

Place = tuple[int, float, float, float]
"""Number of the node before a place, and the way from there along each axis."""


@inner
def _row(c: SingleArray, k: int, w: Weights, w_1: Weights, w_2: Weights) -> tuple[float, float, float]:
    """Return value and derivatives of a row of four coefficients."""
    a, b, d, e = np.float64(c[k]), np.float64(c[k + 1]), np.float64(c[k + 2]), np.float64(c[k + 3])
    return (
        w[0] * a + w[1] * b + w[2] * d + w[3] * e,
        w_1[0] * a + w_1[1] * b + w_1[2] * d + w_1[3] * e,
        w_2[0] * a + w_2[1] * b + w_2[2] * d + w_2[3] * e,
    )


@inner
def _spline(c: SingleArray, rows: int, columns: int, at: Place) -> Jet:
    """Return value, gradient and Hessian of the spline."""
    node, r, s, t = at
    (u, u_1, u_2), (v, v_1, v_2), (w, w_1, w_2) = table.cubic(r), table.cubic(s), table.cubic(t)
    d = d_x = d_y = d_z = d_xx = d_xy = d_xz = d_yy = d_yz = d_zz = 0.0
    for a in range(4):
        p = p_y = p_z = p_yy = p_yz = p_zz = 0.0
        first = node + ((a - 1) * rows - 1) * columns - 1
        for b in range(4):
            q, q_z, q_zz = _row(c, first + b * columns, w, w_1, w_2)
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
    return d, d_x, d_y, d_z, d_xx, d_xy, d_xz, d_yy, d_yz, d_zz


@inner
def _linear(c: SingleArray, rows: int, columns: int, at: Place) -> Jet:
    """Return what is linear between the nearest coefficients, and its direction of steepest ascent."""
    node, r, s, t = at
    left, ahead = node + columns, node + rows * columns
    both = ahead + columns
    a, b, d, e = np.float64(c[node]), np.float64(c[left]), np.float64(c[ahead]), np.float64(c[both])
    a_z, b_z, d_z, e_z = c[node + 1] - a, c[left + 1] - b, c[ahead + 1] - d, c[both + 1] - e
    low, high, low_z, high_z = a + s * (b - a), d + s * (e - d), a_z + s * (b_z - a_z), d_z + s * (e_z - d_z)
    x, z = high - low + t * (high_z - low_z), low_z + r * (high_z - low_z)
    y = (1.0 - r) * (b - a + t * (b_z - a_z)) + r * (e - d + t * (e_z - d_z))
    size = x * x + y * y + z * z
    unit = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
    value = low + t * low_z + r * (high - low + t * (high_z - low_z))
    return value, x * unit, y * unit, z * unit, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _unit(jet: Jet) -> Jet:
    """Return g of (M1) with gradient and Hessian, given those of d."""
    d, x, y, z, xx, xy, xz, yy, yz, zz = jet
    size = np.sqrt(x * x + y * y + z * z)
    back = 1.0 / max(size, 0.5)
    phi = 1.0 / (1.0 + (d / NARROW) ** 2)
    slope = -4.0 * d / NARROW**2 * phi * phi * phi
    phi *= phi
    psi = 1.0 + (back - 1.0) * phi
    along = psi + d * (back - 1.0) * slope
    turn = phi * back * back * back if size > 0.5 else 0.0
    h_x, h_y, h_z = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
    return (
        psi * d,
        along * x - turn * d * h_x,
        along * y - turn * d * h_y,
        along * z - turn * d * h_z,
        psi * xx - turn * 2.0 * x * h_x,
        psi * xy - turn * (x * h_y + y * h_x),
        psi * xz - turn * (x * h_z + z * h_x),
        psi * yy - turn * 2.0 * y * h_y,
        psi * yz - turn * (y * h_z + z * h_y),
        psi * zz - turn * 2.0 * z * h_z,
    )


@inner
def _beyond(jet: Jet, away: tuple[float, float, float]) -> Jet:
    """Return a distance for a point that is so far beyond the grid, and with it outside the mesh."""
    x, y, z = away
    size = np.sqrt(x * x + y * y + z * z)
    return jet[0] + size, x / size, y / size, z / size, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _outside(place: float, nodes: int) -> float:
    """Return how far a place lies beyond the grid, signed, in nodes."""
    return min(place - 1.0, 0.0) + max(place - (nodes - 2.0), 0.0)


@inner
def look(c: SingleArray, nodes: tuple[int, int, int], x: float, y: float, z: float, side: float, contact: float) -> Jet:
    """Return distance, normal and curvature at a place in nodes, a cell as unit, but for the side of the solid."""
    i, r = table.cell(x, nodes[0])
    j, s = table.cell(y, nodes[1])
    k, t = table.cell(z, nodes[2])
    node = (i * nodes[1] + j) * nodes[2] + k
    at = node, r, s, t
    far = side * c[node] > contact
    jet = _linear(c, nodes[1], nodes[2], at) if far else _unit(_spline(c, nodes[1], nodes[2], at))
    away = _outside(x, nodes[0]), _outside(y, nodes[1]), _outside(z, nodes[2])
    if away[0] != 0.0 or away[1] != 0.0 or away[2] != 0.0:
        return _beyond(jet, away)
    return jet


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
    side, grip, contact = p[_SIDE, 0], p[_GRIP, 0], p[_CONTACT, 0]
    share = 1.0 / cell
    for k in range(count):
        if table.repeats(p, k):
            table.repeat(out, k)
            continue
        jet = look(c, nodes, (p[0, k] - x_0) * share, (p[1, k] - y_0) * share, (p[2, k] - z_0) * share, side, contact)
        table.write(out, k, jet, side * cell, side, side * share, grip)
    return FINE
