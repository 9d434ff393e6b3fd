"""One implicit Euler step of the corrected worm, in contact with the ground or clamped."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planar.linkage.element import LAW, Body, Contact, Now
from planar.linkage.ground import TIE, YIELD_TOLERANCE, Ground
from planar.linkage.newton import Newton, Solution, loads
from planar.linkage.shape import apexes, cross_products, diagonals, hinge_angles
from planar.linkage.worm import Linkage
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """Everything that a step starts from.

    Attributes
    ----------
    joints, joint_velocity : ndarray, shape (N+1, 2)
        [m], [m/s].
    apex_velocity : ndarray, shape (N, 2, 2)
        Of the apexes [bottom, top] [m/s].
    l_cmd : ndarray, shape (N,)
        Commanded rest lengths [m].
    anchor, slide : ndarray, shape (N, 2)
        x of each apex's anchor, and its displacement from it towards the head [m].
    stuck : ndarray of bool, shape (N, 2)
        Whether the static coefficient holds.
    load : ndarray, shape (N, 2)
        Normal load of each apex [N].
    """

    joints: FloatArray
    joint_velocity: FloatArray
    apex_velocity: FloatArray
    l_cmd: FloatArray
    anchor: FloatArray
    slide: FloatArray
    stuck: NDArray[np.bool_]
    load: FloatArray

    @classmethod
    def at_rest(cls, joints: FloatArray, worm: Linkage) -> State:
        """Return the worm at rest and uncommanded, without stored friction."""
        n = worm.segments
        positions = apexes(joints, worm.link_length)
        return cls(
            joints=joints,
            joint_velocity=np.zeros((n + 1, 2)),
            apex_velocity=np.zeros((n, 2, 2)),
            l_cmd=np.full(n, worm.l0),
            anchor=positions[..., 0].copy(),
            slide=np.zeros((n, 2)),
            stuck=np.ones((n, 2), dtype=bool),
            load=np.zeros((n, 2)),
        )


@dataclass(frozen=True, eq=False)
class Step:
    """One finished step (or part of one, where a step was halved).

    Attributes
    ----------
    dt : float
        [s]
    start, end : State
    solution : Solution
    slip : ndarray, shape (N, 2)
        Signed motion of the anchors towards the head [m].
    cap : ndarray, shape (N, 2)
        Static over kinetic coefficient where stuck, else 1.
    joint_force : ndarray, shape (N+1, 2)
        External force on the joints [N].
    joint_friction : ndarray, shape (N+1,)
        Friction along x on the joints, (P10), of the clamped worm [N].
    apex_friction : ndarray, shape (N, 2)
        Friction along x on the apexes, (P10), of the threshold law [N].
    joint_load : ndarray, shape (N+1,)
        Normal loads (P9) of the clamped worm [N].
    """

    dt: float
    start: State
    end: State
    solution: Solution
    slip: FloatArray
    cap: FloatArray
    joint_force: FloatArray
    joint_friction: FloatArray
    apex_friction: FloatArray
    joint_load: FloatArray


class Stepper(Protocol):
    """Advances a state by one step; the step's solution says whether it converged."""

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Return the step to the commanded lengths `l_cmd` under the joint forces `force`."""


def body_of(worm: Linkage) -> Body:
    """Return the worm's constants as the kernel wants them."""
    n, a = worm.segments, worm.link_length
    share = np.full(n + 1, worm.drag / n)
    share[[0, -1]] /= 2.0
    return Body(
        k_spring=np.asarray(worm.k_spring),
        l0=worm.l0,
        a=a,
        k_torsion=np.asarray(worm.k_torsion),
        cross0=np.asarray(worm.cross0),
        k_apex=np.asarray(worm.k_apex),
        angle0=hinge_angles(np.full(n, worm.l0), a),
        joint_mass=worm.joint_mass,
        apex_mass=worm.apex_mass,
        drag=share,
        kelvin_voigt_time=worm.kelvin_voigt_time,
    )


def contact_of(ground: Ground | None, segments: int) -> Contact:
    """Return the ground's constants as the kernel wants them; no contact without a ground."""
    if ground is None:
        nothing = np.zeros(segments)
        return Contact(0.0, 0.0, nothing, nothing, 1.0, 1.0, 0.0)
    return Contact(
        ground.stiffness,
        ground.damping,
        ground.mu_forward,
        ground.mu_backward,
        ground.least,
        ground.yield_gauge,
        ground.gauge_damping,
    )


