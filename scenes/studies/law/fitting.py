"""The joint fit of a law's energy, of its free contraction and of its free volume to the states of a segment.

The free contraction a(u) and the free volume V_free(u) are cubic splines of the input u (pressure or cable force), with
the coefficients c and v. a(0) is 0, and c is monotone: its steps are exponentials of unknowns. With the energy U of a
chamber, (SL5) of `worm3d.physics.segment_laws.learned`, the segment has the potential 2 U(l, a(u)), and

    force = 2 dU/dl                                                                                    (LF1)
    volume = V_free(u) - 2 dU/da a'(u)                                                                 (LF2)

The weights of N_U, the steps of c, and v minimise the squares of the errors of (LF1) and (LF2) together, so that forces
are the gradient of one energy. The Jacobian is exact. The radius is fitted afterwards, since it depends only on l and
a.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from scenes.studies.law.free import Free, States
from worm3d.physics.segment_laws.learned import Learned
from worm3d.physics.segment_laws.network import ENERGY_SIZES, RADIUS_SIZES, weights_of
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

MOST_ITERATIONS = 300
"""Largest number of evaluations in a fit from one start."""

FORCE_FLOOR = 0.2
"""Force, as a fraction of the rms force, above which errors of the force count relative to the force."""

ENERGY_WEIGHTS, RADIUS_WEIGHTS = weights_of(ENERGY_SIZES), weights_of(RADIUS_SIZES)


@dataclass(frozen=True)
class Scales:
    """Numbers of a law other than the weights of the networks, (SL5) and (SL6)."""

    rest_length: float
    """Rest length l0 [m]."""
    stiffness: float
    """Stiffness k of both chambers together [N]."""
    x_mid: float
    x_half: float
    y_mid: float
    y_half: float
    energy: float
    """Scale E of the learned energy of a chamber [J]."""
    radius_mid: float
    """Radius R_mid [m]."""
    radius: float
    """Scale R_scale of the radius [m]."""

    def inputs(self, contraction: Any) -> tuple[dict[str, Any], Any]:
        """Return the inputs of the methods of `Learned` other than weights, and the commanded rest length."""
        columns = ca.DM([self.x_mid, self.x_half, self.y_mid, self.y_half, self.energy, self.radius_mid, self.radius])
        own = {"k": self.stiffness, "l0": self.rest_length, "offset": 0.0, "tau": 0.0, "scales": columns}
        return own, self.rest_length * (1.0 - contraction)


class _OverStates:
    """A function of one state, evaluated at many states without copies; the first input is common to all states."""

    def __init__(self, function: ca.Function, count: int) -> None:
        sizes = [function.numel_in(0), *(count for _ in range(1, function.n_in()))]
        shapes = [function.size_out(k) for k in range(function.n_out())]
        self._inputs = [np.zeros(size) for size in sizes]
        self._outputs = [np.zeros((count, columns, rows)) for rows, columns in shapes]
        buffer: Any
        buffer, self._run = function.map("states", "serial", count, [0], []).buffer()
        self._buffer = buffer  # owns the memory in which the function works
        for k, array in enumerate(self._inputs):
            buffer.set_arg(k, memoryview(array.data))
        for k, flat in enumerate(output.reshape(-1) for output in self._outputs):
            buffer.set_res(k, memoryview(flat.data))

    def __call__(self, *inputs: FloatArray) -> list[FloatArray]:
        """Return the outputs, each of shape (S, rows, columns)."""
        for own, given in zip(self._inputs, inputs, strict=True):
            own[:] = given
        self._run()
        return [output.transpose(0, 2, 1).copy() for output in self._outputs]


@lru_cache(maxsize=32)
def segment_function(scales: Scales, count: int) -> _OverStates:
    """Return the function of a straight segment for `count` states.

    Inputs: weights of N_U, length, contraction a, and a'(u). Outputs: the force (LF1) and the second term of (LF2),
    shape (S, 2, 1), and the Jacobian of both with respect to the weights, a and a'(u), shape (S, 2, weights + 2).
    """
    weights = ca.SX.sym("weights", ENERGY_WEIGHTS)
    length, contraction, slope = (ca.SX.sym(name) for name in ("length", "contraction", "slope"))
    own, commanded = scales.inputs(contraction)
    (spring,) = Learned.springs({**own, "energy": weights})
    potential = 2.0 * spring.energy(length, commanded)
    both = ca.vertcat(ca.gradient(potential, length), -ca.gradient(potential, contraction) * slope)
    jacobian = ca.densify(ca.jacobian(both, ca.vertcat(weights, contraction, slope)))
    return _OverStates(ca.Function("segment", [weights, length, contraction, slope], [both, jacobian]), count)


@lru_cache(maxsize=32)
def radius_function(scales: Scales, count: int) -> _OverStates:
    """Return the function with the radius (SL6) of `count` states, and its Jacobian with respect to the weights."""
    weights, length, contraction = ca.SX.sym("weights", RADIUS_WEIGHTS), ca.SX.sym("length"), ca.SX.sym("contraction")
    own, commanded = scales.inputs(contraction)
    radius = Learned.outline({**own, "radius": weights}, length, commanded)[1]
    jacobian = ca.densify(ca.jacobian(radius, weights))
    return _OverStates(ca.Function("radius", [weights, length, contraction], [radius, jacobian]), count)


@dataclass(frozen=True, eq=False)
class Fit(ReadOnly):
    """A fitted law."""

    scales: Scales
    energy: FloatArray
    """Weights of N_U, shape (67,)."""
    radius: FloatArray
    """Weights of N_R, shape (25,)."""
    free: Free

    def force(self, length: FloatArray, at: FloatArray) -> FloatArray:
        """Return the forces at lengths and inputs, each of shape (S,) [N]."""
        return self._terms(length, at)[:, 0]

    def volume(self, length: FloatArray, at: FloatArray) -> FloatArray:
        """Return the volumes at lengths and inputs, each of shape (S,) [m^3]."""
        return self._terms(length, at)[:, 1] + self.free.volume(at)

    def _terms(self, length: FloatArray, at: FloatArray) -> FloatArray:
        a, slope = self.free.contraction(at), self.free.contraction(at, 1)
        return segment_function(self.scales, len(at))(self.energy, length, a, slope)[0][:, :, 0]

    def outer_radius(self, length: FloatArray, at: FloatArray) -> FloatArray:
        """Return the outer radii at lengths and inputs, each of shape (S,) [m]."""
        return self.radius_of(length, self.free.contraction(at))

    def radius_of(self, length: FloatArray, contraction: FloatArray) -> FloatArray:
        """Return the outer radii at lengths and contractions, each of shape (S,) [m]."""
        return radius_function(self.scales, len(length))(self.radius, length, contraction)[0][:, 0, 0]


class _EnergyProblem:
    """Least-squares problem of the energy. The unknowns are the weights and the unknowns of `free`."""

    def __init__(self, begin: Fit, states: States, penalty: float) -> None:
        free = begin.free
        self._begin, self._length = begin, states.length
        self._function = segment_function(begin.scales, len(states))
        self._basis = free.basis(states.input)
        self._sums = [free.sums(states.input, order) for order in (0, 1)]
        self._force, self._force_weights = states.force, force_weights(states.force)[:, None]
        self._volume = states.volume
        self._volume_weight = 0.0 if states.volume is None else 1.0 / float(np.std(states.volume))
        parts = np.eye(ENERGY_WEIGHTS), np.diff(np.eye(len(free.log_steps)), axis=0), np.zeros((0, len(free.volumes)))
        self._penalties = np.sqrt(penalty * len(states)) * block_diag(*parts)
        self._at: FloatArray = np.zeros(0)

    def solve(self) -> Fit:
        """Return the best law, from the law at the start."""
        free = self._begin.free
        start = np.concatenate([self._begin.energy, free.log_steps, free.volumes])
        weights, free = self._split(_solved(self.residuals, self.jacobian, start))
        return replace(self._begin, energy=weights, free=free)

    def _split(self, unknowns: FloatArray) -> tuple[FloatArray, Free]:
        weights, rest = unknowns[:ENERGY_WEIGHTS], unknowns[ENERGY_WEIGHTS:]
        steps = len(self._begin.free.log_steps)
        return weights, replace(self._begin.free, log_steps=rest[:steps], volumes=rest[steps:])

    def _evaluate(self, unknowns: FloatArray) -> tuple[FloatArray, Free]:
        weights, free = self._split(unknowns)
        if not np.array_equal(unknowns, self._at):
            steps = np.exp(free.log_steps)
            self._values, self._of = self._function(weights, self._length, *(sums @ steps for sums in self._sums))
            self._at = unknowns.copy()
        return weights, free

    def residuals(self, unknowns: FloatArray) -> FloatArray:
        """Return the weighted errors of forces and volumes, weights, and differences of the logarithms of steps."""
        _, free = self._evaluate(unknowns)
        errors = [self._force_weights[:, 0] * (self._values[:, 0, 0] - self._force)]
        if self._volume is not None:
            errors.append(self._volume_weight * (self._values[:, 1, 0] + self._basis @ free.volumes - self._volume))
        return np.concatenate([*errors, self._penalties @ unknowns])

    def jacobian(self, unknowns: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals."""
        _, free = self._evaluate(unknowns)
        blocks = [self._force_weights * self._rows(0, free, np.zeros_like(self._basis))]
        if self._volume is not None:
            blocks.append(self._volume_weight * self._rows(1, free, self._basis))
        return np.vstack([*blocks, self._penalties])

    def _rows(self, output: int, free: Free, of_volumes: FloatArray) -> FloatArray:
        of = self._of[:, output]
        a, slope = of[:, [ENERGY_WEIGHTS]], of[:, [ENERGY_WEIGHTS + 1]]
        steps = (a * self._sums[0] + slope * self._sums[1]) * np.exp(free.log_steps)
        return np.hstack([of[:, :ENERGY_WEIGHTS], steps, of_volumes[:, : len(free.volumes)]])


