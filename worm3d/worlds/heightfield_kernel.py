"""The compiled heightfield: distance to a bicubic surface z = h(x, y) by its foot point.

With the surface S(u, v) = (u, v, h), N = (-h_u, -h_v, 1) and J = (S_u, S_v), the foot of a point P is where

    (P - S) . S_u = (P - S) . S_v = 0                                                                (H1)

found by Newton's method from the point below P. There, with the unit normal n = N/|N|, the first and second
fundamental forms I = J'J and II = Hess(h)/|N|,

    g = (P - S) . n,     grad g = n,     Hess g = -J I^-1 II (I - g II)^-1 J'                        (H2)

(do Carmo, Differential Geometry of Curves and Surfaces, 3-3: Weingarten's equations, and the derivative of (H1)).
I - g II is also Newton's matrix; where it is not positive definite P lies beyond a focus, and g there is that of the
tangent plane below P, as it is farther than `BAND` cells from the surface: distances there only tell that it is far.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.codegen.emit import FINE, WRONG_SHAPE
from worm3d.compiled import inner
from worm3d.worlds import table

FloatArray = NDArray[np.float64]
Jet = tuple[float, float, float, float, float, float]
"""h, h_u, h_v, h_uu, h_uv, h_vv."""

BAND = 2.0
"""Cells from the surface within which distances are those to the foot point."""

ITERATIONS = 20
"""Of Newton's method for a foot point."""

CLOSE = 1e-4
"""Cells that the foot moves at the last iteration: its error, and the normal's, is then about the square of that, the
distance's its fourth power."""

ROWS_IN, ROWS_OUT = 3 + 9, 11
"""Point; address of coefficients and grips (2 each), nodes along x and y, first x and y, spacing."""

_COEFFICIENTS, _GRIPS, _NODES, _FIRST, _SPACING = 3, 5, 7, 9, 11


@inner
def jet(coefficients: FloatArray, u: float, v: float) -> Jet:
    """Return height and derivatives, in cells, at a place counted in nodes."""
    i, s = table.cell(u, coefficients.shape[0])
    j, t = table.cell(v, coefficients.shape[1])
    (across, across_1, across_2), (along, along_1, along_2) = table.cubic(t), table.cubic(s)
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
def foot(coefficients: FloatArray, x: float, y: float, z: float, begin: Jet) -> tuple[bool, float, float, Jet]:
    """Return whether Newton's method found a foot (H1), its place and the surface there, all in cells."""
    u, v, at = x, y, begin
    gap = (z - at[0]) ** 2
    for _ in range(ITERATIONS):
        up = z - at[0]
        r_u, r_v = x - u + up * at[1], y - v + up * at[2]
        uu, uv, vv = 1.0 + at[1] * at[1] - up * at[3], at[1] * at[2] - up * at[4], 1.0 + at[2] * at[2] - up * at[5]
        if uu <= 0.0 or uu * vv - uv * uv <= 0.0:  # Gauss and Newton's matrix I instead
            uu, uv, vv = 1.0 + at[1] * at[1], at[1] * at[2], 1.0 + at[2] * at[2]
        det = uu * vv - uv * uv
        d_u, d_v = (vv * r_u - uv * r_v) / det, (uu * r_v - uv * r_u) / det
        share = 1.0
        for _half in range(6):
            new = jet(coefficients, u + share * d_u, v + share * d_v)
            now = (x - u - share * d_u) ** 2 + (y - v - share * d_v) ** 2 + (z - new[0]) ** 2
            if now <= gap * (1.0 + 1e-14) + 1e-28:
                break
            share *= 0.5
        u, v, at, gap = u + share * d_u, v + share * d_v, new, now
        if abs(d_u) + abs(d_v) < CLOSE:
            return True, u, v, at
    return False, u, v, at


@inner
def _rough(coefficients: FloatArray, u: float, v: float) -> Jet:
    """Return height and slopes from the nearest coefficients alone."""
    i, s = table.cell(u, coefficients.shape[0])
    j, t = table.cell(v, coefficients.shape[1])
    here, ahead, left, both = (
        coefficients[i, j],
        coefficients[i + 1, j],
        coefficients[i, j + 1],
        coefficients[i + 1, j + 1],
    )
    h_u, h_v = (1.0 - t) * (ahead - here) + t * (both - left), (1.0 - s) * (left - here) + s * (both - ahead)
    return here + s * (ahead - here) + t * ((1.0 - s) * (left - here) + s * (both - ahead)), h_u, h_v, 0.0, 0.0, 0.0


