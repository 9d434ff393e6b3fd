"""Distance to a mesh from the spline of its grid, symbolic: value, normal and curvature at a point.

The spline is that of the coefficients about the point.

With the tricubic spline d of signed distances (T1), its gradient v and Hessian D, m = |v| (1 but for the grid's errors)
and a cell as unit,

    g = psi d,    psi = 1 + (1/max(m, 1/2) - 1) phi,    phi = (1 + (d/w)^2)^-2                        (M1)

so that the gradient of g is a unit vector on the surface d = 0, which (M1) does not move, and g is d a cell away from
it, also beside edges, where the spline is rounded and m is small. As a function of d and v it gives

    grad g = g_d v + D g_v,    Hess g = g_d D + v (D g_dv)' + (D g_dv) v'                              (M2)

where what vanishes with d is left out of the Hessian.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from worm3d.machine.codegen import Kernel, compile_kernel
from worm3d.worlds import table

NARROW = 0.1
"""w of (M1), in cells."""

SIDE = 4
"""Coefficients about a point along each axis."""

ROWS_IN, ROWS_OUT = SIDE**3 + 3, 10
"""Coefficients, those along z next to one another, and the place between the middle ones along each axis; see `Jet`."""


def cubic(t: ca.SX) -> list[ca.SX]:
    """Return the weights of (T1) and their first and second derivatives with respect to t, shape (4,) each."""
    formula: Any = table.cubic  # arithmetic alone: of symbols as of numbers
    return [ca.vertcat(*weights) for weights in formula.py_func(t)]


def spline(coefficients: ca.SX, place: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return value, gradient and Hessian of the spline, contracted along z, y and x."""
    x, y, z = (cubic(place[k]) for k in range(3))
    rows = ca.reshape(coefficients, SIDE, SIDE**2).T  # (x, y) by z
    along_z = [ca.reshape(rows @ w, SIDE, SIDE).T for w in z]  # x by y
    along_y = {(j, k): along_z[k] @ y[j] for j in range(3) for k in range(3 - j)}

    def contracted(i: int, j: int, k: int) -> ca.SX:
        """Return the derivative of order i, j, k along the axes."""
        return ca.dot(x[i], along_y[j, k])

    xx, xy, xz = contracted(2, 0, 0), contracted(1, 1, 0), contracted(1, 0, 1)
    yy, yz, zz = contracted(0, 2, 0), contracted(0, 1, 1), contracted(0, 0, 2)
    gradient = ca.vertcat(contracted(1, 0, 0), contracted(0, 1, 0), contracted(0, 0, 1))
    hessian = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    return contracted(0, 0, 0), gradient, hessian


def distance(value: ca.SX, gradient: ca.SX) -> ca.SX:
    """Return g of (M1)."""
    phi = 1.0 / (1.0 + (value / NARROW) ** 2) ** 2
    return value * (1.0 + (1.0 / ca.fmax(ca.norm_2(gradient), 0.5) - 1.0) * phi)


@cache
def kernel() -> Kernel:
    """Return the compiled spline."""
    coefficients, place, d, v = ca.SX.sym("c", SIDE**3), ca.SX.sym("t", 3), ca.SX.sym("d"), ca.SX.sym("v", 3)
    g = distance(d, v)
    g_d, g_v = ca.gradient(g, d), ca.gradient(g, v)
    value, gradient, hessian = spline(coefficients, place)
    parts = ca.Function("parts", [d, v], [g, g_d, g_v, ca.gradient(g_d, v)])
    g, g_d, g_v, g_dv = parts(value, gradient)
    turned = hessian @ g_dv
    normal = g_d * gradient + hessian @ g_v
    curvature = g_d * hessian + gradient @ turned.T + turned @ gradient.T
    rows = ca.vertcat(g, normal, *(curvature[i, j] for i in range(3) for j in range(i, 3)))
    return compile_kernel(ca.Function("mesh_spline", [coefficients, place], [ca.densify(rows)]))
