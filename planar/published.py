"""A reproduction of the author's program, which gives the numbers of the paper.

The module is a reference for comparison and does not have correct physics. The author's program ("the program" below)
differs from the paper's text; `worm3d study paper` lists the differences and their effects. The module was written from
a description of the program's computations.

The worm of n segments has 3 n + 1 nodes, stored segment by segment: main 0, top 0, bottom 0, main 1, ...,
main n. Each segment has five springs, one between its two main nodes and four along the links of the rhombus. The
energy of a spring is

    E = k l0/2 (1 - l/l0)^2                                                         (P7)

One step of implicit Euler solves, on the free coordinates,

    f = M/dt ((q - q_k)/dt - u_k) + s gradE - F_friction - F_contract = 0,          (P1), (P3), (P4)
    J = M/dt^2 + s HessE,   q <- q - J^-1 f,                                        (P1), (P2)

where M are the masses, q_k and u_k positions and velocities at the start of the step, and E the sum over all springs.
The program has s = -1, which inverts the sign of the elastic force, as (P1) and (P3) do in print. Correct mechanics has
s = +1. Friction acts along x on the main nodes. It depends on the velocity v at the start of the step, and on the
normal load N_i = m_i g:

    F = -mu_forward N if v > eps,  +mu_backward N if v < -eps,  else 0.             (P10)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbsv

from planar.metrics import p10_friction
from planar.published_run import Run
from planar.published_worm import NET_HALF_BANDWIDTH, Net, Parameters
from planar.status import Status, Stop
from worm3d.values import arguments, time_steps
from worm3d.values.arguments import require_room
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import spelled

__all__ = ["Activation", "Observer", "Parameters", "Run", "simulate", "travelling_wave"]

Activation = Callable[[float], FloatArray]
"""Function of the time [s] that returns the activation of each segment, shape (n,).

The activation 1 means the full `Parameters.contraction_force`.
"""

Observer = Callable[[int], bool]
"""Function that is called with the number of finished steps after each step. If it returns False, the run ends."""


def bytes_per_step(segments: int) -> float:
    """Return the memory of one step from the simulation to the written record [byte]; the numbers are measured."""
    return 1000.0 + 12.0 * (3 * segments + 1) * 2 * 8


@dataclass(frozen=True)
class _Solution:
    q: FloatArray
    residual: FloatArray
    norm: float
    iterations: int


def _free_band(held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which entries of a band matrix join two free coordinates, shape (2 NET_HALF_BANDWIDTH + 1, D)."""
    size = len(held)
    free = np.zeros((2 * NET_HALF_BANDWIDTH + 1, size), dtype=bool)
    for offset in range(-NET_HALF_BANDWIDTH, NET_HALF_BANDWIDTH + 1):
        columns = np.arange(max(0, -offset), min(size, size - offset))
        free[NET_HALF_BANDWIDTH + offset, columns] = ~(held[columns] | held[columns + offset])
    return free


def _solve_free(J: FloatArray, f: FloatArray, held: NDArray[np.bool_], free: NDArray[np.bool_]) -> FloatArray:
    """Return J^-1 f on the free coordinates and 0 on the held coordinates; raise LinAlgError if J is singular."""
    matrix = np.zeros((3 * NET_HALF_BANDWIDTH + 1, len(f)))  # the first rows are for LAPACK's pivoting
    matrix[NET_HALF_BANDWIDTH:] = np.where(free, J, 0.0)
    matrix[2 * NET_HALF_BANDWIDTH, held] = 1.0
    _, _, step, info = dgbsv(NET_HALF_BANDWIDTH, NET_HALF_BANDWIDTH, matrix, np.where(held, 0.0, f), overwrite_ab=True)
    if info > 0:
        raise np.linalg.LinAlgError("singular matrix")
    return np.asarray(step)


def travelling_wave(n: int, T_wave: float, parameters: Parameters) -> Activation:
    """Return the program's wave: A_i(t) = max(0, sin(2 pi (x_i/lambda - t/T_wave))), x_i = (i + 1/2) L/n.

    If `Parameters.rectified` is false, A_i(t) is the sine itself.
    """
    x = (np.arange(n) + 0.5) / n * parameters.length

    def activation(t: float) -> FloatArray:
        wave = np.sin(2.0 * np.pi * (x / parameters.wavelength - t / T_wave))
        return np.maximum(0.0, wave) if parameters.rectified else wave

    return activation


