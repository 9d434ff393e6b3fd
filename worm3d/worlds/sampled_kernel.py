"""The compiled spline of a grid of signed distances: value, normal and Hessian at a point.

The coefficients around each point are collected, and the spline is evaluated for many points at once. If the
coefficient of the node before a point exceeds a limit (a parameter of the kernel, `CONTACT` in a simulation), the point
is far outside. Its distance is then interpolated linearly from this node, which is accurate enough there.

d is the tricubic spline of the signed distances (WS1), with the gradient v, its length m = |v|, and the Hessian D. m
is 1 except for the errors of the grid. The unit of length is a cell. The distance is

    g = psi d,    psi = 1 + (1/max(m, 1/2) - 1) phi,    phi = (1 + (d/w)^2)^-2                       (WM1)

with w = 0.1. (WM1) does not move the surface d = 0, and the gradient of g is a unit vector there. A cell away from the
surface, g is almost equal to d. This holds also beside edges, where the spline is rounded and m is small. As g is a
function of d and v,

    grad g = g_d v + D g_v,    Hess g = g_d D + v (D g_dv)' + (D g_dv) v'                             (WM2)

where g_d, g_v and g_dv are derivatives of g. Terms of the Hessian that vanish with d are left out.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from worm3d.machine.codegen import Kernel, compile_kernel, evaluate
from worm3d.machine.codegen.emit import SHAPES_FIT, WRONG_SHAPE
from worm3d.machine.compiled import inner
from worm3d.values.arrays import FloatArray, SingleArray
from worm3d.worlds import kernels
from worm3d.worlds.kernels import Jet

CONTACT = 2.8
"""Largest coefficient of the node before a point for which the spline is evaluated, in cells. If the coefficient is
larger, the point is at least a cell from the surface, because the node is at most sqrt(3) cells away."""

TOGETHER = 16
"""Number of points evaluated together. It is a multiple of every vector length, and small enough for the data to fit
into the first-level cache."""

WORK_ROWS = 78
"""Number of rows of the working memory, which has `TOGETHER` columns, a column for each point. The rows are the
coefficients around the point (64, contiguous along z), the distance from the node before the point along each axis (3),
the `Jet` (10), and the lane of the point."""

Nodes = tuple[int, int, int]
Cell = tuple[int, float, float, float]
"""Number of the node before a place, and the distance from that node along each axis [cells]."""


@inner
def _cell(nodes: Nodes, x: float, y: float, z: float) -> Cell:
    i, r = kernels.cell(x, nodes[0])
    j, s = kernels.cell(y, nodes[1])
    k, t = kernels.cell(z, nodes[2])
    return (i * nodes[1] + j) * nodes[2] + k, r, s, t


@inner
def _collect(work: FloatArray, n: int, c: SingleArray, nodes: Nodes, at: Cell, lane: int) -> None:
    """Write the inputs of the spline for the point of a lane into column n of the working memory."""
    row, one = np.uint64(0), np.uint64(1)  # unsigned, so that Numba does not check for negative indices
    column = np.uint64(n)
    for a in range(4):
        for b in range(4):
            first = np.uint64(at[0] + ((a - 1) * nodes[1] + b - 1) * nodes[2] - 1)
            for _ in range(4):
                work[row, column] = c[first]
                row += one
                first += one
    work[64, n], work[65, n], work[66, n] = at[1], at[2], at[3]
    work[WORK_ROWS - 1, n] = lane


@inner
def _linear(c: SingleArray, nodes: Nodes, at: Cell) -> Jet:
    """Return the distance interpolated linearly from the node before a point, and the direction of its gradient."""
    node, r, s, t = at
    here = np.float64(c[node])
    x, y, z = c[node + nodes[1] * nodes[2]] - here, c[node + nodes[2]] - here, c[node + 1] - here
    size = x * x + y * y + z * z
    unit = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
    return here + r * x + s * y + t * z, x * unit, y * unit, z * unit, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _outside(place: float, nodes: int) -> float:
    """Return the signed distance of a place from the grid along one axis, 0 inside the grid [cells]."""
    return min(place - 1.0, 0.0) + max(place - (nodes - 2.0), 0.0)


@inner
def _beyond(jet: Jet, nodes: Nodes, x: float, y: float, z: float, straight: float) -> Jet:
    """Return the `jet` of the nearest point of the grid, extended to a place beyond the grid.

    For a place inside the grid, the result is `jet`. If `straight` is 1, the world continues beyond the grid along the
    tangent plane at the nearest point of the grid. If `straight` is 0, the world ends with the grid, and the distance
    from the grid is added.
    """
    x, y, z = _outside(x, nodes[0]), _outside(y, nodes[1]), _outside(z, nodes[2])
    size = np.sqrt(x * x + y * y + z * z)
    if not size > 0.0:
        return jet
    if straight > 0.0:
        return jet[0] + jet[1] * x + jet[2] * y + jet[3] * z, jet[1], jet[2], jet[3], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return jet[0] + size, x / size, y / size, z / size, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _place(p: FloatArray, k: int) -> tuple[float, float, float]:
    """Return the coordinates of point k [cells from node 0]."""
    share = 1.0 / p[15, 0]
    return (p[0, k] - p[12, 0]) * share, (p[1, k] - p[13, 0]) * share, (p[2, k] - p[14, 0]) * share


@inner
def _write(p: FloatArray, out: FloatArray, k: int, jet: Jet, nodes: Nodes) -> None:
    x, y, z = _place(p, k)
    cell, side, grip, straight = p[15, 0], p[16, 0], p[17, 0], p[19, 0]
    kernels.write(out, k, _beyond(jet, nodes, x, y, z, straight), side * cell, side, side / cell, grip)


@inner
def _read(p: FloatArray, out: FloatArray, work: FloatArray, n: int, nodes: Nodes) -> None:
    """Evaluate the spline for the n collected points, and write their rows."""
    found = work[67:77]
    evaluate(kernels.address(p[7, 0], p[8, 0]), work[:67], found, n)
    for m in range(n):
        gradient = found[1, m], found[2, m], found[3, m]
        hessian = found[4, m], found[5, m], found[6, m], found[7, m], found[8, m], found[9, m]
        _write(p, out, int(work[WORK_ROWS - 1, m]), (found[0, m], *gradient, *hessian), nodes)


def sampled(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points. This function is the kernel of a `GridWorld`.

    The rows of the inputs after the point are the addresses of the coefficients, of the working memory and of the
    spline's kernel (2 rows each); the number of nodes along each axis; the coordinates of the first node; the size of a
    cell; the side of the solid (1 or -1); the grip; the limit of the module's docstring; and whether the world
    continues straight beyond the grid.
    """
    if rows_in != 20 or rows_out != kernels.WORLD_ROWS or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    if count == 0:
        return SHAPES_FIT
    p, out = kernels.doubles(inputs, rows_in, lanes_in), kernels.doubles(outputs, rows_out, lanes_out)
    nodes = int(p[9, 0]), int(p[10, 0]), int(p[11, 0])
    c = kernels.singles(kernels.address(p[3, 0], p[4, 0]), nodes[0] * nodes[1] * nodes[2])
    work, side, contact, collected = kernels.table(p, 5, WORK_ROWS, TOGETHER), p[16, 0], p[18, 0], 0
    for k in range(count):
        if not kernels.repeats(p, k):
            x, y, z = _place(p, k)
            at = _cell(nodes, x, y, z)
            if side * c[at[0]] > contact:
                _write(p, out, k, _linear(c, nodes, at), nodes)
            else:
                _collect(work, collected, c, nodes, at, k)
                collected += 1
        if collected == TOGETHER:
            _read(p, out, work, collected, nodes)
            collected = 0
    _read(p, out, work, collected, nodes)
    for k in range(count):
        if kernels.repeats(p, k):
            kernels.repeat(out, k)
    return SHAPES_FIT


