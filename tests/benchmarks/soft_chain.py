"""A quasi-static chain of segments on a line with directional Coulomb friction, for `soft_segments.py`.

The joints are at x_0 to x_N [m]. Segment i has the length l_i = x_{i+1} - x_i and the axial force F_i(l_i). Contacts
are at the middles of the segments, at A x. While a contact moves towards the head, friction of mu_f times the load
pulls it back. While it moves towards the tail, the force is mu_b times the load. With D x the lengths, the joints at
the end of a step from x_n satisfy

    D' (F + n dh/dl) + A' phi(A (x - x_n) + c) = 0,       -mu_b n <= phi <= mu_f n,                            (QC1)

where c is the motion of the contacts beside the axis, by tilting, n is the load of a segment, and h the height of its
axis above the undeformed contact: a load lengthens a segment, which becomes narrower. As in the 3D worm,
h = sqrt(R^2 - b^2) with the outer radius R. phi grows linearly over a small displacement (`SLIPS`). An outer iteration
linearises the forces F and n. An inner iteration solves the remaining equations, which are piecewise linear.

The heights z of the joints minimise the energy of the pitch joints with the stiffness k, of the weights w and of the
contacts, which are indented by d_i = h_i - (z_i + z_{i+1})/2 and bear the load n(d, p) = dPsi/dd:

    k/2 sum of (s_i - s_{i-1})^2 + w . z + sum of Psi(d_i, p_i),       s_i = (z_{i+1} - z_i)/l_i,              (QC2)

A segment with the slope s has its contact at h s in front of its middle.
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

FORCE_TOLERANCE, LOAD_TOLERANCE = 1e-5, 1e-9
"""Greatest unbalanced forces at a joint [N], along the chain and across. Friction of a segment is about 0.01 N."""

LEAST_INDENTATION = 1e-9
"""Indentation below which the stiffness of a patch is constant [m]. The load is then below 1e-7 N."""

TINY_HEIGHT = 1e-8
"""Stiffness against a motion of all joints across [N/m], for iterates without contact."""

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


class Support(NamedTuple):
    """How a chain stands on the ground."""

    load: FloatArray
    """Loads n of the segments, shape (N,) [N]."""
    stiffness: FloatArray
    """Derivative of the loads by the heights h, shape (N, N) [N/m]."""
    slope: FloatArray
    """Slopes s, shape (N,)."""


class Contact(Protocol):
    """Loads of contacts [N], and their derivatives by the indentation, at indentations [m] and pressures, (N,)."""

    def at(self, indentation: FloatArray, pressure: FloatArray) -> tuple[FloatArray, FloatArray]: ...


class Elastic(NamedTuple):
    """Contact of a constant stiffness."""

    stiffness: float
    """Stiffness of a segment [N/m]."""

    def at(self, indentation: FloatArray, pressure: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.stiffness * np.maximum(indentation, 0.0), self.stiffness * (indentation > 0.0)


class Patch:
    """Contact of a wall that flat ground has pressed (`worm3d fem --patch`).

    At each pressure of the table, the load is a power of the indentation between two rows, and beyond the rows.
    Between pressures, the logarithm of the load is linear in the logarithm of the pressure. Below the least pressure of
    the table, the contact is as at this pressure.

    Parameters
    ----------
    pressure, indentation, load : ndarray, shape (rows,)
        Columns of the table [Pa], [m], [N].
    """

    def __init__(self, pressure: FloatArray, indentation: FloatArray, load: FloatArray) -> None:
        self._pressures = np.unique(pressure)
        rows = [np.flatnonzero(pressure == each) for each in self._pressures]
        self._curves = [(np.log(indentation[at]), np.log(load[at])) for at in rows]

    def at(self, indentation: FloatArray, pressure: FloatArray) -> tuple[FloatArray, FloatArray]:
        depth = np.maximum(indentation, LEAST_INDENTATION)
        powers = [_on_lines(np.log(depth), *curve) for curve in self._curves]
        at = np.interp(np.log(np.maximum(pressure, 1e-9)), np.log(self._pressures), np.arange(len(powers)))
        low = np.minimum(at.astype(int), len(powers) - 2)
        value, slope = np.moveaxis(np.array(powers), 0, 1)
        row, part = np.arange(len(depth)), at - low
        log, power = ((1.0 - part) * each[low, row] + part * each[low + 1, row] for each in (value, slope))
        load = np.where(indentation > 0.0, np.exp(log), 0.0)
        return load, load * power / depth


def _on_lines(at: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values and slopes of a piecewise linear function that continues beyond its ends."""
    piece = np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2)
    slope = (np.diff(y) / np.diff(x))[piece]
    return y[piece] + slope * (at - x[piece]), slope