class _Worm:
    """State of the program between steps, and one step of the program."""

    def __init__(self, n: int, activation: Activation, parameters: Parameters, dt: float) -> None:
        self.net = Net(n, parameters)
        self.parameters = parameters
        self.activation = activation
        self.dt = dt
        self.ground = self.net.ground_height(parameters.ground_clearance)
        self.q = self.net.rest.ravel().copy()
        self.u = np.zeros_like(self.q)
        self.contact = np.zeros(len(self.net.rest), dtype=bool)
        self.normal_load = self.net.mass[self.net.main] * parameters.gravity

    def _contraction_force(self, activation: FloatArray) -> FloatArray:
        push = self.parameters.contraction_force * activation
        force = np.zeros_like(self.q)
        force[2 * self.net.top + 1] = -push
        force[2 * self.net.bottom + 1] = push
        return force

    def _p10_friction_force(self) -> FloatArray:
        p, main = self.parameters, self.net.main
        mu, force = (p.mu_forward, p.mu_backward), np.zeros_like(self.q)
        force[2 * main] = p10_friction(self.normal_load, self.u[2 * main], mu, p.velocity_threshold)
        return force

    def held(self) -> NDArray[np.bool_]:
        """Return which coordinates are held: y of the main nodes and of the nodes that touch the ground.

        The D = 2 (3 n + 1) coordinates are in the order (x0, y0, x1, y1, ...), and the result has the shape (D,).
        """
        held = np.zeros(self.q.size, dtype=bool)
        held[2 * self.net.main + 1] = True
        held[2 * np.flatnonzero(self.contact) + 1] = True
        return held

    def _contact_after(self, predicted: _Solution) -> NDArray[np.bool_]:
        entering = ~self.contact & (predicted.q[1::2] < self.ground)
        leaving = self.contact & (predicted.residual[1::2] > 0.0)
        return np.asarray((self.contact | entering) & ~leaving)

    def _p2_newton(self, q_k: FloatArray, force: FloatArray) -> _Solution:
        """Iterate (P2) from q_k.

        As in the program, the residual is tested before each update, so that the returned residual belongs to the
        iterate before the last update.
        """
        p, dt, held = self.parameters, self.dt, self.held()
        mass, free = np.repeat(self.net.mass, 2), _free_band(held)
        q = q_k.copy()
        for iteration in range(1, p.max_iterations + 1):  # noqa: B007 - the count is returned
            gradient, band = self.net.p7_gradient_and_band(q)
            f = mass / dt * ((q - q_k) / dt - self.u) + p.elastic_sign * gradient - force
            J = p.elastic_sign * band
            J[NET_HALF_BANDWIDTH] += mass / dt**2
            norm = float(np.linalg.norm(f[~held]))
            if not np.isfinite(norm):
                break  # otherwise the linear solver would spread the invalid value over the whole worm
            q -= _solve_free(J, f, held, free)
            if norm < p.tolerance:
                break
        return _Solution(q, f, norm, iteration)

    def step(self, t: float) -> _Step | None:
        """Advance to the time t by a predictor and, if needed, a corrector.

        Return None if the activation is invalid. The corrector follows if contacts change, or if the normal load comes
        from the residual.
        """
        activation = np.array(self.activation(t), dtype=float)
        if activation.shape != self.net.top.shape or not np.isfinite(activation).all():
            return None
        start, contract, friction = self.q, self._contraction_force(activation), self._p10_friction_force()
        solution = self._p2_newton(start, contract + friction)
        iterations = solution.iterations
        contact, correct = self._contact_after(solution), False
        if (contact != self.contact).any():
            self.contact, correct = contact, True
            if self.parameters.snap:
                start = start.copy()
                start[2 * np.flatnonzero(contact) + 1] = self.ground
        if self.parameters.normal_load == "residual":  # (P9)
            self.normal_load = np.abs(solution.residual[2 * self.net.main + 1])
            friction, correct = self._p10_friction_force(), True
        if correct:
            solution = self._p2_newton(start, contract + friction)
            iterations += solution.iterations
        self.u = (solution.q - start) / self.dt
        self.q = solution.q
        return _Step(start, solution.q, activation, contract, friction, solution, iterations)


@dataclass(frozen=True)
class _Step:
    start: FloatArray
    q: FloatArray
    activation: FloatArray
    contract: FloatArray
    friction: FloatArray
    solution: _Solution
    iterations: int


