"""The nodes and springs of the paper's worm: a rhombus of five springs per segment.

E = k l0/2 (1 - l/l0)^2                                                         (P7)
"""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray

BAND = 7
"""Half bandwidth of the Hessian in the flat coordinates (x0, y0, x1, y1, ...)."""


class Net:
    """Nodes, springs and masses of the worm at rest, and the elastic energy of the springs.

    Attributes
    ----------
    main, top, bottom : ndarray of int, shape (n+1,), (n,), (n,)
        Numbers of the nodes.
    rest : ndarray, shape (3n+1, 2)
        Positions at rest [m].
    a, b : ndarray of int, shape (5n,)
        Nodes that each spring joins.
    k, l0 : ndarray, shape (5n,)
        Stiffness [N] and rest length [m] of each spring.
    mass : ndarray, shape (3n+1,)
        [kg].
    """

    def __init__(
        self, n: int, *, length: float, k_spring: float, k_link: float, mass: float, connector_mass: float
    ) -> None:
        dL = length / n
        y0 = np.sqrt(3.0) / 4.0 * dL
        self.main = 3 * np.arange(n + 1)
        self.top = 3 * np.arange(n) + 1
        self.bottom = self.top + 1
        self.rest = np.zeros((3 * n + 1, 2))
        self.rest[self.main, 0] = np.arange(n + 1) * dL
        self.rest[self.top] = np.column_stack([(np.arange(n) + 0.5) * dL, np.full(n, y0)])
        self.rest[self.bottom] = self.rest[self.top] * (1.0, -1.0)

        tail, head = self.main[:-1], self.main[1:]
        self.a = np.concatenate([tail, tail, self.top, tail, self.bottom])
        self.b = np.concatenate([head, self.top, head, self.bottom, head])
        self.k = np.repeat([k_spring, k_link], [n, 4 * n])
        self.l0 = np.linalg.norm(self.rest[self.b] - self.rest[self.a], axis=1)

        self.mass = np.empty(3 * n + 1)
        self.mass[self.main] = (mass - connector_mass) / (n + 1)
        self.mass[self.top] = self.mass[self.bottom] = connector_mass / (2 * n)
        for array in (self.main, self.top, self.bottom, self.rest, self.a, self.b, self.k, self.l0, self.mass):
            array.setflags(write=False)

        size = self.rest.size
        ends = np.column_stack([2 * self.a, 2 * self.a + 1, 2 * self.b, 2 * self.b + 1])
        self._scatter_gradient = ends.ravel()
        self._scatter_band = ((BAND + ends[:, :, None] - ends[:, None, :]) * size + ends[:, None, :]).ravel()

    def p7_energy(self, x: FloatArray) -> FloatArray:
        """Return the elastic energy (P7) [J] of positions of shape (..., 3n+1, 2)."""
        length = np.linalg.norm(x[..., self.b, :] - x[..., self.a, :], axis=-1)
        energy: FloatArray = (0.5 * self.k * self.l0 * (1.0 - length / self.l0) ** 2).sum(axis=-1)
        return energy

    def p7_gradient(self, x: FloatArray) -> FloatArray:
        """Return the gradient of (P7) [N] at positions of shape (T, 3n+1, 2), in the same shape."""
        e = x[:, self.b] - x[:, self.a]
        length = np.linalg.norm(e, axis=-1, keepdims=True)
        pull = -(self.k * (1.0 - length[..., 0] / self.l0))[..., None] * e / length
        nodes = np.arange(x.shape[1])[:, None]
        incidence = (nodes == self.b).astype(float) - (nodes == self.a)
        return np.asarray(incidence @ pull)

    def p7_gradient_and_band(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient [N] and Hessian [N/m] of (P7) at the flat positions q of shape (D,).

        The gradient has the shape (D,); the Hessian is banded, shape (2 BAND + 1, D): entry (i, j) at
        [BAND + i - j, j].
        """
        x = q.reshape(-1, 2)
        e = x[self.b] - x[self.a]
        length = np.sqrt((e * e).sum(axis=1))
        t = e / length[:, None]
        slope = -self.k * (1.0 - length / self.l0)
        along = t[:, :, None] * t[:, None, :]
        block = (self.k / self.l0)[:, None, None] * along + (slope / length)[:, None, None] * (np.eye(2) - along)
        pull = slope[:, None] * t
        gradient = np.bincount(self._scatter_gradient, np.hstack([-pull, pull]).ravel(), q.size)
        blocks = np.empty((len(self.k), 4, 4))
        blocks[:, :2, :2] = blocks[:, 2:, 2:] = block
        blocks[:, :2, 2:] = blocks[:, 2:, :2] = -block
        band = np.bincount(self._scatter_band, blocks.ravel(), (2 * BAND + 1) * q.size)
        return np.asarray(gradient, dtype=float), np.asarray(band, dtype=float).reshape(2 * BAND + 1, q.size)