class Stand:
    """A chain of segments with pitch joints under its weight, (QC2).

    Parameters
    ----------
    weight : ndarray, shape (N+1,)
        Weights at the joints [N].
    pitch : float
        Stiffness k [N m].
    contact : Contact
    """

    def __init__(self, weight: FloatArray, pitch: float, contact: Contact) -> None:
        self.weight, self.pitch, self.contact = weight, pitch, contact

    def at(self, height: FloatArray, length: FloatArray, pressure: FloatArray) -> Support:
        """Return how the chain stands with the heights h, lengths [m] and pressures [Pa], each of shape (N,).

        Raises
        ------
        ArithmeticError
            There is no equilibrium.
        """
        D, A = _matrices(len(height))
        bent = np.diff(D / length[:, None], axis=0)
        K = self.pitch * bent.T @ bent + TINY_HEIGHT * np.eye(len(self.weight))
        z = np.full(len(self.weight), height.mean())

        def residual(at: FloatArray) -> tuple[FloatArray, FloatArray]:
            load, slope = self.contact.at(height - A @ at, pressure)
            return K @ at + self.weight - A.T @ load, slope

        for _ in range(INNER_STEPS):
            unbalanced, slope = residual(z)
            H = K + A.T @ (slope[:, None] * A)
            if np.abs(unbalanced).max() < LOAD_TOLERANCE:
                rigid = np.diag(slope)
                held = rigid - rigid @ A @ np.linalg.solve(H, A.T @ rigid)
                return Support(self.contact.at(height - A @ z, pressure)[0], held, D @ z / length)
            change = -np.linalg.solve(H, unbalanced)
            z = z + _fraction(lambda part, z=z, change=change: change @ residual(z + part * change)[0]) * change
        raise ArithmeticError(f"the chain does not stand: {np.abs(unbalanced).max():.2g} N are unbalanced")


class Stands(Protocol):
    """How a chain stands with heights [m], lengths [m] and pressures [Pa], each of shape (N,)."""

    def at(self, height: FloatArray, length: FloatArray, pressure: FloatArray) -> Support: ...


class Ground(NamedTuple):
    """Coefficients of kinetic friction, which also hold at rest, and how the chain stands."""

    forward: float
    backward: float
    offset: float
    """Offset b of the contacts from the axis [m]."""
    stands: Stands


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
    load: FloatArray
    """Shape (T, N) [N]."""


def walk(
    segments: Segments, joints: FloatArray, pressure: FloatArray, ground: Ground, guess: Walk | None = None
) -> Walk:
    """Return the path of a chain.

    Parameters
    ----------
    segments : Segments
    joints : ndarray, shape (N+1,)
        Places of the joints at the start [m].
    pressure : ndarray, shape (T, N)
        Pressure in each segment after each step [Pa].
    ground : Ground
    guess : Walk, optional
        Path of a similar chain. Its motion in a step is where the iteration of this step begins.

    Raises
    ------
    ArithmeticError
        There is no equilibrium after a step.
    """
    rows: list[tuple[FloatArray, ...]] = []
    guessed = np.zeros((len(pressure), len(joints)))
    if guess is not None:
        guessed = np.diff(guess.joints, axis=0, prepend=joints[None])
    ahead = np.zeros(pressure.shape[1])  # the contacts before their middles; the start is soon forgotten
    for begin, inside in zip(guessed, pressure, strict=True):
        joints, answer, load, ahead = _stepped(segments, joints, ahead, joints + begin, inside, ground)
        rows.append((joints, answer.force, answer.radius, np.diff(joints), load))
    return Walk(*(np.array(each) for each in zip(*rows, strict=True)))


def _stepped(
    segments: Segments, before: FloatArray, ahead: FloatArray, x: FloatArray, pressure: FloatArray, ground: Ground
) -> tuple[FloatArray, Answer, FloatArray, FloatArray]:
    D, A = _matrices(len(pressure))
    for _ in range(OUTER_STEPS):
        answer = segments.at(D @ x, pressure)
        height = np.sqrt(answer.radius**2 - ground.offset**2)
        rising = answer.radius * answer.widening / height
        stood = ground.stands.at(height, D @ x, pressure)
        axial, tilted = answer.force + stood.load * rising, height * stood.slope
        moved = A @ (x - before) + tilted - ahead
        unbalanced = D.T @ axial + A.T @ _friction(moved, stood.load, ground, SLIPS[-1])[0]
        if np.abs(unbalanced).max() < FORCE_TOLERANCE:
            return x, answer, stood.load, tilted
        stiffness = np.diag(np.maximum(answer.stiffness, LEAST_STIFFNESS)) + np.outer(rising, rising) * stood.stiffness
        change = _inner(axial, stiffness, x, tilted - ahead - A @ before, stood.load, ground) - x
        x = x + change * min(1.0, MOST_CHANGE / max(float(np.abs(D @ change).max()), 1e-12))
    raise ArithmeticError(f"the chain is unbalanced by {np.abs(unbalanced).max():.2g} N after {OUTER_STEPS} iterations")


def _matrices(count: int) -> tuple[FloatArray, FloatArray]:
    joints = np.eye(count + 1)
    return np.diff(joints, axis=0), (joints[1:] + joints[:-1]) / 2.0


def _friction(du: FloatArray, load: FloatArray, ground: Ground, slip: float) -> tuple[FloatArray, FloatArray]:
    """Return the force of friction against the motion, and its derivative."""
    slope = ground.backward * load / slip
    low, high, raw = -ground.backward * load, ground.forward * load, slope * du
    return np.clip(raw, low, high), np.where((raw > low) & (raw < high), slope, 0.0)


def _inner(
    axial: FloatArray, stiffness: FloatArray, x0: FloatArray, moved: FloatArray, load: FloatArray, ground: Ground
) -> FloatArray:
    """Return the equilibrium with axial forces that are linear in the lengths, at the last of `SLIPS`.

    Contacts have moved by A x + `moved`.
    """
    D, A = _matrices(len(axial))
    x, K = x0, D.T @ stiffness @ D + TINY * np.eye(len(x0))

    def residual(at: FloatArray, slip: float) -> tuple[FloatArray, FloatArray]:
        held, slope = _friction(A @ at + moved, load, ground, slip)
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
