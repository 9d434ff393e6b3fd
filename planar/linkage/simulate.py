"""Run the corrected planar worm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planar.linkage.ground import Friction, Ground
from planar.linkage.run import Run
from planar.linkage.shape import diagonals, joint_cosines
from planar.linkage.step import ClampedStepper, ContactStepper, State, Step, Stepper, ThresholdStepper
from planar.linkage.worm import FloatArray, Linkage
from planar.status import Status, Stop

Gait = Callable[[float], FloatArray]
"""Time [s] -> contraction of each segment, shape (N,): the commanded rest length is l0 (1 - contraction)."""

Force = Callable[[float], FloatArray]
"""Time [s] -> force on each joint, shape (N+1, 2) [N]."""

HALVINGS = 6
"""A step that does not converge is halved at most so often."""

FLAT = 0.02
"""A rhombus lower than this fraction of its rest height is flattened."""

SETTLING_TIME = 1.0
"""Pseudo time step of settling [s]."""

MAX_SETTLING = 200


class LimitPointError(ValueError):
    """The worm's weight would flatten its rhombi: there is no equilibrium to start from."""


def simulate(
    worm: Linkage,
    gait: Gait,
    *,
    duration: float = 10.0,
    dt: float = 0.01,
    ground: Literal["contact", "clamped"] = "contact",
    friction: Friction | None = None,
    friction_law: Literal["anchored", "threshold"] = "anchored",
    gravity: float = 9.81,
    slope: float = 0.0,
    external_force: Force | None = None,
    start: FloatArray | None = None,
    held: NDArray[np.bool_] | None = None,
    settle: bool = True,
    velocity_threshold: float = 1e-6,
    observer: Callable[[int], bool] | None = None,
) -> Run:
    """Simulate a worm by implicit Euler.

    Parameters
    ----------
    worm : Linkage
    gait : callable
        Time [s] -> contraction of each segment, shape (N,).
    duration, dt : float
        Simulated time and time step [s].
    ground : str
        "contact": nothing is held, the apexes touch the ground z = 0, set-valued friction. "clamped": the z of
        the joints is held, loads by (P9), friction by (P10).
    friction : Friction, optional
        Of the ground; `Friction()` if left out. The clamped worm has kinetic coefficients only.
    friction_law : str
        In contact: "anchored" is the set-valued law, "threshold" the paper's (P10) on the touching apexes.
    gravity : float
        [m/s^2]
    slope : float
        Angle of the ground, rising towards +x [rad]; x and z are along and normal to it.
    external_force : callable, optional
        Time [s] -> force on each joint, shape (N+1, 2) [N].
    start : ndarray, shape (N+1, 2), optional
        Joints at the start [m]; the straight rest shape, in contact standing on the ground, if left out.
    held : ndarray of bool, shape (N+1, 2), optional
        Coordinates that stay as they are (contact only).
    settle : bool
        In contact: whether to start from the equilibrium under the weight normal to the ground.
    velocity_threshold : float
        eps of (P10) [m/s].
    observer : callable, optional
        Called with the number of finished steps; returning False ends the run there.

    Returns
    -------
    Run
        With all finished steps, however the run ended: see `Run.stop`.

    Raises
    ------
    LimitPointError
        The weight would flatten the rhombi (in contact).
    ValueError
        Another argument out of range or of the wrong shape.
    """
    friction = friction or Friction()
    _validate(worm, gait, duration, dt, start)
    _require_choice("ground", ground, ("contact", "clamped"))
    _require_choice("friction_law", friction_law, ("anchored", "threshold"))
    weight = gravity * np.array([-np.sin(slope), -np.cos(slope)])
    stepper: Stepper
    if ground == "clamped":
        stepper = ClampedStepper(worm, weight, friction.coefficients(1), velocity_threshold)
        state = State.at_rest(worm.rest() if start is None else np.array(start, dtype=float), worm)
        constants = None
    else:
        _require_equilibrium(worm, gravity * np.cos(slope))
        constants = Ground.of(worm, friction, gravity)
        free = np.zeros((worm.segments + 1, 2), dtype=bool) if held is None else np.asarray(held, dtype=bool)
        if friction_law == "threshold":
            stepper = ThresholdStepper(worm, weight, constants, free, velocity_threshold)
        else:
            stepper = ContactStepper(worm, weight, constants, free)
        state = _start(worm, weight, free, start, settle)
    return _Simulation(worm, stepper, gait, external_force, dt, weight, constants).run(
        state, max(1, round(duration / dt)), observer
    )


