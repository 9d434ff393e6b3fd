"""Results of a run of the author's program (`planar.published`), and the paper's figures of merit."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planar.metrics import p11_work, p12_cost_of_transport
from planar.published_worm import Net, Parameters
from planar.status import Status, Stop
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly


@dataclass(frozen=True)
class Run(ReadOnly):
    """A run of S finished steps, with T = S + 1 instants and n segments."""

    n: int
    """Number of segments."""
    dt: float
    """Time step [s]."""
    parameters: Parameters
    time: FloatArray
    """Instants, shape (T,) [s]."""
    q: FloatArray
    """Positions x, y of the nodes, shape (T, 3n+1, 2) [m]. Node 3 i is the main node i; the top and the bottom node of
    segment i follow it."""
    start: FloatArray
    """Positions at the start of each step, shape (S, 3n+1, 2) [m]: q before the step, but with the nodes that touch the
    ground moved to the ground if the contacts changed (`Parameters.snap`)."""
    contraction_force: FloatArray
    """Contraction force on each node, shape (S, 3n+1, 2) [N]."""
    friction_force: FloatArray
    """Friction force on each node, shape (S, 3n+1, 2) [N]."""
    activation: FloatArray
    """Activation of each segment at the end of each step, shape (S, n)."""
    newton_iterations: NDArray[np.int64]
    """Iterations of predictor and corrector together, shape (S,)."""
    residual: FloatArray
    """Norm of the last residual that Newton's method tested, over the coordinates that are not held, shape (S,) [N]."""
    stop: Stop
    net: Net = field(repr=False)

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @property
    def unconverged_steps(self) -> int:
        """Number of steps in which Newton's method did not reach the tolerance. The program continues after them."""
        return int((self.residual >= self.parameters.tolerance).sum())

    @cached_property
    def reported_com(self) -> FloatArray:
        """The program's "centre of mass", shape (T,) [m].

        By a mistake of the program it is the mean of the entries 0, 3, ..., 3 n of the list (x0, y0, x1, y1, ...).
        """
        flat = self.q.reshape(len(self.q), -1)
        return np.asarray(flat[:, 3 * np.arange(self.n + 1)].mean(axis=1))

    @cached_property
    def com(self) -> FloatArray:
        """Centre of mass of all nodes, shape (T, 2) [m]."""
        return np.asarray(self.net.mass @ self.q / self.net.mass.sum())

    @property
    def ground(self) -> float:
        """Height of the ground [m]."""
        return self.net.ground_height(self.parameters.ground_clearance)

    @property
    def inverted_steps(self) -> int:
        """Number of steps after which a segment is inside out.

        In such a segment the top node is below the bottom node, or the two main nodes are in the wrong order along x.
        """
        height = self.q[1:, self.net.top, 1] - self.q[1:, self.net.bottom, 1]
        length = np.diff(self.q[1:, self.net.main, 0], axis=1)
        return int(((height <= 0.0) | (length <= 0.0)).any(axis=1).sum())

    @cached_property
    def work_contract(self) -> FloatArray:
        """Work of the contraction force over each step by the program's rule, with its sign, shape (S,) [J].

        It is (P11), but the displacements are measured from `start` instead of the last positions.
        """
        return p11_work(self.contraction_force, self.q[1:] - self.start)

    @cached_property
    def work_contract_p11(self) -> FloatArray:
        """Work of the contraction force over each step by (P11), F.(q_{k+1} - q_k), shape (S,) [J]."""
        return p11_work(self.contraction_force, np.diff(self.q, axis=0))

    @cached_property
    def work_friction(self) -> FloatArray:
        """Work of the friction force over each step (P13), from `start`, shape (S,) [J]; dissipation is negative."""
        return p11_work(self.friction_force, self.q[1:] - self.start)

    @property
    def reported_distance(self) -> float:
        """Distance that the paper's figures show [m]."""
        return float(self.reported_com[-1] - self.reported_com[0])

    @property
    def true_displacement(self) -> float:
        """Mean displacement of the main nodes along x [m]."""
        return float((self.q[-1] - self.q[0])[self.net.main, 0].mean())

    @property
    def work(self) -> float:
        """Total work by the program's rule: the sum of |F . dq| over the steps [J]."""
        return float(np.abs(self.work_contract).sum())

    @property
    def total_cot(self) -> float:
        """Total cost of transport by the program's rule, work / reported distance [J/m]."""
        return self.work / self.reported_distance if self.reported_distance != 0.0 else float("nan")

    @cached_property
    def cumulative_cot(self) -> FloatArray:
        """Cumulative cost of transport that the paper plots, shape (S,) [J/m].

        It is the sum of |work / dx| over the steps with |dx| > 1e-6 m, where dx is the displacement of `reported_com`.
        """
        steps = p12_cost_of_transport(np.abs(self.work_contract), self.reported_com, threshold=1e-6)
        return np.cumsum(np.abs(steps))

    @cached_property
    def energy_balance_error(self) -> float:
        """|Residual of the energy balance of the run| over the sum of the absolute values of its terms.

        U = s E is the potential of the elastic force in the program, and dq = q - start. The balance of a step is
        F_contract . dq + F_friction . dq + [U(start) - U(q_k)]
        = change of kinetic energy + change of U + numerical loss. The numerical loss of implicit Euler,
        m |du|^2/2 + U(start) - U(q) + gradU(q) . dq, is computed separately.
        """
        if len(self.time) < 2:
            return 0.0
        mass, sign, dq = self.net.mass, self.parameters.elastic_sign, self.q[1:] - self.start
        u = np.concatenate([np.zeros((1, *dq.shape[1:])), dq / self.dt])
        kinetic = 0.5 * np.einsum("k,tkd->t", mass, u**2)
        U, U_start = sign * self.net.p7_energy(self.q), sign * self.net.p7_energy(self.start)
        loss = 0.5 * np.einsum("k,tkd->t", mass, np.diff(u, axis=0) ** 2) + U_start - U[1:]
        loss += sign * p11_work(self.net.p7_gradient(self.q[1:]), dq)
        terms = np.array(
            [
                self.work_contract.sum(),
                self.work_friction.sum(),
                (U_start - U[:-1]).sum(),
                -(kinetic[-1] - kinetic[0]),
                -(U[-1] - U[0]),
                -loss.sum(),
            ]
        )
        scale = np.abs(terms).sum()
        return 0.0 if scale == 0.0 else float(abs(terms.sum()) / scale)