class _ImplicitEuler:
    """What both kinds of ground share: (P4) and the packing of a step."""

    def __init__(self, worm: Linkage, gravity: FloatArray, contact: Contact, held: NDArray[np.bool_]) -> None:
        self.worm, self.gravity, self.contact = worm, gravity, contact
        self.body = body_of(worm)
        self.newton = Newton(self.body, contact, worm.length, held.ravel())

    def _now(self, state: State, l_cmd: FloatArray, force: FloatArray, cap: FloatArray, dt: float) -> Now:
        positions = apexes(state.joints, self.body.a)
        length, tangent = diagonals(state.joints)
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
            angle_n=hinge_angles(length, self.body.a),
            depth_n=np.maximum(0.0, -positions[..., 1]),
            anchor=state.anchor,
            direction=np.where(tangent[:, 0] < 0.0, -1.0, 1.0),
            slide_n=state.slide,
            cap=cap,
            load=state.load.copy(),
            push=np.zeros_like(state.load),
            regime=np.full(state.load.shape, LAW),
        )

    def _moved(self, state: State, q: FloatArray, l_cmd: FloatArray, dt: float) -> State:
        joints = q.reshape(-1, 2)
        before, after = apexes(state.joints, self.body.a), apexes(joints, self.body.a)
        return replace(
            state,
            joints=joints,
            joint_velocity=(joints - state.joints) / dt,
            apex_velocity=(after - before) / dt,
            l_cmd=l_cmd,
        )


