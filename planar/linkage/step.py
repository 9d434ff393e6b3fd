"""One implicit Euler step of the corrected worm, in contact with the ground or clamped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planar.linkage.element import BY_LAW, Body, Now
from planar.linkage.ground import LIMIT_TOLERANCE, Ground
from planar.linkage.newton import Newton, Solution, loads
from planar.linkage.regimes import gauge
from planar.linkage.segment_law import RHOMBUS
from planar.linkage.shape import apexes_by_law, cross_products, diagonals, hinge_angles
from planar.linkage.worm import Linkage
from planar.metrics import p10_friction
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """Complete state of the worm between two steps."""

    joints: FloatArray
    """Positions of the joints, shape (N+1, 2) [m]."""
    joint_velocity: FloatArray
    """Velocities of the joints, shape (N+1, 2) [m/s]."""
    apex_velocity: FloatArray
    """Velocity of the apexes [bottom, top], shape (N, 2, 2) [m/s]."""
    l_cmd: FloatArray
    """Commanded rest lengths, shape (N,) [m]."""
    anchor: FloatArray
    """x of each apex's anchor, shape (N, 2) [m]."""
    slide: FloatArray
    """Displacement of each apex from its anchor towards the head, shape (N, 2) [m]."""
    stuck: NDArray[np.bool_]
    """Whether the static coefficient applies to each apex, shape (N, 2)."""
    load: FloatArray
    """Normal load of each apex, shape (N, 2) [N]."""

    @classmethod
    def at_rest(cls, joints: FloatArray, worm: Linkage) -> State:
        """Return the state of a worm at rest, without commands and without forces of friction."""
        n = worm.segments
        l_cmd = np.full(n, worm.l0)
        positions = apexes_by_law(joints, l_cmd, worm.segment_law)
        return cls(
            joints=joints,
            joint_velocity=np.zeros((n + 1, 2)),
            apex_velocity=np.zeros((n, 2, 2)),
            l_cmd=l_cmd,
            anchor=positions[..., 0].copy(),
            slide=np.zeros((n, 2)),
            stuck=np.ones((n, 2), dtype=bool),
            load=np.zeros((n, 2)),
        )


@dataclass(frozen=True, eq=False)
class Step:
    """One finished step (or a part of a halved step)."""

    dt: float
    """Time step [s]."""
    start: State
    end: State
    solution: Solution
    slip: FloatArray
    """Displacement of the anchors, positive towards the head, shape (N, 2) [m]."""
    cap: FloatArray
    """Limit of friction over the kinetic limit, shape (N, 2): the static ratio if the contact is stuck, else 1."""
    joint_force: FloatArray
    """External force on the joints, shape (N+1, 2) [N]."""
    joint_friction: FloatArray
    """Friction (P10) along x on the joints of the clamped worm, shape (N+1,) [N]."""
    apex_friction: FloatArray
    """Friction (P10) along x on the apexes of the threshold law, shape (N, 2) [N]."""
    joint_load: FloatArray
    """Normal loads (P9) of the clamped worm, shape (N+1,) [N]."""


def body_of(worm: Linkage) -> Body:
    """Return the worm's constants in the format of the compiled functions."""
    return Body(*[getattr(worm, name) for name in Body._fields])


