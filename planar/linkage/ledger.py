"""Energy ledger of implicit Euler, with every term computed separately.

Multiplying the residual of a step by dq = q_{n+1} - q_n gives the balance

    work of the actuators + work of external forces + change of the anchors' energy by changed loads
    = change of kinetic, elastic, potential, penetration and anchor energy
      + friction loss + viscous loss + impact + numerical loss - residual.dq

X are the positions of the mass points (joints and apexes), V their velocities, J = dX/dq, E an energy, s a strain.

* Work of the actuators is the integral of (dE/dl_cmd) dl_cmd over the change of the command by the trapezoidal rule,
  that is, the mean of E(l, cmd_{n+1}) - E(l, cmd_n) at l_n and l_{n+1}. The difference between this mean and the value
  at l_n is a numerical loss, which may be negative. If the half-height h depends on the command, the command also moves
  the apexes at constant joints. The first-order displacement of an apex in a step is then
  dX = (dX/dq) dq + (dX/dl_cmd) dl_cmd, and the work contains f.(dX/dl_cmd) dl_cmd, where f is the gradient of the
  potential of the apex (inertia, weight, contact and friction) at the end of the step.
* Friction loss is the limit of friction times the distance that the anchor moves. For the friction law (P10) it is
  -F.dq.
* Viscous loss is c (ds)^2/dt in the Kelvin-Voigt dampers, and the loss in the medium (P8) and in the dampers of
  friction.
* Impact is the loss in the damper of the normal contact. In a step in which an apex strikes the ground (`_lands`), the
  impact is instead the impulse N dt times the mean of the normal velocities before and after the step, less the energy
  stored in the contact. The impulse of friction is treated in the same way. The term -m g.(dt (V + V_n)/2 - J dq)
  removes the work of the weight during the impact.
* Numerical loss is m |dV|^2/2, and E_n - E_{n+1} + gradE_{n+1}.dq for every energy. Since X(q) and s(q) are not linear,
  the numerical loss also contains force times (first-order dX - dX) for inertia, contact, friction and dampers. The
  part that counts as impact is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from planar.linkage.ground import Ground
from planar.linkage.segment_law import values
from planar.linkage.shape import R, apexes_by_law, cross_products, diagonals, hinge_angles, joint_cosines
from planar.linkage.worm import Linkage
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from planar.linkage.step import Step

STRIKE = 2.0
"""An apex strikes the ground if its downward speed exceeds this multiple of gravity times the time step."""


def _stacked(parts: Sequence[Any]) -> Any:
    """Return the arrays of P parts stacked along a new first axis of length P.

    If the parts are dataclasses, return a dataclass whose fields are the stacked fields.
    """
    if not is_dataclass(parts[0]):
        return np.array(parts)
    kind: Any = type(parts[0])
    return kind(**{f.name: _stacked([getattr(part, f.name) for part in parts]) for f in fields(kind)})


@dataclass(frozen=True, eq=False)
class Ledger:
    """Energy of each step, each term of shape (S,) [J].

    Attributes
    ----------
    work_contract, work_external, load_change : ndarray
        Supplied energy: work of the actuators, work of external forces, and the change of the energy stored at the
        anchors that is due to changed normal loads.
    work_contract_p11, work_friction_p13 : ndarray
        The paper's work F.dq of the contraction force (P11) and of the friction force (P13). They are not part of the
        balance.
    kinetic, elastic, potential, penetration, anchor : ndarray
        Changes of stored energy. `penetration` is stored in the normal contacts, `anchor` in the springs of friction.
    friction_loss, viscous_loss, impact, numerical_loss : ndarray
        Lost energy. In contact, friction_loss and viscous_loss are >= 0; in flight, impact is 0.
    """

    work_contract: FloatArray
    work_external: FloatArray
    load_change: FloatArray
    kinetic: FloatArray
    elastic: FloatArray
    potential: FloatArray
    penetration: FloatArray
    anchor: FloatArray
    friction_loss: FloatArray
    viscous_loss: FloatArray
    impact: FloatArray
    numerical_loss: FloatArray
    work_contract_p11: FloatArray
    work_friction_p13: FloatArray

    @property
    def uses(self) -> dict[str, float]:
        """Where the work of the actuators and of external forces goes [J], by name; the sum equals this work."""
        stored = self.kinetic + self.elastic + self.potential + self.penetration + self.anchor
        parts = {
            "friction": self.friction_loss,
            "damping": self.viscous_loss,
            "impact": self.impact,
            "numerical": self.numerical_loss,
            "gained": stored - self.load_change,
        }
        return {name: float(part.sum()) for name, part in parts.items()}

    @property
    def residual(self) -> FloatArray:
        """Supplied energy less stored and lost energy, shape (S,) [J]; zero up to the residual of Newton's method."""
        stored = self.kinetic + self.elastic + self.potential + self.penetration + self.anchor
        lost = self.friction_loss + self.viscous_loss + self.impact + self.numerical_loss
        return self.work_contract + self.work_external + self.load_change - stored - lost

    @property
    def balance_error(self) -> float:
        """|Sum of `residual`| over the sum of the absolute values of all terms; NaN if a term is NaN."""
        terms = [f.name for f in fields(self) if not f.name.endswith(("_p11", "_p13"))]
        scale = sum(float(np.abs(getattr(self, name)).sum()) for name in terms)
        return 0.0 if scale == 0.0 else abs(float(self.residual.sum())) / scale

    def summed(self, owner: NDArray[np.int64], steps: int) -> Ledger:
        """Return the ledger of the steps, given this ledger of parts of steps; `owner` is the step of each part."""
        return Ledger(**{f.name: np.bincount(owner, getattr(self, f.name), steps).astype(float) for f in fields(self)})

    @classmethod
    def empty(cls) -> Ledger:
        """Return the ledger of a run without a finished step."""
        return cls(**{f.name: np.zeros(0) for f in fields(cls)})

    @classmethod
    def of(
        cls, parts: Sequence[Step], worm: Linkage, ground: Ground | None, gravity: FloatArray, *, anchored: bool
    ) -> Ledger:
        """Return the ledger of `parts`, at least one, which are steps or parts of halved steps.

        `anchored` says whether friction has anchors.
        """
        return cls(**_Terms(_stacked(parts), worm, ground, gravity, anchored).all())


