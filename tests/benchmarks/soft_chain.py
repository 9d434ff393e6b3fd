"""A quasi-static chain of segments on a line with directional Coulomb friction, for `soft_segments.py`.

The joints are at x_0 to x_N [m]. Segment i has the length l_i = x_{i+1} - x_i and the axial force F_i(l_i). Contacts
with given loads are at the middles of the segments and at both end joints, at A x. While a contact moves towards the
head, friction of mu_f times the load pulls it back. While it moves towards the tail, the force is mu_b times the load.
With D x the lengths, the joints at the end of a step from x_n satisfy

    D' (F + n dh/dl) + A' phi(A (x - x_n) + c) = 0,       -mu_b load <= phi <= mu_f load,                      (QC1)

where c is the given motion of the contacts beside the axis, by tilting, n is the load of a segment, and h the height of
its axis: a load lengthens a segment, which becomes narrower. As in the 3D worm, h = sqrt(R^2 - b^2) with the outer
radius R. phi grows linearly over a small displacement (`SLIPS`). An outer iteration linearises the forces F. An inner
iteration solves the remaining equations, which are piecewise linear.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from worm3d import Learned
from worm3d.fem.axisymmetric import State, Wall, rest, solved, tangent_of
from worm3d.fem.sweep import Domain, reached
from worm3d.physics.segment_laws.law import SEGMENT_INPUTS
from worm3d.values.arrays import FloatArray

SLIPS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
"""Displacements [m] at which friction is fully developed; the last one is 0.01 % of the motion in a step."""

MOST_CHANGE, LEAST_STIFFNESS = 2e-3, 20.0
"""Largest change of a length in an outer iteration [m], and least stiffness in the iteration [N/m]. A wall that is
pressed together at low pressure has a negative stiffness."""

OUTER_STEPS = 40
"""Largest number of outer iterations of a step. Most steps need 3 to 8."""

INNER_STEPS, BISECTIONS = 60, 60
"""Largest number of inner iterations at each slip, and of halvings on a step. Few steps need more than ten."""

TINY = 1.0
"""Stiffness against the motion in an inner iteration [N/m], for chains of which all contacts slide. It does not change
the equilibrium, at which outer iterations end."""

FORCE_TOLERANCE = 1e-5
"""Greatest unbalanced force at a joint [N]. Friction of a segment is about 0.01 N."""


DIFFERENCE = 1e-7
"""Change of the length [m] in the difference quotient of the radius."""


class Answer(NamedTuple):
    """Answer of N segments, arrays of shape (N,)."""

    force: FloatArray
    """Axial force [N]."""
    stiffness: FloatArray
    """Derivative of the force by the length [N/m]."""
    radius: FloatArray
    """Outer radius R [m]."""
    widening: FloatArray
    """Derivative of R by the length."""

    def with_load(self, load: FloatArray, offset: float) -> FloatArray:
        """Return F + n dh/dl [N]."""
        found: FloatArray = self.force + load * self.radius * self.widening / np.sqrt(self.radius**2 - offset**2)
        return found


class Segments(Protocol):
    """Segments at lengths [m] and pressures [Pa], each of shape (N,)."""

    def at(self, length: FloatArray, pressure: FloatArray) -> Answer: ...


class FiniteElements:
    """Segments of axisymmetric finite elements. Each starts from its last equilibrium."""

    def __init__(self, wall: Wall, count: int) -> None:
        self._states: list[State] = [rest(wall)] * count
        load = wall.segment.load
        self._domain = Domain((0.6 * wall.segment.rest_length, 1.1 * wall.segment.rest_length), load.values)
        self.solutions = 0

    def at(self, length: FloatArray, pressure: FloatArray) -> Answer:
        pairs = zip(self._states, length.tolist(), pressure.tolist(), strict=True)
        self._states = [self._solved(*each) for each in pairs]
        force, stiffness, radius, widening = np.array([_answer(state) for state in self._states]).T
        return Answer(force, stiffness, radius, widening)

    def _solved(self, state: State, length: float, pressure: float) -> State:
        self.solutions += 1
        found = solved(state, length, pressure)
        if found is None:
            way = reached(state, length, pressure, self._domain)
            if not way.arrived:
                raise ArithmeticError(f"no equilibrium at {1e3 * length:.4g} mm and {pressure:.4g} Pa")
            found = way.state
        return found


def _answer(state: State) -> tuple[float, float, float, float]:
    """Return force, its derivative by the length at held pressure, radius, and its derivative."""
    moved = tangent_of(state, (1.0, 0.0))
    if moved is None:
        raise ArithmeticError(f"a turning point at {1e3 * state.length:.4g} mm and {state.input:.4g} Pa")
    by_free, by_length = state.force_gradient
    x = state.x.copy()
    x[state.wall.free] += DIFFERENCE * moved
    widening = (state.wall.radius(x) - state.radius) / DIFFERENCE
    return state.force, by_length + float(by_free @ moved), state.radius, widening


class OfLaw:
    """Segments with a learned law."""

    def __init__(self, law: Learned) -> None:
        worm: Any = None
        values = {"k": law.law.stiffness, "l0": law.law.rest_length, "tau": 0.0, "offset": law.law.chamber_offset}
        known = {name: ca.DM(values.get(name, 0.0)) for name in SEGMENT_INPUTS}
        known |= {name: ca.DM(each) for name, each in law.values(worm).items()}
        length, contraction = ca.SX.sym("length"), ca.SX.sym("contraction")
        commanded = law.law.rest_length * (1.0 - contraction)
        (spring,) = law.springs(known)
        force = 2.0 * ca.gradient(spring.energy(length, commanded), length)
        radius = law.outline(known, length, commanded)[1]
        answer = ca.vertcat(force, ca.gradient(force, length), radius, ca.gradient(radius, length))
        self._answer = ca.Function("answer", [length, contraction], [answer])
        self._contraction = CubicSpline(law.law.value, law.law.contraction)

    def at(self, length: FloatArray, pressure: FloatArray) -> Answer:
        return Answer(*self._answer(length[None], self._contraction(pressure)[None]).full())


class Ground(NamedTuple):
    """Coefficients of kinetic friction, which also hold at rest, and the distance of the contacts from the axis."""

    forward: float
    backward: float
    offset: float
    """Offset b [m]."""


class Drive(NamedTuple):
    """Given quantities of T steps, or of one step without the first axis."""

    pressure: FloatArray
    """Pressure in each segment after each step, shape (T, N) [Pa]."""
    load: FloatArray
    """Load at the middle of each segment, then at the tail and at the head, shape (T, N+2) [N]."""
    tilting: FloatArray
    """Motion c of these contacts in each step beside the motion of the axis, shape (T, N+2) [m]."""


class Walk(NamedTuple):
    """Record of a chain after each step."""

    joints: FloatArray
    """Shape (T, N+1) [m]."""
    force: FloatArray
    """Shape (T, N) [N]."""
    radius: FloatArray
    """Shape (T, N) [m]."""
    length: FloatArray
    """Shape (T, N) [m]."""


def walk(segments: Segments, joints: FloatArray, drive: Drive, ground: Ground, guess: Walk | None = None) -> Walk:
    """Return the path of a chain.

    Parameters
    ----------
    segments : Segments
    joints : ndarray, shape (N+1,)
        Places of the joints at the start [m].
    drive : Drive
    ground : Ground
    guess : Walk, optional
        Path of a similar chain. Its motion in a step is where the iteration of this step begins.

    Raises
    ------
    ArithmeticError
        There is no equilibrium after a step.
    """
    rows: list[tuple[FloatArray, ...]] = []
    guessed = np.zeros((len(drive.load), len(joints)))
    if guess is not None:
        guessed = np.diff(guess.joints, axis=0, prepend=joints[None])
    for begin, *given in zip(guessed, *drive, strict=True):
        joints, answer = _stepped(segments, joints, joints + begin, Drive(*given), ground)
        rows.append((joints, answer.force, answer.radius, np.diff(joints)))
    return Walk(*(np.array(each) for each in zip(*rows, strict=True)))


def _stepped(
    segments: Segments, before: FloatArray, x: FloatArray, step: Drive, ground: Ground
) -> tuple[FloatArray, Answer]:
    D, A = _matrices(len(step.pressure))
    for _ in range(OUTER_STEPS):
        answer = segments.at(D @ x, step.pressure)
        axial = answer.with_load(step.load[: len(step.pressure)], ground.offset)
        unbalanced = D.T @ axial + A.T @ _friction(A @ (x - before) + step.tilting, step.load, ground, SLIPS[-1])[0]
        if np.abs(unbalanced).max() < FORCE_TOLERANCE:
            return x, answer
        change = _inner(axial, answer.stiffness, x, before, step, ground) - x
        x = x + change * min(1.0, MOST_CHANGE / max(float(np.abs(D @ change).max()), 1e-12))
    raise ArithmeticError(f"the chain is unbalanced by {np.abs(unbalanced).max():.2g} N after {OUTER_STEPS} iterations")


def _matrices(count: int) -> tuple[FloatArray, FloatArray]:
    joints = np.eye(count + 1)
    middles = (joints[1:] + joints[:-1]) / 2.0
    return np.diff(joints, axis=0), np.vstack([middles, joints[[0, -1]]])


def _friction(du: FloatArray, load: FloatArray, ground: Ground, slip: float) -> tuple[FloatArray, FloatArray]:
    """Return the force of friction against the motion, and its derivative."""
    slope = ground.backward * load / slip
    low, high, raw = -ground.backward * load, ground.forward * load, slope * du
    return np.clip(raw, low, high), np.where((raw > low) & (raw < high), slope, 0.0)


def _inner(
    axial: FloatArray, stiffness: FloatArray, x0: FloatArray, before: FloatArray, step: Drive, ground: Ground
) -> FloatArray:
    """Return the equilibrium with axial forces that are linear in the lengths, at the last of `SLIPS`."""
    D, A = _matrices(len(axial))
    x, K = x0, D.T @ (np.maximum(stiffness, LEAST_STIFFNESS)[:, None] * D) + TINY * np.eye(len(x0))

    def residual(at: FloatArray, slip: float) -> tuple[FloatArray, FloatArray]:
        held, slope = _friction(A @ (at - before) + step.tilting, step.load, ground, slip)
        return D.T @ axial + K @ (at - x0) + A.T @ held, slope

    for slip in SLIPS:
        for _ in range(INNER_STEPS):
            unbalanced, slope = residual(x, slip)
            if np.abs(unbalanced).max() < 0.01 * FORCE_TOLERANCE:
                break
            change = -np.linalg.solve(K + A.T @ (slope[:, None] * A), unbalanced)
            x = (
                x
                + _fraction(lambda part, x=x, change=change, slip=slip: change @ residual(x + part * change, slip)[0])
                * change
            )
    return x


def _fraction(slope: Callable[[float], float]) -> float:
    """Return the part of a step, up to 1, at which the potential of the chain is least. It is convex: `slope` grows."""
    low, high = 0.0, 1.0
    if slope(high) > 0.0:
        for _ in range(BISECTIONS):
            middle = (low + high) / 2.0
            low, high = (low, middle) if slope(middle) > 0.0 else (middle, high)
    return high