class ContactStepper(_ImplicitEuler):
    """Apexes touch the ground; friction is set-valued with anchors (`planar.linkage.ground`)."""

    def __init__(self, worm: Linkage, gravity: FloatArray, ground: Ground, held: NDArray[np.bool_]) -> None:
        super().__init__(worm, gravity, contact_of(ground, worm.segments), held)
        self.ground = ground

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Solve with the static limit where stuck; contacts that reach it become kinetic, and again (G4)."""
        stuck, guess, iterations = state.stuck.copy(), state.joints.ravel(), 0
        while True:
            cap = np.where(stuck, self.ground.static_ratio, 1.0)
            now = self._now(state, l_cmd, force, cap, dt)
            solution = self.newton.solve(guess, now)
            iterations += solution.iterations
            load = loads(solution.q, self.body, self.contact, now)
            breaks = stuck & self._reaches_limit(solution.q, now, load)
            if not solution.converged or self.ground.static_ratio == 1.0 or not breaks.any():
                break
            stuck, guess = stuck & ~breaks, solution.q
        slip, slide = self._return_map(solution.q, now, load)
        touching = load > 0.0
        moved = self._moved(state, solution.q, l_cmd, dt)
        x = apexes(moved.joints, self.body.a)[..., 0]
        end = replace(
            moved,
            load=load,
            anchor=np.where(touching, state.anchor + now.direction[:, None] * slip, x),
            slide=np.where(touching, slide, 0.0),
            stuck=~touching | (slip == 0.0),
        )
        return Step(
            dt=dt,
            start=state,
            end=end,
            solution=replace(solution, iterations=iterations),
            slip=slip,
            cap=cap,
            joint_force=force,
            joint_friction=np.zeros(len(state.joints)),
            apex_friction=np.zeros_like(load),
            joint_load=np.zeros(len(state.joints)),
        )

    def _gauge(self, q: FloatArray, now: Now) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return s*, y = s - s* and cap b of (G2), each of shape (N, 2) [m]."""
        g, d = self.ground, now.direction[:, None]
        x = apexes(q.reshape(-1, 2), self.body.a)[..., 0]
        r = 1.0 / (1.0 / g.yield_gauge + g.gauge_damping / now.dt)
        centre = g.gauge_damping / now.dt * r * now.slide_n
        y = d * (x - now.anchor) - centre
        mu = np.where(y > 0.0, g.mu_forward[:, None], g.mu_backward[:, None])
        return centre, y, now.cap * r / np.maximum(mu, g.least)

    def _reaches_limit(self, q: FloatArray, now: Now, load: FloatArray) -> NDArray[np.bool_]:
        """(G4): return which contacts have the greatest friction that they can have, shape (N, 2)."""
        _, y, limit = self._gauge(q, now)
        reaches: NDArray[np.bool_] = (load > 0.0) & (np.abs(y) > limit * (1.0 - TIE))
        return reaches

    def _return_map(self, q: FloatArray, now: Now, load: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(G3): return the anchors' signed motion and what is left of the displacement from them."""
        centre, y, limit = self._gauge(q, now)
        yields = (load > 0.0) & (np.abs(y) > limit * (1.0 + YIELD_TOLERANCE))
        left = centre + np.where(yields, np.sign(y) * limit, y)
        return np.where(yields, centre + y - left, 0.0), left


class ClampedStepper(_ImplicitEuler):
    """The paper's ground: the joints' z are held, (P9) loads from a predictor, (P10) friction in the corrector."""

    def __init__(self, worm: Linkage, gravity: FloatArray, mu: tuple[FloatArray, FloatArray], threshold: float) -> None:
        held = np.zeros((worm.segments + 1, 2), dtype=bool)
        held[:, 1] = True
        super().__init__(worm, gravity, contact_of(None, worm.segments), held)
        self.mu = _at_joints(mu[0]), _at_joints(mu[1])
        self.threshold = threshold

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Predict without friction, read the loads, and correct with friction."""
        cap = np.ones_like(state.load)
        now = self._now(state, l_cmd, force, cap, dt)
        predicted = self.newton.solve(state.joints.ravel(), now)
        load = np.abs(self.newton.residual(predicted.q, now)[1::2])  # (P9)
        to_head = 1.0 if state.joints[-1, 0] >= state.joints[0, 0] else -1.0
        velocity = to_head * (predicted.q[::2] - state.joints[:, 0]) / dt
        friction = to_head * p10_friction(load, velocity, self.mu, self.threshold)
        pushed = now._replace(force=force + np.column_stack([friction, np.zeros_like(friction)]))
        corrected = self.newton.solve(predicted.q, pushed)
        return Step(
            dt=dt,
            start=state,
            end=self._moved(state, corrected.q, l_cmd, dt),
            solution=replace(
                corrected,
                iterations=predicted.iterations + corrected.iterations,
                converged=predicted.converged and corrected.converged,
            ),
            slip=np.zeros_like(state.load),
            cap=cap,
            joint_force=force,
            joint_friction=friction,
            apex_friction=np.zeros_like(state.load),
            joint_load=load,
        )


class ThresholdStepper(_ImplicitEuler):
    """Apexes touch the ground, but friction is the paper's (P10): predictor's loads and directions, a threshold."""

    def __init__(
        self, worm: Linkage, gravity: FloatArray, ground: Ground, held: NDArray[np.bool_], threshold: float
    ) -> None:
        contact = contact_of(ground, worm.segments)
        nothing = np.zeros(worm.segments)
        super().__init__(worm, gravity, contact._replace(mu_forward=nothing, mu_backward=nothing), held)
        self.mu = ground.mu_forward[:, None], ground.mu_backward[:, None]
        self.threshold = threshold

    def step(self, state: State, l_cmd: FloatArray, force: FloatArray, dt: float) -> Step:
        """Predict without friction, read loads and directions, and correct with friction."""
        cap = np.ones_like(state.load)
        now = self._now(state, l_cmd, force, cap, dt)
        predicted = self.newton.solve(state.joints.ravel(), now)
        before, after = (apexes(q.reshape(-1, 2), self.body.a)[..., 0] for q in (state.joints, predicted.q))
        velocity = now.direction[:, None] * (after - before) / dt
        load = loads(predicted.q, self.body, self.contact, now)
        friction = now.direction[:, None] * p10_friction(load, velocity, self.mu, self.threshold)
        corrected = self.newton.solve(predicted.q, now._replace(push=friction))
        end = self._moved(state, corrected.q, l_cmd, dt)
        slid = apexes(end.joints, self.body.a)[..., 0] - before
        return Step(
            dt=dt,
            start=state,
            end=replace(end, load=loads(corrected.q, self.body, self.contact, now)),
            solution=replace(
                corrected,
                iterations=predicted.iterations + corrected.iterations,
                converged=predicted.converged and corrected.converged,
            ),
            slip=np.where(friction != 0.0, now.direction[:, None] * slid, 0.0),
            cap=cap,
            joint_force=force,
            joint_friction=np.zeros(len(state.joints)),
            apex_friction=friction,
            joint_load=np.zeros(len(state.joints)),
        )


def _at_joints(per_segment: FloatArray) -> FloatArray:
    """Return what the joints have of the segments' values: the mean of both sides, shape (N+1,)."""
    return 0.5 * (np.append(per_segment[:1], per_segment) + np.append(per_segment, per_segment[-1:]))


def p10_friction(
    load: FloatArray, velocity: FloatArray, mu: tuple[FloatArray, FloatArray], threshold: float
) -> FloatArray:
    """Return the friction (P10) of contacts with the given loads and velocities towards the head [N]."""
    forward, backward = mu
    return np.select([velocity > threshold, velocity < -threshold], [-forward * load, backward * load], 0.0)