@spelled
def simulate(
    n: int = 6,
    T_wave: float = 2.0,
    *,
    dt: float = 0.01,
    steps: int = 1000,
    activation: Activation | None = None,
    parameters: Parameters | None = None,
    observer: Observer | None = None,
) -> Run:
    """Run the author's program.

    Parameters
    ----------
    n : int
        Number of segments, at least 1.
    T_wave : float
        Period of the default travelling wave [s].
    dt : float
        Time step [s].
    steps : int
        Number of steps, at least 1.
    activation : callable, optional
        Function of the time [s] that returns the activation of each segment, shape (n,). The program's travelling wave
        if left out.
    parameters : Parameters, optional
        The program's constants if left out.
    observer : callable, optional
        Function that is called with the number of finished steps after each step. If it returns False, the run ends.

    Returns
    -------
    Run
        The run with all finished steps. `Run.stop` says how the run ended.

    Raises
    ------
    ValueError
        If a number is out of range, or the activation has the wrong shape.
    """
    arguments.whole("n", n, le=10_000)  # a step solves a band matrix of six times as many rows
    arguments.whole("steps", steps)
    for name, seconds in (("T_wave", T_wave), ("dt", dt)):
        arguments.number(name, seconds, "s", gt=0.0)
    if activation is None:
        time_steps.require_period(dt, "T_wave", T_wave)
    require_room("steps", steps * bytes_per_step(n), f"{steps} steps of {n} segments", "fewer of them")
    p = Parameters() if parameters is None else parameters
    arguments.instance("parameters", p, Parameters, "planar.published.Parameters")
    wave = travelling_wave(n, T_wave, p) if activation is None else activation
    arguments.array("activation", arguments.function("activation", wave)(0.0), (n,))
    if observer is not None:
        arguments.function("observer", observer, "a function of the number of finished steps")
    worm = _Worm(n, wave, p, dt)
    done, stop = _advance(worm, steps, observer)
    return _collect(n, dt, worm, done, stop)


def _advance(worm: _Worm, steps: int, observer: Observer | None) -> tuple[list[_Step], Stop]:
    done: list[_Step] = []
    residual = np.zeros(worm.q.size)
    for k in range(1, steps + 1):
        try:
            with np.errstate(all="ignore"):  # the test of finiteness catches an overflow
                step = worm.step(k * worm.dt)
        except np.linalg.LinAlgError:
            return done, _stop(worm, Status.SINGULAR, k, residual)
        if step is None:
            return done, _stop(worm, Status.BAD_COMMAND, k, residual)
        if not (np.isfinite(step.q).all() and np.isfinite(step.solution.norm)):
            return done, _stop(worm, Status.NOT_FINITE, k, step.solution.residual)
        done.append(step)
        residual = step.solution.residual
        if observer is not None and not observer(k) and k < steps:
            return done, _stop(worm, Status.INTERRUPTED, k, residual)
    return done, _stop(worm, Status.DONE, steps, residual)


def _stop(worm: _Worm, status: Status, step: int, residual: FloatArray) -> Stop:
    free = np.where(worm.held(), 0.0, np.abs(residual))
    node = int(np.argmax(np.nan_to_num(free, nan=np.inf))) // 2
    with np.errstate(over="ignore", invalid="ignore"):
        norm = float(np.linalg.norm(free))
    return Stop(status, step, step * worm.dt, norm, min(node // 3, len(worm.net.top) - 1))


def _collect(n: int, dt: float, worm: _Worm, done: list[_Step], stop: Stop) -> Run:
    shape = (-1, *worm.net.rest.shape)
    return Run(
        n=n,
        dt=dt,
        parameters=worm.parameters,
        time=np.arange(len(done) + 1, dtype=float) * dt,
        q=np.array([worm.net.rest.ravel(), *(s.q for s in done)]).reshape(shape),
        start=np.array([s.start for s in done]).reshape(shape),
        contraction_force=np.array([s.contract for s in done]).reshape(shape),
        friction_force=np.array([s.friction for s in done]).reshape(shape),
        activation=np.array([s.activation for s in done]).reshape(-1, n),
        newton_iterations=np.array([s.iterations for s in done], dtype=np.int64),
        residual=np.array([s.solution.norm for s in done]),
        stop=stop,
        net=worm.net,
    )
