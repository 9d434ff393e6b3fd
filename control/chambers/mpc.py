"""Model predictive control of chambers and hinges within the next wave, beside the wave that layer 1 decided.

With u what chambers and hinges do beside the wave, constant over each of K blocks, p a posture, and the misses of the
chamber model's states at the ends of H steps, each over its tolerance a,

    minimise 1/2 [ sum_k (e_head/a_head)^2 + (e_tail/a_tail)^2 + (b/a_roll)^2
                   + sum_j |(u_j - p_j)/a_u|^2 + |(u_j - u_{j-1})/a_rate|^2 ],   c_min <= c + u <= c_max          (CM4)

e are the offsets of head and tail from the path, b is the roll of (CM2), c the wave's own contraction, c_min and c_max
the stroke. The search begins at the better of the plan before and the posture. Its only iteration of Gauss and Newton
linearises a fresh rollout and goes along the step as far as the cost of the true rollout falls, so that a plan is never
worse than the posture by the model, and whatever it says can be done.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import casadi as ca
import numpy as np

from control.chambers.model import ChamberModel
from control.planning.gauss_newton import GaussNewton, Outcome, half_square
from control.tracking.paths import Path
from worm3d import Worm
from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter


@documented
@dataclass(frozen=True, kw_only=True)
class BodyTolerances:
    """Misses that weigh the same, (CM4)."""

    head: float = parameter(0.06, unit="body lengths", gt=0, meaning="a_head, offset of the head from the path")
    tail: float = parameter(0.12, unit="body lengths", gt=0, meaning="a_tail, offset of the tail from the path")
    roll: float = parameter(0.05, unit="rad", gt=0, meaning="a_roll, roll of the body")
    hinge: float = parameter(0.05, unit="rad", gt=0, meaning="a_u, distance of a hinge from the posture")
    chamber: float = parameter(0.002, gt=0, meaning="a_u, contraction beside the wave's")
    hinge_rate: float = parameter(0.03, unit="rad", gt=0, meaning="a_rate, change of a hinge from block to block")
    chamber_rate: float = parameter(0.05, gt=0, meaning="a_rate, change of a contraction from block to block")

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, eq=False)
class BodyPlan:
    """What chambers and hinges are to do beside the wave."""

    time: float
    """Begin of the horizon [s]."""
    block: float
    """Duration of a block [s]."""
    beside: FloatArray
    """Contractions, left ones first, and hinges [rad], shape (K, 3 N - 1)."""
    cost: float
    """Cost, (CM4)."""
    plain_cost: float
    """Cost of the posture."""
    outcome: Outcome
    seconds: float
    """Time that the planning took [s]."""

    @property
    def ok(self) -> bool:
        """Whether the plan can be used: it is finite and no worse than the posture."""
        return bool(np.isfinite(self.beside).all() and self.cost <= self.plain_cost)

    def at(self, t: float) -> FloatArray:
        """Return what is in force at a time [s], shape (3 N - 1,); the last block goes on."""
        k = int((t - self.time) / self.block + 1e-9)
        return np.asarray(self.beside[min(max(k, 0), len(self.beside) - 1)])


class BodyMPC:
    """The planner of a worm's chambers and hinges.

    Parameters
    ----------
    worm : Worm
    model : ChamberModel
    tolerances : BodyTolerances, optional
    step : float
        Time step of the prediction [s].
    steps : int
        Number of steps, H.
    blocks : int
        Number of blocks, K; it divides the steps.
    iterations : int

    Raises
    ------
    ValueError
        Blocks that do not divide the steps.
    """

    def __init__(
        self,
        worm: Worm,
        model: ChamberModel,
        tolerances: BodyTolerances | None = None,
        step: float = 0.1,
        steps: int = 12,
        blocks: int = 4,
        iterations: int = 1,
    ) -> None:
        if blocks < 1 or steps % blocks:
            raise ValueError(f"blocks: got {blocks!r}, must be a whole share of the steps ({steps!r})")
        self.step, self.steps, self.blocks, self._stroke = step, steps, blocks, worm.stroke
        self._model, n, a = model, worm.segments, tolerances or BodyTolerances()
        self._chambers, self._inputs = 2 * n, 3 * n - 1
        self._weights = 1.0 / np.array([a.head * worm.length, a.tail * worm.length, a.roll])
        of_each = [2 * n, n - 1]
        self._pull = np.tile(1.0 / np.repeat([a.chamber, a.hinge], of_each), blocks)
        self._rate = 1.0 / np.repeat([a.chamber_rate, a.hinge_rate], of_each)
        change = np.kron(np.eye(blocks) - np.eye(blocks, k=-1), np.diag(self._rate))
        self._matrix = np.vstack([np.diag(self._pull), change])
        self._search = GaussNewton(self._inputs * blocks, iterations)
        self._rollout, self._slopes = _functions(model, step, steps)
        self.forget()

    @property
    def block(self) -> float:
        """Duration of a block [s]."""
        return self.step * self.steps / self.blocks

    def forget(self) -> None:
        """Drop the last plan: the next search begins at the posture."""
        self._last: BodyPlan | None = None

    def plan(self, t: float, state: FloatArray, wave: FloatArray, wanted: FloatArray, postures: FloatArray) -> BodyPlan:
        """Return the plan from time t [s] on.

        Parameters
        ----------
        t : float
        state : ndarray, shape (n,)
            State of the chamber model.
        wave : ndarray, shape (H, 3 N - 1)
            What the wave commands in each step: contractions, left ones first, and hinges [rad].
        wanted : ndarray, shape (H, 6)
            Where head and tail are to be: point and azimuth of the path for each, `wanted_of`.
        postures : ndarray, shape (K, N - 1)
            Hinges beside the wave towards which each block is pulled [rad].
        """
        began = perf_counter()
        plain = np.hstack([np.zeros((self.blocks, self._chambers)), postures]).ravel()
        before = plain[: self._inputs] if self._last is None else self._last.at(t)
        unchanged = np.zeros(plain.size - self._inputs)
        target = np.concatenate([self._pull * plain, self._rate * before, unchanged])

        def residuals(z: FloatArray) -> FloatArray:
            _, misses = self._rollout(state, self._commands(z, wave).T, wanted.T)
            return np.concatenate([(misses.T * self._weights).ravel(), self._matrix @ z - target])

        def linearised(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            return residuals(z), np.vstack([self._jacobian(z, state, wave, wanted), self._matrix])

        lower, upper = self._bounds(wave)
        starts = [np.clip(plain, lower, upper)]
        if self._last is not None:
            shifted = [self._last.at(t + self.block * (k + 0.5)) for k in range(self.blocks)]
            starts.append(np.clip(np.concatenate(shifted), lower, upper))
        costs = [half_square(residuals(z)) for z in starts]
        found = self._search.minimise(residuals, linearised, starts[int(np.argmin(costs))], lower, upper)
        beside = found.z.reshape(self.blocks, -1)
        made = BodyPlan(t, self.block, beside, found.cost, costs[0], found.outcome, perf_counter() - began)
        self._last = made if made.ok else None
        return made

    def _commands(self, z: FloatArray, wave: FloatArray) -> FloatArray:
        """Return the commands of each step, shape (H, 3 N - 1)."""
        return wave + np.repeat(z.reshape(self.blocks, -1), self.steps // self.blocks, axis=0)

    def _bounds(self, wave: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and greatest z, each of shape (K (3 N - 1),): the wave with it keeps within the stroke."""
        per_block = wave[:, : self._chambers].reshape(self.blocks, -1, self._chambers)
        hinges = np.full((self.blocks, self._inputs - self._chambers), np.pi / 2.0)
        least = np.minimum(self._stroke[0] - per_block.min(axis=1), 0.0)
        most = np.maximum(self._stroke[1] - per_block.max(axis=1), 0.0)
        return np.hstack([least, -hinges]).ravel(), np.hstack([most, hinges]).ravel()

    def _jacobian(self, z: FloatArray, state: FloatArray, wave: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the derivatives of the weighted misses, shape (3 H, K (3 N - 1))."""
        given = self._commands(z, wave)
        after, _ = self._rollout(state, given.T, wanted.T)
        begins = np.column_stack([state, after[:, :-1]])
        parts = (each.reshape(len(each), self.steps, -1) for each in self._slopes(begins, given.T, wanted.T))
        next_state, next_input, miss_state, miss_input = (part.transpose(1, 0, 2) for part in parts)
        jacobian = np.zeros((self.steps, len(self._weights), z.size))
        slope = np.zeros((self._model.size, z.size))
        for k in range(self.steps):
            j = k * self.blocks // self.steps
            own = slice(self._inputs * j, self._inputs * (j + 1))
            jacobian[k] = miss_state[k] @ slope
            jacobian[k][:, own] += miss_input[k]
            slope = next_state[k] @ slope
            slope[:, own] += next_input[k]
        return (jacobian * self._weights[:, None]).reshape(-1, z.size)


def _functions(model: ChamberModel, step: float, steps: int) -> tuple[Buffered, Buffered]:
    """Return rollout and slopes.

    (state, commands, wanted) -> states and misses at the ends of the steps; (states at their begins, commands, wanted)
    -> derivatives of the next states and of the misses to state and command.
    """
    inputs = model.step.size1_in(1)
    state, given, wanted = ca.SX.sym("state", model.size), ca.SX.sym("command", inputs), ca.SX.sym("wanted", 6)
    after = model.step(state, given, step)
    joints = model.joints(after)
    offsets = _offset(joints[-1, :], wanted[:3]), _offset(joints[0, :], wanted[3:])
    misses = ca.vertcat(*offsets, model.roll(after))
    slopes = [ca.densify(ca.jacobian(value, to)) for value in (after, misses) for to in (state, given)]
    rollout = ca.Function("rollout", [state, given, wanted], [after, misses])
    linear = ca.Function("slopes", [state, given, wanted], ca.cse(slopes))
    return Buffered(rollout.mapaccum("rollout", steps)), Buffered(linear.map(steps))


def _offset(place: ca.SX, wanted: ca.SX) -> ca.SX:
    """Return how far a place (x, y) lies to the left of a path with a point and an azimuth, (x, y, azimuth)."""
    return (place[1] - wanted[1]) * ca.cos(wanted[2]) - (place[0] - wanted[0]) * ca.sin(wanted[2])


def wanted_of(path: Path, progress: FloatArray, half: float) -> FloatArray:
    """Return points and azimuths of the path `half` [m] ahead of and behind arc lengths (K,) [m], shape (K, 6)."""
    return np.hstack([np.column_stack([path.point(s), path.heading(s)]) for s in (progress + half, progress - half)])
