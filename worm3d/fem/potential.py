"""Potentials integrated over finite elements: gradients and Hessians of densities that are CasADi expressions.

A potential is the integral of a density w(e, c) over elements. The local variables e of a quadrature point are linear
in the unknowns of its element, e = B v_e, and c are constants of the point. With the weight dX of a point

    Pi = sum w(B v_e, c) dX,   dPi/dv_e = sum B^T w' dX,   d2Pi/dv_e^2 = sum B^T w'' B dX.                     (FP1)
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp

from worm3d.values.arrays import FloatArray, IntArray


class Potential:
    """An integral of a density over elements, (FP1).

    Parameters
    ----------
    density, local, constant
        The density [J/m^3 or J/m^2], a scalar SX expression of the SX columns `local` and `constant`, shapes (m, 1) and
        (c, 1).
    B : ndarray, shape (elements, points, m, n)
        Local variables as linear functions of the unknowns of an element.
    unknowns : ndarray of int, shape (elements, n)
        Indices of the unknowns of each element.
    weight : ndarray, shape (elements, points)
        Weights of the quadrature, i.e. volumes [m^3] or areas [m^2].
    given : ndarray, shape (c, elements, points)
        Values of the constants.
    """

    def __init__(
        self,
        density: ca.SX,
        local: ca.SX,
        constant: ca.SX,
        B: FloatArray,
        unknowns: IntArray,
        weight: FloatArray,
        given: FloatArray,
    ) -> None:
        hessian, gradient = ca.hessian(density, local)
        results = ca.cse([gradient, ca.densify(ca.reshape(hessian, -1, 1))])
        self._value = ca.Function("value", [local, constant], [density]).map(weight.size)
        self._derivatives = ca.Function("derivatives", [local, constant], results).map(weight.size)
        self.unknowns, self.weight, self.shape = unknowns, weight, B.shape
        elements, points, m, n = B.shape
        self._B = B.reshape(elements, points * m, n)
        self._given = given.reshape(len(given), weight.size)

    def value(self, v: FloatArray) -> float:
        """Return the potential [J] for the unknowns v, shape (unknowns,)."""
        return float(self._value(self._local(v), self._given).full()[0] @ self.weight.ravel())

    def derivatives(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradient, shape (elements, n), and the Hessian, shape (elements, n, n), of each element."""
        elements, points, m, n = self.shape
        dX = self.weight.reshape(-1, 1)
        gradient, hessian = (d.full().T * dX for d in self._derivatives(self._local(v), self._given))
        product = hessian.reshape(elements, points, m, m) @ self._B.reshape(self.shape)
        transposed = self._B.transpose(0, 2, 1)
        r = transposed @ gradient.reshape(elements, points * m, 1)
        return r[..., 0], transposed @ product.reshape(elements, points * m, n)

    def _local(self, v: FloatArray) -> FloatArray:
        """Return the local variables of all points, shape (m, elements * points)."""
        e = self._B @ v[self.unknowns][..., None]
        return np.ascontiguousarray(e.reshape(self.weight.size, -1).T)


class Assembly:
    """Sums of element vectors and matrices. The pattern of the sparse matrix is found once.

    Parameters
    ----------
    unknowns : list of ndarray of int, shape (elements, n)
        Indices of the unknowns of the elements, for each potential.
    size : int
        Number of unknowns.
    """

    def __init__(self, unknowns: list[IntArray], size: int) -> None:
        self.size = size
        self._index = np.concatenate([u.ravel() for u in unknowns])
        keys = [(u[:, :, None] + size * u[:, None, :]).ravel() for u in unknowns]
        found, self._slot = np.unique(np.concatenate(keys), return_inverse=True)
        self._row = found % size
        self._start = np.searchsorted(found // size, np.arange(size + 1))

    def vector(self, parts: list[FloatArray]) -> FloatArray:
        """Return the sum of element vectors, shape (size,). Each of `parts` has the shape (elements, n)."""
        return np.asarray(np.bincount(self._index, np.concatenate([p.ravel() for p in parts]), self.size), dtype=float)

    def matrix(self, parts: list[FloatArray]) -> sp.csc_matrix:
        """Return the sum of element matrices, shape (size, size). Each of `parts` has the shape (elements, n, n)."""
        data = np.bincount(self._slot, np.concatenate([p.ravel() for p in parts]), len(self._row))
        return sp.csc_matrix((data, self._row, self._start), (self.size, self.size))


def operator(columns: list[list[FloatArray]]) -> FloatArray:
    """Return the matrices from unknowns to local variables, shape (elements, points, variables, unknowns).

    `columns` contains the local variables at all points, shape (elements, points), for a unit of each unknown.
    """
    return np.ascontiguousarray(np.array(columns).transpose(2, 3, 1, 0))
