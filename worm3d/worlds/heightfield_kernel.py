"""The compiled heightfield: distance from a bicubic surface z = h(x, y), measured from the foot point.

The foot of a point P is the nearest point of the surface. The surface is S(u, v) = (u, v, h), with N = (-h_u, -h_v, 1)
and J = (S_u, S_v). Newton's method finds the foot from the conditions

    (P - S) . S_u = (P - S) . S_v = 0                                                                (WH1)

and starts at the point of the surface below P. At the foot, n = N/|N| is the unit normal, and I = J'J and
II = Hess(h)/|N| are the first and the second fundamental form. Then

    g = (P - S) . n,     grad g = n,     Hess g = -J I^-1 II (I - g II)^-1 J'                        (WH2)

(do Carmo, Differential Geometry of Curves and Surfaces, 3-3: Weingarten's equations, and the derivative of (WH1)).
Newton's matrix is also I - g II. Where this matrix is not positive definite, P lies beyond a centre of curvature of the
surface, and g is then the distance from the tangent plane at the point below P. If P lies higher above all spline
coefficients around it than a limit (a parameter of the kernel, in cells), P is far from the surface. In this case g is
the distance from a plane through the nearest coefficients, which is accurate enough there.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine.codegen.emit import SHAPES_FIT, WRONG_SHAPE
from worm3d.machine.compiled import inner
from worm3d.values.arrays import FloatArray
from worm3d.worlds import kernels
from worm3d.worlds.kernels import Jet

Height = tuple[float, float, float, float, float, float]
"""Height h of the surface and its derivatives h_u, h_v, h_uu, h_uv, h_vv."""

CONTACT = 0.05
"""The limit of the module's docstring in a simulation, in cells. The foot point is computed for points up to this
height above all coefficients around the point. The surface lies below the largest of these coefficients."""

CLOSE = 1e-5
"""Newton's iteration ends after a step of the foot that is smaller than this, in cells. For this last step, the surface
is taken from a Taylor series. The errors of foot and normal are about the square of this number, and the error of the
distance is about its third power."""


@inner
def height(coefficients: FloatArray, u: float, v: float) -> Height:
    """Return the height [cells] and its derivatives at a place with the coordinates u, v [cells from node 0]."""
    i, s = kernels.cell(u, coefficients.shape[0])
    j, t = kernels.cell(v, coefficients.shape[1])
    (across, across_1, across_2), (along, along_1, along_2) = kernels.cubic(t), kernels.cubic(s)
    h = h_u = h_v = h_uu = h_uv = h_vv = 0.0
    for a in range(4):
        row = row_1 = row_2 = 0.0
        for b in range(4):
            value = coefficients[i - 1 + a, j - 1 + b]
            row += across[b] * value
            row_1 += across_1[b] * value
            row_2 += across_2[b] * value
        h += along[a] * row
        h_u += along_1[a] * row
        h_uu += along_2[a] * row
        h_v += along[a] * row_1
        h_uv += along_1[a] * row_1
        h_vv += along[a] * row_2
    return h, h_u, h_v, h_uu, h_uv, h_vv


@inner
def foot(coefficients: FloatArray, x: float, y: float, z: float, begin: Height) -> tuple[bool, float, float, Height]:
    """Return whether Newton's method found a foot (WH1), the u and v of the foot, and the surface there, in cells.

    `begin` is the surface below the point x, y, z.
    """
    u, v, at = x, y, begin
    gap = (z - at[0]) ** 2
    for _ in range(20):
        up = z - at[0]
        r_u, r_v = x - u + up * at[1], y - v + up * at[2]
        uu, uv, vv = 1.0 + at[1] * at[1] - up * at[3], at[1] * at[2] - up * at[4], 1.0 + at[2] * at[2] - up * at[5]
        if uu <= 0.0 or uu * vv - uv * uv <= 0.0:  # the Gauss-Newton matrix I instead
            uu, uv, vv = 1.0 + at[1] * at[1], at[1] * at[2], 1.0 + at[2] * at[2]
        det = uu * vv - uv * uv
        d_u, d_v = (vv * r_u - uv * r_v) / det, (uu * r_v - uv * r_u) / det
        if abs(d_u) + abs(d_v) < CLOSE:
            return True, u + d_u, v + d_v, _moved(at, d_u, d_v)
        share = 1.0
        for _half in range(6):
            new = height(coefficients, u + share * d_u, v + share * d_v)
            now = (x - u - share * d_u) ** 2 + (y - v - share * d_v) ** 2 + (z - new[0]) ** 2
            if now <= gap * (1.0 + 1e-14) + 1e-28:
                break
            share *= 0.5
        u, v, at, gap = u + share * d_u, v + share * d_v, new, now
    return False, u, v, at


@inner
def _moved(at: Height, d_u: float, d_v: float) -> Height:
    """Return the surface at a small step d_u, d_v from the place of `at`, by a Taylor series."""
    h, h_u, h_v, h_uu, h_uv, h_vv = at
    rise_u, rise_v = h_uu * d_u + h_uv * d_v, h_uv * d_u + h_vv * d_v
    h += (h_u + 0.5 * rise_u) * d_u + (h_v + 0.5 * rise_v) * d_v
    return h, h_u + rise_u, h_v + rise_v, h_uu, h_uv, h_vv


@inner
def _rough(coefficients: FloatArray, u: float, v: float) -> Height:
    """Return an estimate of height and slopes from the four nearest coefficients, without curvature."""
    i, s = kernels.cell(u, coefficients.shape[0])
    j, t = kernels.cell(v, coefficients.shape[1])
    here, ahead = coefficients[i, j], coefficients[i + 1, j]
    left, both = coefficients[i, j + 1], coefficients[i + 1, j + 1]
    h_u, h_v = (1.0 - t) * (ahead - here) + t * (both - left), (1.0 - s) * (left - here) + s * (both - ahead)
    return here + s * (ahead - here) + t * ((1.0 - s) * (left - here) + s * (both - ahead)), h_u, h_v, 0.0, 0.0, 0.0


@inner
def look(coefficients: FloatArray, tops: FloatArray, x: float, y: float, z: float, contact: float) -> Jet:
    """Return distance, normal and Hessian at a point, in units of the spacing of the grid.

    `tops` has the largest coefficient around each cell, and `contact` is the limit of the module's docstring.
    """
    if z > tops[kernels.cell(x, tops.shape[0])[0], kernels.cell(y, tops.shape[1])[0]] + contact:
        below = _rough(coefficients, x, y)
    else:
        below = height(coefficients, x, y)
        found, u, v, at = foot(coefficients, x, y, z, below)
        size = np.sqrt(1.0 + at[1] * at[1] + at[2] * at[2])
        away = (z - at[0] - at[1] * (x - u) - at[2] * (y - v)) / size
        if found and away * (z - below[0]) >= 0.0:
            return _curved(at, away, size)
    size = np.sqrt(1.0 + below[1] * below[1] + below[2] * below[2])
    return _level(below, (z - below[0]) / size, size)


@inner
def _level(at: Height, g: float, size: float) -> Jet:
    """Return the distance g with the normal of the surface at a place, and a Hessian of zero."""
    return g, -at[1] / size, -at[2] / size, 1.0 / size, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _curved(at: Height, g: float, size: float) -> Jet:
    """Return distance, normal and Hessian (WH2) for the foot point `at`."""
    _, p, q, h_uu, h_uv, h_vv = at
    up = 1.0 / size
    e, f, c = 1.0 + p * p, p * q, 1.0 + q * q
    b_uu, b_uv, b_vv = h_uu * up, h_uv * up, h_vv * up
    a_uu, a_uv, a_vv = e - g * b_uu, f - g * b_uv, c - g * b_vv
    det = a_uu * a_vv - a_uv * a_uv
    if a_uu <= 0.0 or det <= 0.0:
        return _level(at, g, size)
    # -I^-1 II (I - g II)^-1. Both inverses are computed by cofactors, and det I is size^2.
    scale = -up * up / det
    uu, uv = c * b_uu - f * b_uv, c * b_uv - f * b_vv
    vu, vv = e * b_uv - f * b_uu, e * b_vv - f * b_uv
    xx, xy, yy = scale * (uu * a_vv - uv * a_uv), scale * (uv * a_uu - uu * a_uv), scale * (vv * a_uu - vu * a_uv)
    xz, yz = xx * p + xy * q, xy * p + yy * q
    return g, -p * up, -q * up, up, xx, xy, xz, yy, yz, xz * p + yz * q


@inner
def grip_at(grips: FloatArray, u: float, v: float) -> float:
    """Return the grip, linear between nodes, at a place with the coordinates u, v [cells from node 0]."""
    i, s = kernels.cell(u, grips.shape[0])
    j, t = kernels.cell(v, grips.shape[1])
    low = (1.0 - t) * grips[i, j] + t * grips[i, j + 1]
    high = (1.0 - t) * grips[i + 1, j] + t * grips[i + 1, j + 1]
    return float((1.0 - s) * low + s * high)


def heightfield(
    inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int
) -> int:
    """Evaluate `count` points. This function is the kernel of `Heightfield`.

    The rows of the inputs after the point are the addresses of the coefficients, of the largest coefficient around each
    cell, and of the grips (2 rows each); the numbers of nodes along x and y; x and y of the first node; the spacing;
    and the limit of the module's docstring.
    """
    if rows_in != 15 or rows_out != kernels.WORLD_ROWS or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    if count == 0:
        return SHAPES_FIT
    p, out = kernels.doubles(inputs, rows_in, lanes_in), kernels.doubles(outputs, rows_out, lanes_out)
    along_x, along_y = int(p[9, 0]), int(p[10, 0])
    coefficients, tops = kernels.table(p, 3, along_x, along_y), kernels.table(p, 5, along_x, along_y)
    grips = kernels.table(p, 7, along_x, along_y)
    first_x, first_y, spacing, contact = p[11, 0], p[12, 0], p[13, 0], p[14, 0]
    share = 1.0 / spacing
    for k in range(count):
        if kernels.repeats(p, k):
            kernels.repeat(out, k)
            continue
        x, y = (p[0, k] - first_x) * share, (p[1, k] - first_y) * share
        grip = grip_at(grips, x, y)
        kernels.write(out, k, look(coefficients, tops, x, y, p[2, k] * share, contact), spacing, 1.0, share, grip)
    return SHAPES_FIT