class _Simulation:
    def __init__(
        self,
        worm: Linkage,
        stepper: Stepper,
        gait: Gait,
        force: Force | None,
        dt: float,
        weight: FloatArray,
        ground: Ground | None,
    ) -> None:
        self.worm, self.stepper, self.gait, self.dt = worm, stepper, gait, dt
        self.weight, self.ground = weight, ground
        self.force = force or (lambda t: np.zeros((worm.segments + 1, 2)))

    def run(self, state: State, steps: int, observer: Callable[[int], bool] | None) -> Run:
        first = state
        done: list[list[Step]] = []
        for k in range(1, steps + 1):
            parts, status = self._advance(state, (k - 1) * self.dt, self.dt, HALVINGS)
            if status is not Status.DONE:
                return self._collect(first, done, _stop(status, k, self.dt, parts))
            done.append(parts)
            state = parts[-1].end
            if observer is not None and not observer(k) and k < steps:
                return self._collect(first, done, _stop(Status.INTERRUPTED, k, self.dt, parts))
        return self._collect(first, done, _stop(Status.DONE, steps, self.dt, done[-1]))

    def _advance(self, state: State, t: float, dt: float, halvings: int) -> tuple[list[Step], Status]:
        """Return the step from t to t + dt, in halves if it must be, and how it went."""
        contraction = np.asarray(self.gait(t + dt), dtype=float)
        if not (np.isfinite(contraction).all() and (contraction < 1.0).all()):
            return [], Status.BAD_COMMAND
        step = self.stepper.step(state, self.worm.l0 * (1.0 - contraction), self.force(t + dt), dt)
        if step.solution.converged:
            return [step], self._guard(step)
        if halvings == 0:
            broken = self._guard(step)
            return [step], Status.NO_CONVERGENCE if broken is Status.DONE else broken
        first, status = self._advance(state, t, dt / 2.0, halvings - 1)
        if status is not Status.DONE:
            return first, status
        second, status = self._advance(first[-1].end, t + dt / 2.0, dt / 2.0, halvings - 1)
        return first + second, status

    def _guard(self, step: Step) -> Status:
        if not np.isfinite(step.end.joints).all():
            return Status.NOT_FINITE
        length, _ = diagonals(step.end.joints)
        height = np.sqrt(self.worm.link_length**2 - length**2 / 4.0)
        if (height < FLAT * self.worm.rest_half_height).any():
            return Status.FLATTENED
        if (joint_cosines(step.end.joints) <= 0.0).any():
            return Status.FOLDED
        if self.ground is not None and (step.end.joints[:, 1] <= 0.0).any():
            return Status.SUNK
        return Status.DONE

    def _collect(self, first: State, done: list[list[Step]], stop: Stop) -> Run:
        return Run(
            worm=self.worm, ground=self.ground, gravity=self.weight, dt=self.dt, first=first, steps=done, stop=stop
        )


def _stop(status: Status, k: int, dt: float, parts: list[Step]) -> Stop:
    residual = parts[-1].solution.gradient if parts else np.zeros(1)
    worst = int(np.argmax(np.nan_to_num(np.abs(residual), nan=np.inf))) // 2
    joints = max(len(residual) // 2 - 1, 1)
    return Stop(status, k, k * dt, float(np.linalg.norm(residual)), min(worst, joints - 1))


def _validate(worm: Linkage, gait: Gait, duration: float, dt: float, start: FloatArray | None) -> None:
    for name, value in (("duration", duration), ("dt", dt)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: got {value!r} s, must be finite and above 0")
    if np.shape(gait(0.0)) != (worm.segments,):
        raise ValueError(f"gait: got shape {np.shape(gait(0.0))}, must be ({worm.segments},), one value per segment")
    if start is not None and np.shape(start) != (worm.segments + 1, 2):
        raise ValueError(f"start: got shape {np.shape(start)}, must be ({worm.segments + 1}, 2): x, z of each joint")


def _require_choice(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise ValueError(f"{name}: got {value!r}, must be one of {', '.join(map(repr, allowed))}")


def _require_equilibrium(worm: Linkage, gravity: float) -> None:
    load, limit = worm.apex_load(gravity), worm.flattening_weight()
    if (load >= limit).any():
        i = int(np.argmax(load / limit))
        raise LimitPointError(
            f"segment {i} would be pressed flat: it carries {load[i]:.3g} N, its limit point is {limit[i]:.3g} N; make "
            f"the worm lighter than {worm.total_mass * limit[i] / load[i]:.3g} kg, or k_spring or half_height larger"
        )


def _start(worm: Linkage, weight: FloatArray, held: NDArray[np.bool_], start: FloatArray | None, settle: bool) -> State:
    joints = (
        worm.rest() + np.array([0.0, float(worm.rest_half_height.max())]) if start is None else np.array(start, float)
    )
    state = State.at_rest(joints, worm)
    if not settle or weight[1] == 0.0:
        return state
    frictionless = Ground.of(worm, Friction(0.0, 0.0), float(np.hypot(*weight)))
    stepper = ContactStepper(worm, np.array([0.0, weight[1]]), frictionless, held)
    nothing = np.zeros((worm.segments + 1, 2))
    for _ in range(MAX_SETTLING):
        end = stepper.step(state, state.l_cmd, nothing, SETTLING_TIME).end
        moved = np.abs(end.joints - state.joints).max()
        load = end.load
        state = State.at_rest(end.joints, worm)
        if moved < 1e-13 * worm.length:
            break
    return replace(state, load=load)