def force_weights(force: FloatArray, rms: float | None = None) -> FloatArray:
    """Return the weights of errors of the force, of its shape [1/N]. The rms of the forces can be given [N]."""
    size = np.sqrt(np.mean(force**2)) if rms is None else rms
    found: FloatArray = 1.0 / np.hypot(FORCE_FLOOR * size, force)
    return found


def fit_energy(begin: Fit, states: States, penalty: float) -> Fit:
    """Return the law whose energy and functions of the input fit states, from a law at the start.

    The penalty is the weight of two sums of squares beside the mean square of the relative errors: of all weights, and
    of the differences between the logarithms of neighbouring steps of a(u). Without the latter, steps can vanish.
    """
    return _EnergyProblem(begin, states, penalty).solve()


def fit_radius(begin: Fit, states: States, penalty: float) -> Fit:
    """Return the law whose radius fits states, from a law at the start; see `fit_energy`."""
    scale, function = begin.scales.radius, radius_function(begin.scales, len(states))
    contraction, ridge = begin.free.contraction(states.input), np.sqrt(penalty * len(states)) * np.eye(RADIUS_WEIGHTS)

    def residuals(at: FloatArray) -> FloatArray:
        radius = function(at, states.length, contraction)[0][:, 0, 0]
        return np.concatenate([(radius - states.radius) / scale, ridge @ at])

    def jacobian(at: FloatArray) -> FloatArray:
        return np.vstack([function(at, states.length, contraction)[1][:, 0] / scale, ridge])

    return replace(begin, radius=_solved(residuals, jacobian, begin.radius))


def _solved(residuals: Callable[..., FloatArray], jacobian: Callable[..., FloatArray], start: FloatArray) -> FloatArray:
    found = least_squares(residuals, start, jac=jacobian, method="lm", max_nfev=MOST_ITERATIONS, ftol=1e-4, xtol=1e-9)
    return np.asarray(found.x)


def drawn(sizes: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return random weights. The weights of the last layer are a tenth of the others, so that its output is small."""
    layers = []
    for layer, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        size = 0.1 if layer == len(sizes) - 2 else 1.0
        layers += [size * rng.standard_normal(fan_in * fan_out), size * rng.uniform(-1.0, 1.0, fan_out)]
    return np.concatenate(layers)