def _spline(coefficients: ca.SX, place: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return value, gradient and Hessian of the spline. The sums over the coefficients run along z, then y, then x."""
    cubic: Any = kernels.cubic  # has only arithmetic, and works with symbols and with numbers
    x, y, z = ([ca.vertcat(*weights) for weights in cubic(place[k])] for k in range(3))
    rows = ca.reshape(coefficients, 4, 16).T  # (x, y) by z
    along_z = [ca.reshape(rows @ w, 4, 4).T for w in z]  # x by y
    along_y = {(j, k): along_z[k] @ y[j] for j in range(3) for k in range(3 - j)}

    def contracted(i: int, j: int, k: int) -> Any:
        """Return the derivative of order i, j, k along the axes."""
        return ca.dot(x[i], along_y[j, k])

    xx, xy, xz = contracted(2, 0, 0), contracted(1, 1, 0), contracted(1, 0, 1)
    yy, yz, zz = contracted(0, 2, 0), contracted(0, 1, 1), contracted(0, 0, 2)
    gradient = ca.vertcat(contracted(1, 0, 0), contracted(0, 1, 0), contracted(0, 0, 1))
    hessian = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    return contracted(0, 0, 0), gradient, hessian


def _distance(value: ca.SX, gradient: ca.SX) -> ca.SX:
    """Return g of (WM1) with w = 0.1 cells."""
    phi = 1.0 / (1.0 + (value / 0.1) ** 2) ** 2
    return value * (1.0 + (1.0 / ca.fmax(ca.norm_2(gradient), 0.5) - 1.0) * phi)


@cache
def spline_kernel() -> Kernel:
    """Return the compiled spline."""
    coefficients, place, d, v = ca.SX.sym("c", 64), ca.SX.sym("t", 3), ca.SX.sym("d"), ca.SX.sym("v", 3)
    g = _distance(d, v)
    g_d, g_v = ca.gradient(g, d), ca.gradient(g, v)
    value, gradient, hessian = _spline(coefficients, place)
    parts = ca.Function("parts", [d, v], [g, g_d, g_v, ca.gradient(g_d, v)])
    g, g_d, g_v, g_dv = parts(value, gradient)
    turned = hessian @ g_dv
    normal = g_d * gradient + hessian @ g_v
    curvature = g_d * hessian + gradient @ turned.T + turned @ gradient.T
    rows = ca.vertcat(g, normal, *(curvature[i, j] for i in range(3) for j in range(i, 3)))
    return compile_kernel(ca.Function("grid_spline", [coefficients, place], [ca.densify(rows)]))
