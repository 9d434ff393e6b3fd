"""Results of a run of the published program, and the paper's figures of merit."""

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
    """A run of the program; S finished steps, T = S + 1 instants, n segments."""

    n: int
    """Number of segments."""
    dt: float
    """Time step [s]."""
    parameters: Parameters
    time: FloatArray
    """Instants, shape (T,) [s]."""
    q: FloatArray
    """Node positions x, y, shape (T, 3n+1, 2) [m]; main node i is node 3 i, followed by the segment's top and
    bottom."""
    start: FloatArray
    """Start positions of each step: q before the step, with touching nodes snapped to the ground, shape (S, 3n+1, 2)
    [m]."""
    contraction_force: FloatArray
    """Shape (S, 3n+1, 2) [N]."""
    friction_force: FloatArray
    """Shape (S, 3n+1, 2) [N]."""
    activation: FloatArray
    """Activation of each segment at the end of each step, shape (S, n)."""
    newton_iterations: NDArray[np.int64]
    """Iterations of predictor and corrector together, shape (S,)."""
    residual: FloatArray
    """Norm of the free residual of the last iterate tested, shape (S,) [N]."""
    stop: Stop
    net: Net = field(repr=False)

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @property
    def unconverged_steps(self) -> int:
        """Number of steps that Newton left above the tolerance (the program goes on)."""
        return int((self.residual >= self.parameters.tolerance).sum())

    @cached_property
    def reported_com(self) -> FloatArray:
        """The program's "centre of mass" (T,) [m]: by mistake the mean of the entries 3 i of (x0, y0, x1, ...)."""
        flat = self.q.reshape(len(self.q), -1)
        return np.asarray(flat[:, 3 * np.arange(self.n + 1)].mean(axis=1))

    @cached_property
    def com(self) -> FloatArray:
        """Centre of mass of all nodes (T, 2) [m]."""
        return np.asarray(self.net.mass @ self.q / self.net.mass.sum())

    @property
    def ground(self) -> float:
        """Height of the ground [m]."""
        return self.net.ground_height(self.parameters.ground_clearance)

    @property
    def inverted_steps(self) -> int:
        """Number of steps after which some segment is inside out: the top below the bottom, or the head behind."""
        height = self.q[1:, self.net.top, 1] - self.q[1:, self.net.bottom, 1]
        length = np.diff(self.q[1:, self.net.main, 0], axis=1)
        return int(((height <= 0.0) | (length <= 0.0)).any(axis=1).sum())

    @cached_property
    def work_contract(self) -> FloatArray:
        """Work of the contraction force over each step by the program's rule, with sign, shape (S,) [J].

        This is (P11), but with dq counted from `start`, after touching nodes were snapped to the ground.
        """
        return p11_work(self.contraction_force, self.q[1:] - self.start)

    @cached_property
    def work_contract_p11(self) -> FloatArray:
        """Work of the contraction force over each step by (P11), F.(q_{k+1} - q_k), shape (S,) [J]."""
        return p11_work(self.contraction_force, np.diff(self.q, axis=0))

    @cached_property
    def work_friction(self) -> FloatArray:
        """Work of the friction force over each step, (P13), shape (S,) [J]; negative for dissipation."""
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
        """The plotted curve, shape (S,) [J/m]: the sum of |work / dx| over the steps with |dx| > 1e-6 m."""
        steps = p12_cost_of_transport(np.abs(self.work_contract), self.reported_com, threshold=1e-6)
        return np.cumsum(np.abs(steps))

    @cached_property
    def energy_balance_error(self) -> float:
        """|Residual of the energy ledger| over the sum of its absolute terms.

        With U = s E, the potential of the force in the program, and dq = q - start of each step:
        F_contract . dq + F_friction . dq + [U(start) - U(q_k)]
        = change of kinetic energy + change of U + numerical loss, where the numerical loss of implicit
        Euler, m |du|^2/2 + U(start) - U(q) + gradU(q) . dq, is computed separately.
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
