"""The worm of the program that was published with the paper ("the program" below).

Each segment is a rhombus of five springs. A spring with the stiffness k [N] and the rest length l0 has the energy

    E = k l0/2 (1 - l/l0)^2                                                         (P7)

(P7), (P9) and (P10) are equations of the paper; (P10) is the law of friction, in `planar.metrics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled

NET_HALF_BANDWIDTH = 7
"""Half bandwidth of the Hessian with respect to the flat coordinates (x0, y0, x1, y1, ...)."""


@documented
@dataclass(frozen=True)
class Parameters(Spelled):
    """Constants of the published program; the defaults give the paper's results."""

    length: float = parameter(1.0, "length at rest", "m", gt=0)
    k_spring: float = parameter(13.0, "stiffness k of a segment's spring, (P7)", "N", gt=0, key="spring_N")
    k_link: float = parameter(1e4, "stiffness k of each link of a rhombus, (P7)", "N", gt=0, key="link_N")
    mass: float = parameter(1e-8, "mass of the whole worm", "kg", gt=0)
    connector_mass: float = parameter(1e-11, "total mass of all connectors, a part of the mass", "kg", gt=0)
    gravity: float = parameter(9.8, "gravitational acceleration g; only for the normal load m_i g", "m/s^2", ge=0)
    mu_forward: float = parameter(0.03, "coefficient of friction for motion towards the head, +x", ge=0, key="forward")
    mu_backward: float = parameter(
        0.20, "coefficient of friction for motion towards the tail, -x", ge=0, key="backward"
    )
    velocity_threshold: float = parameter(1e-6, "speed below which there is no friction, eps", "m/s", ge=0)
    normal_load: Literal["weight", "residual"] = parameter(
        "weight", "normal load N_i: weight, m_i g, as in the program; or residual, |r_y,i|, as in the text, (P9)"
    )
    contraction_force: float = parameter(
        10.0, "force on a connector at activation 1", "N", key="force_N", aka=("amplitude_N",)
    )
    wavelength: float = parameter(1.0, "length of the travelling wave", "m", gt=0, aka=("lambda_m", "wave_length_m"))
    ground_clearance: float = parameter(
        0.02, "height of the lowest connector at rest above the ground", "m", ge=0, key="clearance_m"
    )
    snap: bool = parameter(True, "whether the corrector starts with all nodes in contact at the height of the ground")
    elastic_sign: float = parameter(-1.0, "sign of the elastic force: -1 as in the program, 1 as in mechanics")
    rectified: bool = parameter(True, "true: the default wave is max(0, sin) (the program); false: sin (the text)")
    tolerance: float = parameter(
        1e-6, "norm of the residual below which Newton's method makes one more update and stops", "N", gt=0
    )
    max_iterations: int = parameter(100, "number of iterations after which a step is accepted, converged or not", ge=1)

    def __post_init__(self) -> None:
        check(self, largest=1e100)  # the program accepts masses of points of any size
        if not 0 < self.connector_mass < self.mass:
            raise ValueError(
                f"connector_mass: got {self.connector_mass!r} kg, must lie between 0 and mass ({self.mass!r} kg)"
            )
        if self.elastic_sign not in (-1.0, 1.0):
            raise ValueError(f"elastic_sign: got {self.elastic_sign!r}, must be -1 (the program) or +1 (mechanics)")


class Net:
    """Nodes, springs and masses of the worm at rest, and the elastic energy of the springs.

    Attributes
    ----------
    main, top, bottom : ndarray of int, shape (n+1,), (n,), (n,)
        Numbers of the main nodes (on the axis), and of the top and bottom node of each segment.
    rest : ndarray, shape (3n+1, 2)
        Positions at rest [m].
    a, b : ndarray of int, shape (5n,)
        Numbers of the two nodes at the ends of each spring.
    k, l0 : ndarray, shape (5n,)
        Stiffness [N] and rest length [m] of each spring.
    mass : ndarray, shape (3n+1,)
        Mass of each node [kg].
    """

    def __init__(self, n: int, p: Parameters) -> None:
        dL = p.length / n
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
        self.k = np.repeat([p.k_spring, p.k_link], [n, 4 * n])
        self.l0 = np.linalg.norm(self.rest[self.b] - self.rest[self.a], axis=1)

        self.mass = np.empty(3 * n + 1)
        self.mass[self.main] = (p.mass - p.connector_mass) / (n + 1)
        self.mass[self.top] = self.mass[self.bottom] = p.connector_mass / (2 * n)
        for array in (self.main, self.top, self.bottom, self.rest, self.a, self.b, self.k, self.l0, self.mass):
            array.setflags(write=False)

        size = self.rest.size
        ends = np.column_stack([2 * self.a, 2 * self.a + 1, 2 * self.b, 2 * self.b + 1])
        self._scatter_gradient = ends.ravel()
        self._scatter_band = (
            (NET_HALF_BANDWIDTH + ends[:, :, None] - ends[:, None, :]) * size + ends[:, None, :]
        ).ravel()

    def ground_height(self, clearance: float) -> float:
        """Return the height of a ground `clearance` below the lowest node at rest [m]."""
        return float(self.rest[:, 1].min()) - clearance

    def p7_energy(self, x: FloatArray) -> FloatArray:
        """Return the elastic energy (P7) [J], shape (...), for positions of shape (..., 3n+1, 2)."""
        length = np.linalg.norm(x[..., self.b, :] - x[..., self.a, :], axis=-1)
        return np.asarray((0.5 * self.k * self.l0 * (1.0 - length / self.l0) ** 2).sum(axis=-1))

    def p7_gradient(self, x: FloatArray) -> FloatArray:
        """Return the gradient of (P7) at the positions x [N]; both have the shape (T, 3n+1, 2)."""
        e = x[:, self.b] - x[:, self.a]
        length = np.linalg.norm(e, axis=-1, keepdims=True)
        pull = -(self.k * (1.0 - length[..., 0] / self.l0))[..., None] * e / length
        nodes = np.arange(x.shape[1])[:, None]
        incidence = (nodes == self.b).astype(float) - (nodes == self.a)
        return np.asarray(incidence @ pull)

    def p7_gradient_and_band(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradient [N] and the Hessian [N/m] of the energy (P7) at the flat positions q, shape (D,).

        The gradient has the shape (D,). The Hessian is stored as a band matrix, shape (2 NET_HALF_BANDWIDTH + 1, D),
        with the entry (i, j) at [NET_HALF_BANDWIDTH + i - j, j].
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
        band = np.bincount(self._scatter_band, blocks.ravel(), (2 * NET_HALF_BANDWIDTH + 1) * q.size)
        return np.asarray(gradient, dtype=float), np.asarray(band, dtype=float).reshape(
            2 * NET_HALF_BANDWIDTH + 1, q.size
        )