class Stepper(ABC):
    """Solver of one step of implicit Euler (P4); each subclass is for one kind of ground."""

    def __init__(self, worm: Linkage, gravity: FloatArray, ground: Ground, held: NDArray[np.bool_]) -> None:
        self.worm, self.gravity, self.ground = worm, gravity, ground
        self.body = body_of(worm)
        self.newton = Newton(self.body, ground, worm.length, held.ravel())

    @abstractmethod
    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Return the step of length `dt` from `state`, whether or not Newton's method converged.

        `l_cmd` are the commanded lengths at the end of the step, and `force` the external forces on the joints.
        """

    def _apexes(self, joints: FloatArray, l_cmd: FloatArray) -> FloatArray:
        return apexes_by_law(joints, l_cmd, self.body.segment_law)

    def _now(self, state: State, l_cmd: FloatArray, force: FloatArray, cap: FloatArray, dt: float) -> Now:
        positions, law = self._apexes(state.joints, state.l_cmd), self.body.segment_law
        length, tangent = diagonals(state.joints)
        has_hinges = law.kind == RHOMBUS
        return Now(
            dt=dt,
            l_cmd=l_cmd,
            force=force,
            gravity=self.gravity,
            joint_hat=state.joints + dt * state.joint_velocity,
            apex_hat=positions + dt * state.apex_velocity,
            joint_n=state.joints,
            length_n=length,
            cross_n=cross_products(state.joints),
            angle_n=hinge_angles(length, law.link_length) if has_hinges else np.zeros_like(length),
            depth_n=np.maximum(0.0, -positions[..., 1]),
            anchor=state.anchor,
            direction=np.where(tangent[:, 0] < 0.0, -1.0, 1.0),
            slide_n=state.slide,
            cap=cap,
            load=state.load.copy(),
            push=np.zeros_like(state.load),
            regime=np.full(state.load.shape, BY_LAW),
        )

    def _moved(self, state: State, q: FloatArray, now: Now) -> State:
        joints = q.reshape(-1, 2)
        before, after = self._apexes(state.joints, state.l_cmd), self._apexes(joints, now.l_cmd)
        return replace(
            state,
            joints=joints,
            joint_velocity=(joints - state.joints) / now.dt,
            apex_velocity=(after - before) / now.dt,
            l_cmd=now.l_cmd,
        )

    def _corrected(self, predicted: Solution, pushed: Now) -> Solution:
        """Return the solution for `pushed`, which contains the friction computed from a prediction.

        `iterations` counts prediction and correction, and `converged` is true if both have converged.
        """
        corrected = self.newton.solve(predicted.q, pushed)
        return replace(
            corrected,
            iterations=predicted.iterations + corrected.iterations,
            converged=predicted.converged and corrected.converged,
        )

    def _finished(self, state: State, end: State, solution: Solution, now: Now, **own: FloatArray) -> Step:
        """Return a step with the slip, friction and loads in `own`; arrays that are left out are zero."""
        apex, joint = np.zeros_like(state.load), np.zeros(len(state.joints))
        given: dict[str, Any] = {"slip": apex, "apex_friction": apex, "joint_friction": joint, "joint_load": joint}
        return Step(now.dt, state, end, solution, cap=now.cap, joint_force=now.force, **{**given, **own})


class ContactStepper(Stepper):
    """Steps with contact of the apexes, and Coulomb friction with anchors (`planar.linkage.ground`)."""

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Solve with the static limit for stuck contacts, release the contacts that reach it, and repeat (G4)."""
        stuck, guess, iterations = state.stuck.copy(), state.joints.ravel(), 0
        while True:
            now = self._now(state, l_cmd, force, np.where(stuck, self.ground.static_ratio, 1.0), dt)
            solution = self.newton.solve(guess, now)
            iterations += solution.iterations
            load = loads(solution.q, self.body, self.ground, now)
            _, y, limit = gauge(solution.q, self.body.segment_law, self.ground, now)
            breaks = stuck & (load > 0.0) & (np.abs(y) > limit * (1.0 - LIMIT_TOLERANCE))
            if not solution.converged or self.ground.static_ratio == 1.0 or not breaks.any():
                break
            stuck, guess = stuck & ~breaks, solution.q
        slip, slide = self._return_map(solution.q, now, load)
        touching = load > 0.0
        moved = self._moved(state, solution.q, now)
        x = self._apexes(moved.joints, now.l_cmd)[..., 0]
        end = replace(
            moved,
            load=load,
            anchor=np.where(touching, state.anchor + now.direction[:, None] * slip, x),
            slide=np.where(touching, slide, 0.0),
            stuck=~touching | (slip == 0.0),
        )
        return self._finished(state, end, replace(solution, iterations=iterations), now, slip=slip)

    def _return_map(self, q: FloatArray, now: Now, load: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the displacement of the anchors (G3), and the displacement of the apexes from the moved anchors."""
        centre, y, limit = gauge(q, self.body.segment_law, self.ground, now)
        yields = (load > 0.0) & (np.abs(y) > limit * (1.0 + LIMIT_TOLERANCE))
        left = centre + np.where(yields, np.sign(y) * limit, y)
        return np.where(yields, centre + y - left, 0.0), left


class ClampedStepper(Stepper):
    """Steps on the paper's ground.

    The heights z of the joints are held. A predictor without friction gives the loads (P9), and the corrector includes
    the friction (P10).
    """

    def __init__(self, worm: Linkage, gravity: FloatArray, mu: tuple[FloatArray, FloatArray], threshold: float) -> None:
        held = np.zeros((worm.segments + 1, 2), dtype=bool)
        held[:, 1] = True
        super().__init__(worm, gravity, Ground.none(worm.segments), held)
        self.mu = _at_joints(mu[0]), _at_joints(mu[1])
        self.threshold = threshold

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Predict without friction, compute the loads from the prediction, and correct with friction."""
        now = self._now(state, l_cmd, force, np.ones_like(state.load), dt)
        predicted = self.newton.solve(state.joints.ravel(), now)
        load = np.abs(self.newton.residual(predicted.q, now)[1::2])  # (P9)
        to_head = 1.0 if state.joints[-1, 0] >= state.joints[0, 0] else -1.0
        velocity = to_head * (predicted.q[::2] - state.joints[:, 0]) / dt
        friction = to_head * p10_friction(load, velocity, self.mu, self.threshold)
        pushed = now._replace(force=force + np.column_stack([friction, np.zeros_like(friction)]))
        solution = self._corrected(predicted, pushed)
        end = self._moved(state, solution.q, now)
        return self._finished(state, end, solution, now, joint_friction=friction, joint_load=load)


class ThresholdStepper(Stepper):
    """Steps with contact of the apexes, and the paper's friction (P10).

    A predictor without friction gives the loads and the velocities. There is no friction below a threshold of the
    speed.
    """

    def __init__(
        self, worm: Linkage, gravity: FloatArray, ground: Ground, held: NDArray[np.bool_], threshold: float
    ) -> None:
        nothing = np.zeros(worm.segments)
        super().__init__(worm, gravity, ground._replace(mu_forward=nothing, mu_backward=nothing), held)
        self.mu = ground.mu_forward[:, None], ground.mu_backward[:, None]
        self.threshold = threshold

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Predict without friction, compute loads and velocities from the prediction, and correct with friction."""
        now = self._now(state, l_cmd, force, np.ones_like(state.load), dt)
        predicted = self.newton.solve(state.joints.ravel(), now)
        before = self._apexes(state.joints, state.l_cmd)[..., 0]
        after = self._apexes(predicted.q.reshape(-1, 2), l_cmd)[..., 0]
        velocity = now.direction[:, None] * (after - before) / dt
        load = loads(predicted.q, self.body, self.ground, now)
        friction = now.direction[:, None] * p10_friction(load, velocity, self.mu, self.threshold)
        solution = self._corrected(predicted, now._replace(push=friction))
        moved = self._moved(state, solution.q, now)
        end = replace(moved, load=loads(solution.q, self.body, self.ground, now))
        slid = now.direction[:, None] * (self._apexes(end.joints, l_cmd)[..., 0] - before)
        slip = np.where(friction != 0.0, slid, 0.0)
        return self._finished(state, end, solution, now, slip=slip, apex_friction=friction)


def _at_joints(per_segment: FloatArray) -> FloatArray:
    """Return values for the joints, shape (N+1,), as means of the adjacent segments; an end has only one segment."""
    return 0.5 * (np.append(per_segment[:1], per_segment) + np.append(per_segment, per_segment[-1:]))
