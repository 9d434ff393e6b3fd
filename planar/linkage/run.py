"""Results of a run of the corrected planar worm, and the paper's figures of merit (P11) to (P13) in correct units."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planar.linkage.ground import Ground
from planar.linkage.ledger import Ledger
from planar.linkage.shape import apexes_by_law, diagonals
from planar.linkage.step import State, Step
from planar.linkage.worm import Linkage
from planar.status import Status, Stop
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Run:
    """A run of S finished steps, with T = S + 1 instants and N segments."""

    worm: Linkage
    ground: Ground | None
    """Constants of the contact law; None for the clamped worm."""
    law: str
    """Friction: "anchored", "threshold" or "clamped"."""
    gravity: FloatArray
    """Gravity in the axes of the ground, shape (2,) [m/s^2]."""
    dt: float
    """Time step [s]."""
    first: State
    """State at t = 0."""
    steps: list[list[Step]] = field(repr=False)
    """Finished steps, each as a list of parts. A step that was halved, once or several times, has several parts."""
    stop: Stop

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @cached_property
    def time(self) -> FloatArray:
        """Instants, shape (T,) [s]."""
        return np.arange(len(self.steps) + 1, dtype=float) * self.dt

    @cached_property
    def _states(self) -> list[State]:
        return [self.first, *(parts[-1].end for parts in self.steps)]

    @cached_property
    def joints(self) -> FloatArray:
        """Joints, shape (T, N+1, 2) [m]."""
        return np.array([state.joints for state in self._states])

    @cached_property
    def apexes(self) -> FloatArray:
        """Apexes [bottom, top] of each segment, shape (T, N, 2, 2) [m]."""
        return apexes_by_law(self.joints, self._l_cmd, self.worm.segment_law)

    @cached_property
    def length(self) -> FloatArray:
        """Horizontal diagonal of each segment, shape (T, N) [m]."""
        return diagonals(self.joints)[0]

    @cached_property
    def contraction(self) -> FloatArray:
        """Commanded contraction, shape (T, N)."""
        return 1.0 - self._l_cmd / self.worm.l0

    @property
    def _l_cmd(self) -> FloatArray:
        return np.array([state.l_cmd for state in self._states])

    @cached_property
    def com(self) -> FloatArray:
        """Centre of mass of joints and apexes, shape (T, 2) [m]."""
        return self._mean(self.joints, self.apexes)

    @cached_property
    def com_velocity(self) -> FloatArray:
        """Velocity of the centre of mass, shape (T, 2) [m/s]."""
        joints = np.array([state.joint_velocity for state in self._states])
        return self._mean(joints, np.array([state.apex_velocity for state in self._states]))

    def _mean(self, at_joints: FloatArray, at_apexes: FloatArray) -> FloatArray:
        total = np.einsum("j,tjd->td", self.worm.joint_mass, at_joints)
        total += np.einsum("ns,tnsd->td", self.worm.apex_mass, at_apexes)
        return np.asarray(total / self.worm.total_mass)

    @cached_property
    def normal_load(self) -> FloatArray:
        """Normal load of each apex [bottom, top], shape (T, N, 2) [N]."""
        return np.array([state.load for state in self._states])

    @cached_property
    def slip(self) -> FloatArray:
        """Distance that each apex [bottom, top] slides in each step, >= 0, shape (S, N, 2) [m]."""
        n = self.worm.segments
        return np.array([sum(np.abs(part.slip) for part in parts) for parts in self.steps]).reshape(-1, n, 2)

    @cached_property
    def joint_friction(self) -> FloatArray:
        """Friction (P10) along x on the joints of the clamped worm, shape (S, N+1) [N]."""
        return np.array([parts[-1].joint_friction for parts in self.steps]).reshape(-1, self.worm.segments + 1)

    @cached_property
    def joint_load(self) -> FloatArray:
        """Normal loads (P9) of the clamped worm, shape (S, N+1) [N]."""
        return np.array([parts[-1].joint_load for parts in self.steps]).reshape(-1, self.worm.segments + 1)

    @cached_property
    def newton_iterations(self) -> NDArray[np.int64]:
        """Jacobians evaluated in each step, shape (S,)."""
        return np.array([sum(p.solution.iterations for p in parts) for parts in self.steps], dtype=np.int64)

    @cached_property
    def halved_steps(self) -> int:
        """Number of steps that were halved because Newton's method did not converge."""
        return sum(len(parts) > 1 for parts in self.steps)

    @cached_property
    def ledger(self) -> Ledger:
        """Energy balance of each step."""
        flat = [part for parts in self.steps for part in parts]
        if not flat:
            return Ledger.empty()
        owner = np.repeat(np.arange(len(self.steps)), [len(parts) for parts in self.steps])
        ledger = Ledger.of(flat, self.worm, self.ground, self.gravity, anchored=self.law == "anchored")
        return ledger.summed(owner, len(self.steps))

    @property
    def distance(self) -> float:
        """Displacement of the centre of mass along the ground, positive towards the initial heading [m]."""
        heading = 1.0 if self.first.joints[-1, 0] >= self.first.joints[0, 0] else -1.0
        return heading * float(self.com[-1, 0] - self.com[0, 0])

    @property
    def work_contract(self) -> float:
        """Net work of the actuators, the integral of (dE/dl_cmd) dl_cmd [J]."""
        return float(self.ledger.work_contract.sum())

    @property
    def work_friction(self) -> float:
        """Energy lost to friction, >= 0 in contact [J]."""
        return float(self.ledger.friction_loss.sum())

    @property
    def cost_of_transport(self) -> float:
        """Dimensionless (P12), work_contract / (m g distance); NaN without weight or without motion forward."""
        scale = self.worm.total_mass * float(np.hypot(*self.gravity)) * self.distance
        return self.work_contract / scale if scale > 0.0 else float("nan")