@inner
def _write(out: FloatArray, k: int, distance: float, at: Jet, size: float) -> None:
    """Write distance and normal as rows 0 to 3."""
    out[0, k] = distance
    out[1, k], out[2, k], out[3, k] = -at[1] / size, -at[2] / size, 1.0 / size


@inner
def look(out: FloatArray, k: int, coefficients: FloatArray, x: float, y: float, z: float, spacing: float) -> None:
    """Write distance, normal and curvature at a point in cells as rows 0 to 9 of lane k."""
    rough = _rough(coefficients, x, y)
    rough_size = np.sqrt(1.0 + rough[1] * rough[1] + rough[2] * rough[2])
    if z - rough[0] > BAND * rough_size:
        _write(out, k, (z - rough[0]) / rough_size * spacing, rough, rough_size)
        for r in range(6):
            out[4 + r, k] = 0.0
        return
    below = jet(coefficients, x, y)
    size = np.sqrt(1.0 + below[1] * below[1] + below[2] * below[2])
    g, at, known = (z - below[0]) / size, below, False
    if abs(g) < BAND:
        found, u, v, near = foot(coefficients, x, y, z, below)
        near_size = np.sqrt(1.0 + near[1] * near[1] + near[2] * near[2])
        away = (z - near[0] - near[1] * (x - u) - near[2] * (y - v)) / near_size
        if found and away * (z - below[0]) >= 0.0:
            g, at, size, known = away, near, near_size, True
    _write(out, k, g * spacing, at, size)
    _curvature(out, k, at, g, size, spacing, known)


@inner
def _curvature(out: FloatArray, k: int, at: Jet, g: float, size: float, spacing: float, known: bool) -> None:
    """Write the Hessian of (H2) as rows 4 to 9; zero where the foot is not known."""
    _, p, q, h_uu, h_uv, h_vv = at
    e, f, c = 1.0 + p * p, p * q, 1.0 + q * q
    l, m, n = h_uu / size, h_uv / size, h_vv / size
    a_uu, a_uv, a_vv = e - g * l, f - g * m, c - g * n
    det = a_uu * a_vv - a_uv * a_uv
    if not known or a_uu <= 0.0 or det <= 0.0:
        for r in range(6):
            out[4 + r, k] = 0.0
        return
    first = e * c - f * f
    w_uu, w_uv, w_vu, w_vv = (c * l - f * m) / first, (c * m - f * n) / first, (e * m - f * l) / first, (e * n - f * m) / first
    scale = -1.0 / (det * spacing)
    xx = scale * (w_uu * a_vv - w_uv * a_uv)
    xy = scale * (w_uv * a_uu - w_uu * a_uv)
    yy = scale * (w_vv * a_uu - w_vu * a_uv)
    xz, yz = xx * p + xy * q, xy * p + yy * q
    out[4, k], out[5, k], out[6, k], out[7, k], out[8, k], out[9, k] = xx, xy, xz, yy, yz, xz * p + yz * q


@inner
def grip_at(grips: FloatArray, u: float, v: float) -> float:
    """Return the grip at a place counted in nodes, linear between nodes."""
    i, s = table.cell(u, grips.shape[0])
    j, t = table.cell(v, grips.shape[1])
    low = (1.0 - t) * grips[i, j] + t * grips[i, j + 1]
    high = (1.0 - t) * grips[i + 1, j] + t * grips[i + 1, j + 1]
    return float((1.0 - s) * low + s * high)


def heightfield(
    inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int
) -> int:
    """Evaluate `count` points; the kernel of `Heightfield`."""
    if rows_in != ROWS_IN or rows_out != ROWS_OUT or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    p, out = table.doubles(inputs, rows_in, lanes_in), table.doubles(outputs, rows_out, lanes_out)
    if count == 0:
        return FINE
    nodes = int(p[_NODES, 0]), int(p[_NODES + 1, 0])
    coefficients = table.doubles(table.address(p[_COEFFICIENTS, 0], p[_COEFFICIENTS + 1, 0]), nodes[0], nodes[1])
    grips = table.doubles(table.address(p[_GRIPS, 0], p[_GRIPS + 1, 0]), nodes[0], nodes[1])
    first_x, first_y, spacing = p[_FIRST, 0], p[_FIRST + 1, 0], p[_SPACING, 0]
    for k in range(count):
        x, y, z = (p[0, k] - first_x) / spacing, (p[1, k] - first_y) / spacing, p[2, k] / spacing
        look(out, k, coefficients, x, y, z, spacing)
        out[10, k] = grip_at(grips, x, y)
    return FINE
