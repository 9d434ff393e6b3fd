"""Results of a run of the program that was published with the paper, and the paper's figures of merit."""

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
    """A run of the published program ("the program" below), with S finished steps, T = S + 1 instants and n segments.

    A tag such as (P7) is an equation of the paper, or of `planar.metrics`.
    """

    n: int
    """Number of segments."""
    dt: float
    """Time step [s]."""
    parameters: Parameters
    time: FloatArray
    """Instants, shape (T,) [s]."""
    q: FloatArray
    """Positions x, y of the nodes, shape (T, 3n+1, 2) [m]. Node 3 i is the main node i on the axis; nodes 3 i + 1 and
    3 i + 2 are the top and the bottom of segment i."""
    start: FloatArray
    """Initial positions of each step, shape (S, 3n+1, 2) [m]: q before the step, but nodes that touch the ground are
    set to the height of the ground."""
    contraction_force: FloatArray
    """Contraction force on each node in each step, shape (S, 3n+1, 2) [N]."""
    friction_force: FloatArray
    """Friction force on each node in each step, shape (S, 3n+1, 2) [N]."""
    activation: FloatArray
    """Activation of each segment at the end of each step, shape (S, n)."""
    newton_iterations: NDArray[np.int64]
    """Number of Newton iterations of each step, the sum for predictor and corrector, shape (S,)."""
    residual: FloatArray
    """Norm of the residual force on the free nodes in the last iterate that was tested, shape (S,) [N]."""
    stop: Stop
    net: Net = field(repr=False)

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @property
    def unconverged_steps(self) -> int:
        """Number of steps where Newton's method did not reach the tolerance. The program continues regardless."""
        return int((self.residual >= self.parameters.tolerance).sum())

    @cached_property
    def reported_com(self) -> FloatArray:
        """The "centre of mass" that the program reports, shape (T,) [m].

        By mistake, the program takes the mean of the entries 3 i, i = 0, ..., n, of the flat coordinates (x0, y0, x1,
        y1, ...).
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
        """Number of steps after which a segment is inverted.

        The top of an inverted segment is not above its bottom, or its head end is not ahead of its tail end.
        """
        height = self.q[1:, self.net.top, 1] - self.q[1:, self.net.bottom, 1]
        length = np.diff(self.q[1:, self.net.main, 0], axis=1)
        return int(((height <= 0.0) | (length <= 0.0)).any(axis=1).sum())

    @cached_property
    def work_contract(self) -> FloatArray:
        """Work of the contraction force in each step by the rule of the program, with sign, shape (S,) [J].

        The rule is (P11) with q_{k+1} - `start` in place of q_{k+1} - q_k. The motion of nodes that are set on the
        ground is thus left out.
        """
        return p11_work(self.contraction_force, self.q[1:] - self.start)

    @cached_property
    def work_contract_p11(self) -> FloatArray:
        """Work of the contraction force in each step by (P11), F.(q_{k+1} - q_k), shape (S,) [J]."""
        return p11_work(self.contraction_force, np.diff(self.q, axis=0))

    @cached_property
    def work_friction(self) -> FloatArray:
        """Work of the friction force in each step by (P13), shape (S,) [J]. Dissipation is negative."""
        return p11_work(self.friction_force, self.q[1:] - self.start)

    @property
    def reported_distance(self) -> float:
        """Distance that the paper's figures show, the displacement of `reported_com` [m]."""
        return float(self.reported_com[-1] - self.reported_com[0])

    @property
    def true_displacement(self) -> float:
        """Mean displacement of the main nodes along x [m]."""
        return float((self.q[-1] - self.q[0])[self.net.main, 0].mean())

    @property
    def work(self) -> float:
        """Total work by the rule of the program: the sum of |F . dq| over the steps [J]."""
        return float(np.abs(self.work_contract).sum())

    @property
    def total_cot(self) -> float:
        """Total cost of transport by the rule of the program, `work` / `reported_distance` [J/m]."""
        return self.work / self.reported_distance if self.reported_distance != 0.0 else float("nan")

    @cached_property
    def cumulative_cot(self) -> FloatArray:
        """Curve of the cost of transport that the paper plots, shape (S,) [J/m].

        The curve is the cumulative sum of |work / dx| over the steps with |dx| > 1e-6 m, where dx is the change of
        `reported_com`.
        """
        steps = p12_cost_of_transport(np.abs(self.work_contract), self.reported_com, threshold=1e-6)
        return np.cumsum(np.abs(steps))

    @cached_property
    def energy_balance_error(self) -> float:
        """Absolute residual of the energy ledger, divided by the sum of the absolute values of its terms.

        E is the elastic energy (P7), s is `elastic_sign`, and U = s E is the potential of the program's elastic force.
        q_k is the configuration before a step and q the configuration after it; dq = q - start; u is the velocity. The
        ledger is the sum over the steps of

        F_contract . dq + F_friction . dq + [U(start) - U(q_k)]
        = change of kinetic energy + change of U + numerical loss

        The numerical loss of the implicit Euler method is computed independently of the other terms, as
        m |du|^2/2 + U(start) - U(q) + gradU(q) . dq.
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
