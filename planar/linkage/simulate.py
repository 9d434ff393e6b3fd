"""Simulation of the corrected planar worm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planar.linkage.ground import Friction, Ground
from planar.linkage.run import Run
from planar.linkage.start import (
    require_equilibrium,
    require_shape,
    settled,
    shape_checked,
    shape_status,
    start_joints,
    touches,
)
from planar.linkage.step import ClampedStepper, ContactStepper, State, Step, Stepper, ThresholdStepper
from planar.linkage.worm import Linkage
from planar.status import Status, Stop
from worm3d.values import arguments, time_steps
from worm3d.values.arguments import require_room
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import spelled

Gait = Callable[[float], FloatArray]
"""Function of the time [s] that returns the contraction of each segment, shape (N,).

The commanded rest length of a segment is l0 (1 - contraction).
"""

Force = Callable[[float], FloatArray]
"""Function of the time [s] that returns the force on each joint, shape (N+1, 2) [N]."""


def bytes_per_step(segments: int) -> float:
    """Return the memory of one step from the simulation to the written record [byte]; the numbers are measured."""
    return 2000.0 + 1200.0 * segments


@spelled
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
    settle: bool | None = None,
    velocity_threshold: float = 1e-6,
    observer: Callable[[int], bool] | None = None,
) -> Run:
    """Simulate a worm by implicit Euler.

    Parameters
    ----------
    worm : Linkage
    gait : callable
        Function of the time [s] that returns the contraction of each segment, shape (N,). With a learned segment law,
        the command moves the apexes. The command should then be continuous and begin at 0: a jump, also in the first
        step, strikes the ground, and the energy of the strike grows as `dt` becomes shorter.
    duration, dt : float
        Simulated time and time step [s].
    ground : str
        With "contact", the worm is free and its apexes stand on the ground z = 0. With "clamped", the heights z of the
        joints are held, the normal loads are (P9), and the friction is (P10).
    friction : Friction, optional
        Friction of the ground; `Friction()` if left out. The clamped worm uses the kinetic coefficients only.
    friction_law : str
        Law of friction for ground="contact". "anchored" is Coulomb friction with anchors (`planar.linkage.ground`),
        "threshold" is the paper's (P10), applied to the touching apexes.
    gravity : float
        Acceleration of gravity [m/s^2].
    slope : float
        Slope of the ground [rad], positive if the ground rises towards +x. The axis x is along the ground, z normal to
        it.
    external_force : callable, optional
        Function of the time [s] that returns the force on each joint, shape (N+1, 2) [N].
    start : ndarray, shape (N+1, 2), optional
        Joints at the start [m]. If left out, the worm is straight and at rest, and for ground="contact" it stands on
        the ground.
    held : ndarray of bool, shape (N+1, 2), optional
        Coordinates that stay constant; only for ground="contact".
    settle : bool, optional
        Whether the run starts from the equilibrium under the weight normal to the ground; only for ground="contact". By
        default true if an apex touches the ground at the start; a worm that starts in the air falls.
    velocity_threshold : float
        eps of (P10) [m/s].
    observer : callable, optional
        Function that is called with the number of finished steps after each step. If it returns False, the run ends.

    Returns
    -------
    Run
        The run with all finished steps. `Run.stop` says how the run ended.

    Raises
    ------
    planar.linkage.LimitPointError
        For ground="contact", if the weight would flatten the rhombi.
    ValueError
        If an argument is out of range or has the wrong shape.
    """
    arguments.instance("worm", worm, Linkage, "a planar.linkage.Linkage")
    arguments.instance("friction", friction, Friction | None, "a planar.linkage.Friction, or None")
    arguments.function("gait", gait)
    if settle is not None:
        arguments.flag("settle", settle)
    if observer is not None:
        arguments.function("observer", observer, "a function of the number of finished steps")
    n, friction = worm.segments, Friction() if friction is None else friction
    arguments.number("duration", duration, "s", gt=0.0)
    arguments.number("dt", dt, "s", gt=0.0)
    arguments.number("gravity", gravity, ge=0.0)
    arguments.number("velocity_threshold", velocity_threshold, ge=0.0)
    arguments.number("slope", slope, "rad", gt=-np.pi / 2, lt=np.pi / 2)
    arguments.choice("ground", ground, ("contact", "clamped"))
    arguments.choice("friction_law", friction_law, ("anchored", "threshold"))
    require_shape("gait", gait(0.0), (n,), "one value per segment")
    time_steps.require_fit(dt, "the duration of the run", duration)
    steps = duration / dt
    require_room("duration", steps * bytes_per_step(n), f"{steps:.3g} steps of {n} segments", "a longer dt")
    if external_force is not None:
        arguments.function("external_force", external_force)
    push = external_force or (lambda t: np.zeros((n + 1, 2)))
    require_shape("external_force", push(0.0), (n + 1, 2), "x, z of the force on each joint")
    weight = gravity * np.array([-np.sin(slope), -np.cos(slope)])
    joints = start_joints(worm, start, on_ground=ground == "contact")
    state, status = State.at_rest(joints, worm), Status.DONE
    constants: Ground | None = None
    stepper: Stepper
    if ground == "clamped":
        if held is not None or friction_law != "anchored":
            raise ValueError("held and friction_law are for ground='contact' only, not for the clamped worm")
        stepper = ClampedStepper(worm, weight, friction.coefficients(n), velocity_threshold)
    else:
        require_equilibrium(worm, -weight[1])
        constants = Ground.of(worm, friction, gravity)
        fixed = np.zeros((n + 1, 2), dtype=bool) if held is None else np.array(held, dtype=bool)
        require_shape("held", fixed, (n + 1, 2), "x, z of each joint")
        if friction_law == "threshold":
            stepper = ThresholdStepper(worm, weight, constants, fixed, velocity_threshold)
        else:
            stepper = ContactStepper(worm, weight, constants, fixed)
        if weight[1] != 0.0 and (touches(worm, joints) if settle is None else settle):
            state, status = settled(worm, weight, fixed, joints)
    law = "clamped" if ground == "clamped" else friction_law
    run = partial(Run, worm, constants, law, weight, dt, state)
    if status is not Status.DONE:
        return run([], Stop(status, 0, 0.0, 0.0, 0))
    given = shape_checked(gait, (n,)), shape_checked(push, (n + 1, 2))
    simulation = _Simulation(worm, stepper, *given, on_ground=constants is not None)
    return run(*simulation.steps(state, dt, max(1, round(duration / dt)), observer))


@dataclass(frozen=True, eq=False)
class _Simulation:
    worm: Linkage
    stepper: Stepper
    gait: Callable[[float], FloatArray | None]
    force: Callable[[float], FloatArray | None]
    on_ground: bool

    def steps(
        self, state: State, dt: float, steps: int, observer: Callable[[int], bool] | None
    ) -> tuple[list[list[Step]], Stop]:
        """Return the finished steps after a state, each as a list of parts, and the reason for the end."""
        done: list[list[Step]] = []
        for k in range(1, steps + 1):
            parts, status = self._advance(state, (k - 1) * dt, dt, halvings=6)
            if status is not Status.DONE:
                return done, _stop(status, k, dt, parts)
            done.append(parts)
            state = parts[-1].end
            if observer is not None and not observer(k) and k < steps:
                return done, _stop(Status.INTERRUPTED, k, dt, parts)
        return done, _stop(Status.DONE, steps, dt, done[-1])

    def _advance(self, state: State, t: float, dt: float, halvings: int) -> tuple[list[Step], Status]:
        """Return the parts of the step from t to t + dt, and the status.

        If Newton's method does not converge, the step is halved, recursively at most `halvings` times.
        """
        contraction, force = self.gait(t + dt), self.force(t + dt)
        if contraction is None or force is None or (contraction >= 1.0).any():
            return [], Status.BAD_COMMAND
        step = self.stepper.step(state, self.worm.l0 * (1.0 - contraction), force, dt)
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
        return shape_status(self.worm, step.end.joints, step.end.l_cmd, self.on_ground)


def _stop(status: Status, k: int, dt: float, parts: list[Step]) -> Stop:
    residual = parts[-1].solution.gradient if parts else np.zeros(1)
    worst = int(np.argmax(np.nan_to_num(np.abs(residual), nan=np.inf))) // 2
    joints = max(len(residual) // 2 - 1, 1)
    return Stop(status, k, k * dt, float(np.linalg.norm(residual)), min(worst, joints - 1))