class _Terms:
    def __init__(self, p: Any, worm: Linkage, ground: Ground | None, gravity: FloatArray, anchored: bool) -> None:
        self.p, self.worm, self.ground, self.gravity, self.anchored = p, worm, ground, gravity, anchored
        self.law = worm.segment_law
        self.dq = p.end.joints - p.start.joints
        self.de = np.diff(self.dq, axis=1)
        self.l_n, _ = diagonals(p.start.joints)
        self.l, self.t = diagonals(p.end.joints)
        self.stretch = np.sum(self.t * self.de, axis=-1)  # dl/dq . dq
        self.x_n, self.x = (apexes_by_law(each.joints, each.l_cmd, self.law) for each in (p.start, p.end))
        self.dx = self.x - self.x_n
        self.commanded = np.zeros_like(self.dx)
        self.first_order = self._first_order_apex_motion()
        self.mean = _per(p.dt, self.dx) * 0.5 * (p.start.apex_velocity + p.end.apex_velocity)
        self.lands = self._lands()
        self.tau = worm.kelvin_voigt_time / p.dt[:, None]

    def _first_order_apex_motion(self) -> FloatArray:
        """Return the first-order displacement of the apexes, dm -+ (dh n + h dn), with dn = -t (n.de)/l.

        m is the middle between the two joints, and h is half of the distance between the apexes. A rhombus has
        dh = -l dl/(4 h). For other segment laws, the part (dX/dl_cmd) dl_cmd is kept as `commanded`.
        """
        n = self.t @ R.T
        if self.worm.has_links:
            h = np.sqrt(self.worm.link_length**2 - self.l**2 / 4.0)
            dh = -self.l * self.stretch / (4.0 * h)
        else:
            at_end = values(self.l, self.p.end.l_cmd, self.law)
            h, by_command = at_end.height, at_end.widening * (self.p.end.l_cmd - self.p.start.l_cmd)
            dh = at_end.along * self.stretch + by_command
            self.commanded = by_command[..., None, None] * np.stack([-n, n], axis=-2)
        dn = -self.t * (np.sum(n * self.de, axis=-1) / self.l)[..., None]
        reach = dh[..., None] * n + h[..., None] * dn
        middle = 0.5 * (self.dq[:, :-1] + self.dq[:, 1:])
        return np.stack([middle - reach, middle + reach], axis=-2)

    def _lands(self) -> FloatArray:
        """Return 1 for each part in which an apex strikes the ground, else 0. `worm3d.solver` has the same rule."""
        fast = STRIKE * float(np.linalg.norm(self.gravity)) * _per(self.p.dt, self.p.end.load)
        strikes = (self.p.end.load > 0.0) & (-self.p.start.apex_velocity[..., 1] > fast)
        return np.asarray(strikes.any(axis=(1, 2)).astype(float))

    def all(self) -> dict[str, FloatArray]:
        """Return every term of the ledger."""
        parts = (self._inertia(), self._elastic(), *self._weight(), self._contact(), self._external())
        total = {f.name: np.zeros(len(self.p.dt)) for f in fields(Ledger)}
        for part in parts:
            for name, term in part.items():
                total[name] += term
        return total

    def _external(self) -> dict[str, FloatArray]:
        """Return the terms of external forces, of the friction law (P10), and of the medium (P8)."""
        friction = np.einsum("pj,pj->p", self.p.joint_friction, self.dq[..., 0])
        friction += np.einsum("pns,pns->p", self.p.apex_friction, self.dx[..., 0])
        return {
            "work_external": np.einsum("pjd,pjd->p", self.p.joint_force, self.dq),
            "friction_loss": -friction,
            "work_friction_p13": friction,
            "viscous_loss": np.einsum("j,pjd->p", self.worm.joint_drag, self.dq**2) / self.p.dt,
            "work_contract": -np.einsum("pns,pns->p", self.p.apex_friction, self.commanded[..., 0]),
            "numerical_loss": np.einsum("pns,pns->p", self.p.apex_friction, self.dx[..., 0] - self.first_order[..., 0]),
        }

    def _inertia(self) -> dict[str, FloatArray]:
        change, loss = np.zeros(len(self.p.dt)), np.zeros(len(self.p.dt))
        moves = (
            (self.worm.joint_mass, self.p.start.joint_velocity, self.p.end.joint_velocity, self.dq, self.dq),
            (self.worm.apex_mass, self.p.start.apex_velocity, self.p.end.apex_velocity, self.first_order, self.dx),
        )
        for mass, v_n, v, first_order, true in moves:
            dv = v - v_n
            per_point = 0.5 * (v**2 - v_n**2).sum(-1), 0.5 * (dv**2).sum(-1)
            curvature = (dv / _per(self.p.dt, dv) * (first_order - true)).sum(-1)
            change += _weighted(mass, per_point[0])
            loss += _weighted(mass, per_point[1] + curvature)
        commanding = _weighted(self.worm.apex_mass, (dv / _per(self.p.dt, dv) * self.commanded).sum(-1))
        return {"work_contract": commanding, "kinetic": change, "numerical_loss": loss}

    def _weight(self) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return the change of E = -m g.X with its numerical loss, and the part of impact that is due to the weight.

        The numerical loss is -m g.(first-order dX - dX). The command does no work on the weight, since it moves the two
        apexes of a segment, which have equal masses, in opposite directions.
        """
        g, p, joints, tips = self.gravity, self.p, self.worm.joint_mass, self.worm.apex_mass
        change = -_weighted(joints, self.dq @ g) - _weighted(tips, self.dx @ g)
        mean = _per(p.dt, self.dq) * 0.5 * (p.start.joint_velocity + p.end.joint_velocity)
        carried = _weighted(joints, (self.dq - mean) @ g) + _weighted(tips, (self.first_order - self.mean) @ g)
        impact = self.lands * carried
        loss = -_weighted(tips, (self.first_order - self.dx) @ g)
        return {"potential": change, "numerical_loss": loss}, {"impact": impact, "numerical_loss": -impact}

    def _elastic(self) -> dict[str, FloatArray]:
        worm, p = self.worm, self.p
        cmd_n, cmd = p.start.l_cmd, p.end.l_cmd

        def spring(length: FloatArray, command: FloatArray) -> FloatArray:
            return values(length, command, self.law).energy

        def tension(command: FloatArray | float) -> FloatArray:
            return values(self.l, command, self.law).tension

        commanding = spring(self.l_n, cmd) - spring(self.l_n, cmd_n)
        commanded = spring(self.l, cmd) - spring(self.l, cmd_n)
        work = (commanding + commanded) / 2.0  # integral of (dE/dl_cmd) dl_cmd, by the trapezoidal rule
        rise = spring(self.l, cmd) - spring(self.l_n, cmd)
        change, numerical = spring(self.l, cmd) - spring(self.l_n, cmd_n), tension(cmd) * self.stretch - rise
        damper = self.tau * np.asarray(worm.k_spring) / worm.l0
        viscous = damper * (self.l - self.l_n) ** 2
        numerical = numerical + work - commanding
        numerical = numerical + damper * (self.l - self.l_n) * (self.stretch - (self.l - self.l_n))
        p11 = -(tension(cmd) - tension(worm.l0)) * self.stretch
        terms = {"work_contract": work, "elastic": change, "viscous_loss": viscous, "numerical_loss": numerical}
        total = {name: term.sum(axis=1) for name, term in (terms | {"work_contract_p11": p11}).items()}

        across = np.sum((self.t @ R.T) * self.de, axis=-1) / self.l
        turning = joint_cosines(p.end.joints) * (across[:, 1:] - across[:, :-1])
        joints = cross_products(p.start.joints), cross_products(p.end.joints), turning, np.asarray(worm.cross0)
        # Energies k/2 (s - rest)^2 with dampers; `first_order` is ds/dq . dq.
        for k, (s_n, s, first_order, rest) in (*self._hinges(), (np.asarray(worm.k_torsion), joints)):
            ds = s - s_n
            rise = 0.5 * k * ((s - rest) ** 2 - (s_n - rest) ** 2)
            loss = k * (s - rest) * first_order - rise + k * self.tau * ds * (first_order - ds)
            total["elastic"] += rise.sum(axis=1)
            total["viscous_loss"] += (k * self.tau * ds**2).sum(axis=1)
            total["numerical_loss"] += loss.sum(axis=1)
        return total

    def _hinges(self) -> list[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Return stiffness and angles of the two apex hinges of each rhombus; nothing for other segments."""
        if not self.worm.has_links:
            return []
        a = self.worm.link_length
        opening = self.stretch / np.sqrt(a**2 - self.l**2 / 4.0)
        angles = hinge_angles(self.l_n, a), hinge_angles(self.l, a), opening, self.worm.rest_angle
        return [(2.0 * np.asarray(self.worm.k_apex), angles)]

    def _contact(self) -> dict[str, FloatArray]:
        if self.ground is None:
            return {}
        total = {name: term.sum(axis=(1, 2)) for name, term in self._normal(self.ground).items()}
        friction = self._friction(self.ground) if self.anchored else {}
        for name, term in friction.items():
            total[name] = total.get(name, np.zeros(1)) + term.sum(axis=(1, 2))
        return total

    def _normal(self, ground: Ground) -> dict[str, FloatArray]:
        depth_n, depth = np.maximum(0.0, -self.x_n[..., 1]), np.maximum(0.0, -self.x[..., 1])
        dz, load = self.dx[..., 1], self.p.end.load
        rise = 0.5 * ground.stiffness * (depth**2 - depth_n**2)
        damped = -(load - ground.stiffness * depth) * dz
        impact = np.where(_per(self.lands, load) > 0.0, -load * self.mean[..., 1] - rise, damped)
        return {
            "work_contract": -load * self.commanded[..., 1],
            "penetration": rise,
            "impact": impact,
            "numerical_loss": -rise - load * self.first_order[..., 1] - impact,
        }

    def _friction(self, ground: Ground) -> dict[str, FloatArray]:
        p = self.p
        forward, backward = ground.mu_forward[:, None], ground.mu_backward[:, None]

        def slope(s: FloatArray) -> FloatArray:
            return np.where(s > 0.0, forward, -backward)

        def elastic(s: FloatArray) -> FloatArray:
            return np.where(s > 0.0, np.maximum(forward, ground.least), np.maximum(backward, ground.least)) * np.abs(s)

        def spring_energy(s: FloatArray) -> FloatArray:  # per unit of normal load
            return 0.5 * elastic(s) * slope(s) * s / ground.yield_gauge

        dt = p.dt[:, None, None]
        towards_head = np.where(diagonals(p.start.joints)[1][..., 0] < 0.0, -1.0, 1.0)[..., None]
        s_n, load_n, load = p.start.slide, p.start.load, p.end.load
        touching = load > 0.0
        ds = towards_head * self.dx[..., 0]
        left = np.where(touching, s_n + ds - p.slip, s_n)  # displacement from the anchor after the anchor has moved
        r = 1.0 / (1.0 / ground.yield_gauge + ground.gauge_damping / dt)
        y = left - ground.gauge_damping / dt * r * s_n
        share = np.where(p.slip != 0.0, p.cap, np.minimum(elastic(y) / r, p.cap))  # contacts that slid are at the limit
        force = load * share * slope(np.where(p.slip != 0.0, p.slip, y))
        stored, stored_n = load * spring_energy(left), load * spring_energy(s_n)
        spring = load * elastic(left) / ground.yield_gauge * slope(left)
        stretch = left - s_n
        impact = _per(self.lands, load) * force * (towards_head * self.mean[..., 0] - ds)
        load_change = stored_n - load_n * spring_energy(s_n)
        return {
            "work_contract": force * towards_head * self.commanded[..., 0],
            "friction_loss": load * p.cap * slope(p.slip) * p.slip,
            "anchor": stored - stored_n + load_change,
            "load_change": load_change,
            "viscous_loss": (force - spring) * stretch,
            "impact": impact,
            "numerical_loss": spring * stretch
            - (stored - stored_n)
            + force * (towards_head * self.first_order[..., 0] - ds)
            + (force - load * p.cap * slope(p.slip)) * p.slip
            - impact,
            "work_friction_p13": -force * ds,
        }


def _per(dt: FloatArray, like: FloatArray) -> FloatArray:
    return dt.reshape(-1, *(1,) * (like.ndim - 1))


def _weighted(mass: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray((mass * values).reshape(len(values), -1).sum(axis=1))
