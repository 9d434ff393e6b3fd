"""The paper's results, number for number: what its author's program computes.

A regression target, not physics: the program differs from the paper's text (`DIFFERENCES` in
`planar.differences` lists how, with the effect). Written from a description of what the program computes.

The worm of n segments has 3 n + 1 nodes, stored segment by segment: main 0, top 0, bottom 0, main 1, ...,
main n. Five springs a segment (main to main, and the four links of the rhombus), each with the energy

    E = k l0/2 (1 - l/l0)^2                                                         (P7)

One step of implicit Euler solves, on the coordinates that are free,

    f = M/dt ((q - q_k)/dt - u_k) + s gradE - F_friction - F_contract = 0,          (P1), (P3), (P4)
    J = M/dt^2 + s HessE,   q <- q - J^-1 f,                                        (P1), (P2)

with s = -1: the sign of the elastic force is inverted, exactly as (P1) and (P3) print it; s = +1 is mechanics.
Friction acts along x on the main nodes, from the velocity v at the start of the step, with N_i = m_i g:

    F = -mu_forward N if v > eps,  +mu_backward N if v < -eps,  else 0.             (P10)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planar.metrics import FloatArray, p11_work, p12_cost_of_transport
from planar.status import Status, Stop

Activation = Callable[[float], FloatArray]
"""Time [s] -> activation of each segment, ndarray of shape (n,); 1 means the full `contraction_force`."""

Observer = Callable[[int], bool]
"""Called with the number of finished steps; returning False ends the run there."""


@dataclass(frozen=True)
class Parameters:
    """Constants of the author's program; the defaults give the paper's results.

    Attributes
    ----------
    length : float
        Rest length of the worm [m].
    k_spring, k_link : float
        Stiffness of the horizontal spring and of each of the four links of a rhombus, in (P7) [N].
    mass, connector_mass : float
        Mass of the whole worm, and the part of it that the top and bottom connectors share [kg].
    gravity : float
        Only in the normal load of the friction, N_i = m_i g [m/s^2].
    mu_forward, mu_backward : float
        Friction coefficients of (P10) for motion along +x and -x.
    velocity_threshold : float
        eps of (P10) [m/s].
    contraction_force : float
        Force on the connectors at activation 1 [N].
    wavelength : float
        Of the default travelling wave [m].
    ground_clearance : float
        Height of the lowest node at rest above the ground [m].
    elastic_sign : float
        s of the module's equations: -1 as the program, +1 as mechanics wants it.
    rectified : bool
        Whether the default wave is max(0, sin) (the program) or sin (the paper's text).
    tolerance : float
        Newton stops after the update that follows a residual norm below this [N].
    max_iterations : int
        Newton stops there in any case, and the step is kept.
    """

    length: float = 1.0
    k_spring: float = 13.0
    k_link: float = 1e4
    mass: float = 1e-8
    connector_mass: float = 1e-11
    gravity: float = 9.8
    mu_forward: float = 0.03
    mu_backward: float = 0.20
    velocity_threshold: float = 1e-6
    contraction_force: float = 10.0
    wavelength: float = 1.0
    ground_clearance: float = 0.02
    elastic_sign: float = -1.0
    rectified: bool = True
    tolerance: float = 1e-6
    max_iterations: int = 100

    def __post_init__(self) -> None:
        positive = ("length", "k_spring", "k_link", "mass", "wavelength", "tolerance", "max_iterations")
        for name in positive:
            if not (getattr(self, name) > 0 and np.isfinite(getattr(self, name))):
                raise ValueError(f"{name}: got {getattr(self, name)!r}, must be finite and above 0")
        if not 0 < self.connector_mass < self.mass:
            raise ValueError(
                f"connector_mass: got {self.connector_mass!r} kg, must lie between 0 and mass ({self.mass!r} kg)"
            )
        if self.elastic_sign not in (-1.0, 1.0):
            raise ValueError(f"elastic_sign: got {self.elastic_sign!r}, must be -1 (the program) or +1 (mechanics)")


class _Net:
    """Nodes, springs and masses of the worm at rest, and the elastic energy of the springs."""

    def __init__(self, n: int, parameters: Parameters) -> None:
        dL = parameters.length / n
        y0 = np.sqrt(3.0) / 4.0 * dL
        self.main = 3 * np.arange(n + 1)
        self.top = 3 * np.arange(n) + 1
        self.bottom = self.top + 1
        self.rest = np.zeros((3 * n + 1, 2))
        self.rest[self.main, 0] = np.arange(n + 1) * dL
        self.rest[self.top] = np.column_stack([(np.arange(n) + 0.5) * dL, np.full(n, y0)])
        self.rest[self.bottom] = self.rest[self.top] * (1.0, -1.0)

        tail, head = self.main[:-1], self.main[1:]
        self.a = np.concatenate([tail, tail, self.top, tail, self.bottom])
        self.b = np.concatenate([head, self.top, head, self.bottom, head])
        self.k = np.repeat([parameters.k_spring, parameters.k_link], [n, 4 * n])
        self.l0 = np.linalg.norm(self.rest[self.b] - self.rest[self.a], axis=1)

        self.mass = np.empty(3 * n + 1)
        self.mass[self.main] = (parameters.mass - parameters.connector_mass) / (n + 1)
        self.mass[self.top] = self.mass[self.bottom] = parameters.connector_mass / (2 * n)

        size = self.rest.size
        ends = np.column_stack([2 * self.a, 2 * self.a + 1, 2 * self.b, 2 * self.b + 1])
        self._scatter_gradient = ends.ravel()
        self._scatter_hessian = (ends[:, :, None] * size + ends[:, None, :]).ravel()

    def p7_energy(self, x: FloatArray) -> FloatArray:
        """Return the elastic energy (P7) [J] of positions of shape (..., 3n+1, 2)."""
        length = np.linalg.norm(x[..., self.b, :] - x[..., self.a, :], axis=-1)
        energy: FloatArray = (0.5 * self.k * self.l0 * (1.0 - length / self.l0) ** 2).sum(axis=-1)
        return energy

    def p7_gradient_and_hessian(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient (D,) and Hessian (D, D) of (P7) at the flat positions q (D,)."""
        x = q.reshape(-1, 2)
        e = x[self.b] - x[self.a]
        length = np.sqrt((e * e).sum(axis=1))
        t = e / length[:, None]
        slope = -self.k * (1.0 - length / self.l0)
        along = t[:, :, None] * t[:, None, :]
        block = (self.k / self.l0)[:, None, None] * along + (slope / length)[:, None, None] * (np.eye(2) - along)
        pull = slope[:, None] * t
        gradient = np.bincount(self._scatter_gradient, np.hstack([-pull, pull]).ravel(), q.size)
        blocks = np.empty((len(self.k), 4, 4))
        blocks[:, :2, :2] = blocks[:, 2:, 2:] = block
        blocks[:, :2, 2:] = blocks[:, 2:, :2] = -block
        hessian = np.bincount(self._scatter_hessian, blocks.ravel(), q.size**2)
        return gradient, hessian.reshape(q.size, q.size)


@dataclass(frozen=True)
class _Solution:
    q: FloatArray
    residual: FloatArray
    norm: float
    iterations: int


def _p2_newton(
    net: _Net, p: Parameters, q_k: FloatArray, u_k: FloatArray, force: FloatArray, held: NDArray[np.bool_], dt: float
) -> _Solution:
    """Newton's iteration (P2) from q_k; the last tested residual is returned, after one more update."""
    mass = np.repeat(net.mass, 2)
    free = np.flatnonzero(~held)
    on_free = np.ix_(free, free)
    q = q_k.copy()
    for iteration in range(1, p.max_iterations + 1):  # noqa: B007 - the count is returned
        gradient, hessian = net.p7_gradient_and_hessian(q)
        f = mass / dt * ((q - q_k) / dt - u_k) + p.elastic_sign * gradient - force
        J = np.diag(mass) / dt**2 + p.elastic_sign * hessian
        norm = float(np.linalg.norm(f[free]))
        q[free] -= np.linalg.solve(J[on_free], f[free])
        if norm < p.tolerance:
            break
    return _Solution(q, f, norm, iteration)


def travelling_wave(n: int, T_wave: float, parameters: Parameters) -> Activation:
    """Return the program's wave: A_i(t) = max(0, sin(2 pi (x_i/lambda - t/T_wave))), x_i = (i + 1/2) L/n."""
    x = (np.arange(n) + 0.5) / n * parameters.length

    def activation(t: float) -> FloatArray:
        wave = np.sin(2.0 * np.pi * (x / parameters.wavelength - t / T_wave))
        return np.maximum(0.0, wave) if parameters.rectified else wave

    return activation


class _Worm:
    """State of the program between steps, and one step of it."""

    def __init__(self, n: int, activation: Activation, parameters: Parameters, dt: float) -> None:
        self.net = _Net(n, parameters)
        self.parameters = parameters
        self.activation = activation
        self.dt = dt
        self.ground = self.net.rest[:, 1].min() - parameters.ground_clearance
        self.q = self.net.rest.ravel().copy()
        self.u = np.zeros_like(self.q)
        self.contact = np.zeros(len(self.net.rest), dtype=bool)

    def _contraction_force(self, t: float) -> FloatArray:
        push = self.parameters.contraction_force * self.activation(t)
        force = np.zeros_like(self.q)
        force[2 * self.net.top + 1] = -push
        force[2 * self.net.bottom + 1] = push
        return force

    def _p10_friction_force(self) -> FloatArray:
        p, main = self.parameters, self.net.main
        normal = self.net.mass[main] * p.gravity
        v = self.u[2 * main]
        force = np.zeros_like(self.q)
        force[2 * main] = np.select(
            [v > p.velocity_threshold, v < -p.velocity_threshold],
            [-p.mu_forward * normal, p.mu_backward * normal],
            0.0,
        )
        return force

    def _held(self) -> NDArray[np.bool_]:
        held = np.zeros(self.q.size, dtype=bool)
        held[2 * self.net.main + 1] = True
        held[2 * np.flatnonzero(self.contact) + 1] = True
        return held

    def _contact_after(self, predicted: _Solution) -> NDArray[np.bool_]:
        entering = ~self.contact & (predicted.q[1::2] < self.ground)
        leaving = self.contact & (predicted.residual[1::2] > 0.0)
        return (self.contact | entering) & ~leaving

    def step(self, t: float) -> _Step:
        """Advance to time t by predictor and corrector."""
        contract, friction = self._contraction_force(t), self._p10_friction_force()
        start = self.q
        solution = _p2_newton(
            self.net, self.parameters, start, self.u, contract + friction, self._held(), self.dt
        )
        iterations = solution.iterations
        contact = self._contact_after(solution)
        if (contact != self.contact).any():
            self.contact = contact
            start = start.copy()
            start[2 * np.flatnonzero(contact) + 1] = self.ground
            solution = _p2_newton(
                self.net, self.parameters, start, self.u, contract + friction, self._held(), self.dt
            )
            iterations += solution.iterations
        self.u = (solution.q - start) / self.dt
        self.q = solution.q
        return _Step(start, solution.q, contract, friction, solution, iterations)


@dataclass(frozen=True)
class _Step:
    start: FloatArray
    q: FloatArray
    contract: FloatArray
    friction: FloatArray
    solution: _Solution
    iterations: int


@dataclass(frozen=True)
class Run:
    """A run of the program; S finished steps, T = S + 1 instants, n segments.

    Attributes
    ----------
    time : ndarray, shape (T,)
        [s].
    q : ndarray, shape (T, 3n+1, 2)
        Node positions x, y [m]; main node i is node 3 i, then its segment's top and bottom connector.
    start : ndarray, shape (S, 3n+1, 2)
        Positions from which each step was solved: q before it, with touching nodes snapped to the ground [m].
    contraction_force, friction_force : ndarray, shape (S, 3n+1, 2)
        [N].
    activation : ndarray, shape (S, n)
        Of each segment at the end of each step.
    newton_iterations : ndarray, shape (S,)
        Of predictor and corrector together.
    residual : ndarray, shape (S,)
        Norm of the free residual of the last iterate tested [N].
    stop : Stop
        How the run ended.
    """

    n: int
    dt: float
    parameters: Parameters
    time: FloatArray
    q: FloatArray
    start: FloatArray
    contraction_force: FloatArray
    friction_force: FloatArray
    activation: FloatArray
    newton_iterations: NDArray[np.int64]
    residual: FloatArray
    stop: Stop
    _net: _Net = field(repr=False)

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @property
    def unconverged_steps(self) -> int:
        """Number of steps that Newton left above its tolerance (the program goes on)."""
        return int((self.residual >= self.parameters.tolerance).sum())

    @cached_property
    def reported_com(self) -> FloatArray:
        """The program's "centre of mass" (T,) [m]: the mean of entries 3 i of (x0, y0, x1, y1, ...), a slip."""
        flat = self.q.reshape(len(self.q), -1)
        com: FloatArray = flat[:, 3 * np.arange(self.n + 1)].mean(axis=1)
        return com

    @cached_property
    def com(self) -> FloatArray:
        """Centre of mass of all nodes (T, 2) [m]."""
        com: FloatArray = self._net.mass @ self.q / self._net.mass.sum()
        return com

    @cached_property
    def work_contract(self) -> FloatArray:
        """Work of the contraction force over each step, signed, (P11), shape (S,) [J]."""
        return p11_work(self.contraction_force, self.q[1:] - self.start)

    @cached_property
    def work_friction(self) -> FloatArray:
        """Work of the friction force over each step, (P13), shape (S,) [J]; negative where it dissipates."""
        return p11_work(self.friction_force, self.q[1:] - self.start)

    @property
    def reported_distance(self) -> float:
        """Distance that the paper's figures show [m]."""
        return float(self.reported_com[-1] - self.reported_com[0])

    @property
    def true_displacement(self) -> float:
        """Mean displacement of the main nodes along x [m]."""
        return float((self.q[-1] - self.q[0])[self._net.main, 0].mean())

    @property
    def work(self) -> float:
        """Total work as the program counts it: the sum of |F . dq| over the steps [J]."""
        return float(np.abs(self.work_contract).sum())

    @property
    def total_cot(self) -> float:
        """Total cost of transport as the program counts it, work / reported distance [J/m]."""
        return self.work / self.reported_distance if self.reported_distance != 0.0 else float("nan")

    @cached_property
    def cumulative_cot(self) -> FloatArray:
        """The plotted curve, shape (S,) [J/m]: the sum of |work / dx| over the steps with |dx| > 1e-6 m."""
        steps = p12_cost_of_transport(np.abs(self.work_contract), self.reported_com, threshold=1e-6)
        return np.cumsum(np.abs(steps))

    @cached_property
    def energy_balance_error(self) -> float:
        """|Residual of the energy ledger| over the sum of its absolute terms.

        With U = s E, the potential whose force the program really applies, and dq = q - start of each step:
        F_contract . dq + F_friction . dq + [U(start) - U(q_k)]
        = change of kinetic energy + change of U + numerical loss, where the numerical loss of implicit
        Euler, m |du|^2/2 + U(start) - U(q) + gradU(q) . dq, is computed on its own.
        """
        if len(self.time) < 2:
            return 0.0
        mass, sign, dq = self._net.mass, self.parameters.elastic_sign, self.q[1:] - self.start
        u = np.concatenate([np.zeros((1, *dq.shape[1:])), dq / self.dt])
        kinetic = 0.5 * np.einsum("k,tkd->t", mass, u**2)
        U, U_start = sign * self._net.p7_energy(self.q), sign * self._net.p7_energy(self.start)
        gradient = np.array([self._net.p7_gradient_and_hessian(q.ravel())[0] for q in self.q[1:]])
        loss = 0.5 * np.einsum("k,tkd->t", mass, np.diff(u, axis=0) ** 2) + U_start - U[1:]
        loss += sign * p11_work(gradient.reshape(dq.shape), dq)
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
        return float(abs(terms.sum()) / scale) if scale > 0 else 0.0


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
        Time [s] -> activation of each segment, shape (n,); the program's travelling wave if left out.
    parameters : Parameters, optional
        The program's constants if left out.
    observer : callable, optional
        Called after every step with the number of finished steps; returning False ends the run.

    Returns
    -------
    Run
        With what was computed, however the run ended: see `Run.stop`.

    Raises
    ------
    ValueError
        A number out of range, or an activation of the wrong shape.
    """
    for name, value, least in (("n", n, 1), ("steps", steps, 1)):
        if value < least:
            raise ValueError(f"{name}: got {value!r}, must be at least {least}")
    for name, seconds in (("T_wave", T_wave), ("dt", dt)):
        if not (seconds > 0 and np.isfinite(seconds)):
            raise ValueError(f"{name}: got {seconds!r} s, must be finite and above 0")
    p = parameters or Parameters()
    wave = activation or travelling_wave(n, T_wave, p)
    if np.shape(wave(0.0)) != (n,):
        raise ValueError(f"activation: got shape {np.shape(wave(0.0))}, must be ({n},), one value per segment")
    worm = _Worm(n, wave, p, dt)
    done, stop = _advance(worm, steps, observer)
    return _collect(n, dt, worm, done, stop)


def _advance(worm: _Worm, steps: int, observer: Observer | None) -> tuple[list[_Step], Stop]:
    done: list[_Step] = []
    status, residual = Status.DONE, np.zeros(worm.q.size)
    for k in range(1, steps + 1):
        try:
            with np.errstate(all="ignore"):  # what overflows here is caught by the test of finiteness
                step = worm.step(k * worm.dt)
        except np.linalg.LinAlgError:
            status = Status.SINGULAR
            break
        residual = step.solution.residual
        if not (np.isfinite(step.q).all() and np.isfinite(residual).all()):
            status = Status.NOT_FINITE
            break
        done.append(step)
        if observer is not None and not observer(k):
            status = Status.INTERRUPTED if k < steps else Status.DONE
            break
    worst = int(np.argmax(np.nan_to_num(np.abs(residual[~worm._held()]), nan=np.inf)))
    node = int(np.flatnonzero(~worm._held())[worst]) // 2
    norm = float(np.linalg.norm(residual[~worm._held()]))
    return done, Stop(status, k, k * worm.dt, norm, min(node // 3, len(worm.net.top) - 1))


def _collect(n: int, dt: float, worm: _Worm, done: list[_Step], stop: Stop) -> Run:
    shape = (-1, *worm.net.rest.shape)

    def stack(rows: list[FloatArray]) -> FloatArray:
        array = np.array(rows, dtype=float).reshape(shape)
        array.setflags(write=False)
        return array

    return Run(
        n=n,
        dt=dt,
        parameters=worm.parameters,
        time=np.arange(len(done) + 1) * dt,
        q=stack([worm.net.rest.ravel(), *(s.q for s in done)]),
        start=stack([s.start for s in done]),
        contraction_force=stack([s.contract for s in done]),
        friction_force=stack([s.friction for s in done]),
        activation=np.array([worm.activation((k + 1) * dt) for k in range(len(done))]).reshape(-1, n),
        newton_iterations=np.array([s.iterations for s in done], dtype=np.int64),
        residual=np.array([s.solution.norm for s in done]),
        stop=stop,
        _net=worm.net,
    )
