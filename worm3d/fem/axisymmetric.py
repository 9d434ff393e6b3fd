"""Axisymmetric finite elements of a segment: equilibrium at held distance of the plates and held pressure.

The mesh has one half of the segment, by symmetry. Displacements u = (u_r, u_z) are biquadratic, and the multiplier q of
the volume is bilinear (Q2/Q1). F is the deformation gradient, whose entry around the axis is 1 + u_r/R, and J = det F:

    Pi(u, q; l, p) = integral of (W(C) + q (J - 1) - q^2/(2 bulk)) dV  -  p V(u) + T l,                (FA1)
    V(u) = integral along the inner surface of pi r^2 dz,                                              (FA2)

with pressure p and tension T of a cable along the axis. Energies and forces are those of the whole segment. The plates
hold u_z = (l - l0)/2 at the edge of the wall, and V includes the volume up to the plate. Thus the thrust of the
pressure on the plates is included, and the tangent is symmetric. At equilibrium

    force = dPi/dl,   V = -dPi/dp.                                                                     (FA3)

A state is stable if the tangent, on displacements that keep the volume, has no negative eigenvalue. The tangent of
(FA1) has one negative eigenvalue for each unknown of q. Each further negative eigenvalue is an unstable direction
(Sylvester's law of inertia).

Sources: Simo, Taylor, Pister, Comput. Methods Appl. Mech. Eng. 51:177 (1985) for the mixed form; Bonet and Wood,
Nonlinear Continuum Mechanics for Finite Element Analysis (2008), section 8.5, for pressure as a potential.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from worm3d.fem.description import Segment
from worm3d.fem.potential import Assembly, Potential, operator
from worm3d.values.arrays import FloatArray

try:
    from skfem import Basis, ElementQuad1, ElementQuad2, ElementVector, FacetBasis, MeshQuad, MeshQuad2
except ImportError as error:
    raise ImportError("worm3d fem needs scikit-fem: pip install 'worm3d[fem]'") from error

T = TypeVar("T")

GAUSS_ORDER = 5
"""Degree of the polynomials that the quadrature integrates exactly: three points in each direction, as usual for
biquadratic elements. Degree 7 changes the force of the shipped barrel by 0.015 % (rms), less than the mesh does."""
GRADING = 2.0
"""Exponent that makes elements smaller towards the plate, where the clamped wall bends within a few thicknesses. With
20 by 2 elements, 1 (equal elements) has 2.5 times the error of the force."""
RESIDUAL_TOLERANCE = 1e-11
"""Norm of the residual, in units of energy, divided by shear modulus times volume of the wall, at which Newton's method
stops. Forces are then exact to about eight digits. Rounding prevents values below about 1e-14."""
NEWTON_STEPS = 25
"""Largest number of Newton steps. Most states need 3 to 8, and up to 19 where the wall folds."""
SMALLEST_STEP = 1.0 / 64.0
"""Smallest fraction of a Newton step that the line search tries. Smaller fractions rarely lead to a solution; a smaller
step of the load does."""


@dataclass(frozen=True, eq=False)
class Field:
    """Component of the unknowns: u_r, u_z or q."""

    places: FloatArray
    """Position along the meridian in [0, 1], and depth in [-1, 1], of each node, shape (2, M)."""
    dofs: NDArray[np.intp]
    """Indices of the unknowns, shape (M,)."""
    basis: Any
    """Scalar basis in these coordinates."""

    def at(self, x: FloatArray, places: FloatArray) -> FloatArray:
        """Return the values of the component at places, shape (2, K), as an array of shape (K,)."""
        values: FloatArray = self.basis.probes(places) @ x[self.dofs]
        return values


class Wall:
    """Finite element model of the wall of a segment.

    Parameters
    ----------
    segment : Segment
    along, across : int
        Number of elements along half of the segment, and through the wall.
    held : str
        Components of the displacement that the plate holds: "rz" for a clamped wall, "z" for a wall that slides on the
        plate, "r" for a closed wall without a plate, whose profile ends on the axis.
    """

    def __init__(self, segment: Segment, along: int = 20, across: int = 2, held: str = "rz") -> None:
        self.segment = segment
        flat = MeshQuad.init_tensor(graded(along), np.linspace(-1.0, 1.0, across + 1))
        places = MeshQuad2.from_mesh(flat)  # the coordinates of this mesh are s and depth
        self._mesh = MeshQuad2(segment.wall(*places.doflocs), places.t)
        vector = ElementVector(ElementQuad2())
        basis, of_places = (Basis(mesh, vector, intorder=GAUSS_ORDER) for mesh in (self._mesh, places))
        multipliers = of_places.with_element(ElementQuad1())
        self.displacements, self.multipliers = int(basis.N), int(multipliers.N)
        self.size = basis.N + multipliers.N
        scalar, linear = (Basis(flat, kind(), intorder=GAUSS_ORDER) for kind in (ElementQuad2, ElementQuad1))
        self.fields = tuple(Field(scalar.doflocs, dofs, scalar) for dofs in basis.split_indices())
        self.fields += (Field(linear.doflocs, basis.N + np.arange(linear.N), linear),)

        self._energy = _energy(segment, basis, multipliers, of_places.global_coordinates()[0])

        def facets(axis: int, value: float) -> Any:
            return flat.facets_satisfying(lambda x: np.isclose(x[axis], value), boundaries_only=True)

        self._inside = _volume(FacetBasis(self._mesh, vector, facets=facets(1, -1.0)))
        self._assemblies = [Assembly([each.unknowns], self.size) for each in (self._energy, self._inside)]
        middle, plate = basis.get_dofs(facets(0, 0.0)), basis.get_dofs(facets(0, 1.0))
        self.plate_z = plate.all("u^2") if "z" in held else np.zeros(0, dtype=int)
        fixed = [middle.all("u^2"), self.plate_z, plate.all("u^1") if "r" in held else []]
        self.held = np.unique(np.concatenate(fixed)).astype(int)
        self.free = np.setdiff1d(np.arange(self.size), self.held)
        self._outer = basis.get_dofs(facets(1, 1.0)).all("u^1")
        self._outer_radius = basis.doflocs[0, self._outer]
        corner = segment.wall(np.ones(1), -np.ones(1))[:, 0]
        self._disc = (
            2.0 * np.pi * corner[0] ** 2 * (segment.rest_length / 2.0 - corner[1])
        )  # from the edge to the plate
        self.rest_volume = self.volume(np.zeros(self.size))[0]
        modulus = segment.rubber.shear_modulus
        self.scale = np.where(np.arange(self.size) < basis.N, segment.thickness_m, modulus)
        self.energy_unit = modulus * float(self._energy.weight.sum())

    def energy(self, x: FloatArray) -> tuple[float, FloatArray, csc_matrix]:
        """Return the strain energy with the constraint [J], and its derivatives of first and second order.

        Parameters
        ----------
        x : ndarray, shape (size,)
            Displacements [m], then multipliers [Pa].
        """
        return self._summed(self._energy, self._assemblies[0], x)

    def volume(self, x: FloatArray) -> tuple[float, FloatArray, csc_matrix]:
        """Return the enclosed volume (FA2) [m^3], and its derivatives of first and second order."""
        volume, gradient, curvature = self._summed(self._inside, self._assemblies[1], x)
        return volume + self._disc, gradient, curvature

    def _summed(self, part: Potential, assembly: Assembly, x: FloatArray) -> tuple[float, FloatArray, csc_matrix]:
        gradient, hessian = part.derivatives(x)
        return part.value(x), assembly.vector([gradient]), assembly.matrix([hessian])

    def radius(self, x: FloatArray) -> float:
        """Return the greatest outer radius [m]."""
        return float((self._outer_radius + x[self._outer]).max())

    def at_length(self, length: float) -> FloatArray:
        """Return the held displacements [m] at a distance of the plates [m], shape (held,)."""
        return np.where(np.isin(self.held, self.plate_z), (length - self.segment.rest_length) / 2.0, 0.0)

    def shape(self, x: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return the corners r, z of the deformed elements [m], shape (2, M), and their indices, shape (4, E)."""
        corners = self._mesh.doflocs[:, : self._mesh.t.max() + 1]
        moved = np.stack([x[field.dofs[: corners.shape[1]]] for field in self.fields[:2]])
        return corners + moved, self._mesh.t


def _energy(segment: Segment, basis: Any, multipliers: Any, s: FloatArray) -> Potential:
    """Return the integral of (FA1) over both halves, without pressure and cable. s: position along the meridian.

    Local variables are du_r/dR, du_r/dZ, du_z/dR, du_z/dZ, u_r/R and q. Constants are the tangent of the meridian
    (r, z) and the radius at rest.
    """
    radius = basis.global_coordinates()[0]
    zero = np.zeros_like(radius)
    columns = [[*each[0].grad.reshape(4, *radius.shape), np.asarray(each[0])[0] / radius, zero] for each in basis.basis]
    columns += [[zero] * 5 + [np.broadcast_to(np.asarray(each[0]), radius.shape)] for each in multipliers.basis]
    e, c = ca.SX.sym("e", 6), ca.SX.sym("c", 3)
    F = ca.SX(3, 3)  # entries that are not set stay structural zeros
    F[0, 0], F[0, 1], F[1, 0], F[1, 1], F[2, 2] = 1.0 + e[0], e[1], e[2], 1.0 + e[3], 1.0 + e[4]
    J = (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]) * F[2, 2]
    strain = segment.density(F.T @ F, ca.vertcat(c[0], c[1], 0.0), ca.DM([0.0, 0.0, 1.0]), c[2])
    density = strain + segment.rubber.constraint(J, e[5])
    dofs = np.vstack([basis.element_dofs, basis.N + multipliers.element_dofs]).T
    given = np.stack([*segment.profile.meridian(s.ravel())[1].reshape(2, *s.shape), radius])
    ring = 4.0 * np.pi * radius * basis.dx  # 2 pi R for the ring, and twice for both halves
    return Potential(density, e, c, operator(columns), dofs, ring, given)


def _volume(basis: Any) -> Potential:
    """Return (FA2) for both halves. Local variables are u_r and du_z/ds, constants the radius at rest and dZ/ds."""
    normal_r, normal_z = basis.normals
    tangent = np.stack([normal_z, -normal_r])  # the normal of the wall points to the axis, the tangent to the plate
    columns = [[np.asarray(each[0])[0], np.einsum("dfq,dfq->fq", each[0].grad[1], tangent)] for each in basis.basis]
    e, c = ca.SX.sym("e", 2), ca.SX.sym("c", 2)
    given = np.stack([basis.global_coordinates()[0], tangent[1]])
    density = (c[0] + e[0]) ** 2 * (c[1] + e[1])
    return Potential(density, e, c, operator(columns), basis.element_dofs.T, 2.0 * np.pi * basis.dx, given)


def graded(along: int) -> FloatArray:
    """Return positions of elements along the meridian, with smaller elements close to the plate (`GRADING`)."""
    places: FloatArray = 1.0 - (1.0 - np.linspace(0.0, 1.0, along + 1)) ** GRADING
    return places


@dataclass(frozen=True, eq=False)
class State:
    """Equilibrium of a wall at a length and an input."""

    wall: Wall
    x: FloatArray
    """Displacements [m] and multipliers [Pa], shape (size,)."""
    length: float
    """Distance between the plates [m]."""
    input: float
    """Pressure [Pa], or tension of the cable [N]."""
    iterations: int = 0
    """Newton steps that led to the state."""

    @property
    def is_cable(self) -> bool:
        """Whether the input is a cable."""
        return self.wall.segment.load.input == "cable_N"

    @property
    def pressure(self) -> float:
        """Pressure [Pa]."""
        return 0.0 if self.is_cable else self.input

    @cached_property
    def parts(self) -> tuple[float, FloatArray, csc_matrix, float, FloatArray]:
        """Potential without cable [J], its derivatives of first and second order, volume [m^3], derivative of it."""
        energy, gradient, tangent = self.wall.energy(self.x)
        volume, slope, curvature = self.wall.volume(self.x)
        p = self.pressure
        return energy - p * volume, gradient - p * slope, tangent - p * curvature, volume, slope

    @property
    def potential(self) -> float:
        """Potential (FA1) [J]."""
        return self.parts[0] + (self.input * self.length if self.is_cable else 0.0)

    @property
    def force(self) -> float:
        """Axial force that holds the length (FA3), positive in tension [N]."""
        return float(self.parts[1][self.wall.plate_z].sum()) / 2.0 + (self.input if self.is_cable else 0.0)

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3]."""
        return self.parts[3]

    @property
    def radius(self) -> float:
        """Greatest outer radius [m]."""
        return self.wall.radius(self.x)

    @cached_property
    def unstable_directions(self) -> int:
        """Number of independent directions in which the state is unstable at held length; 0 for a stable state."""
        free, scale = self.wall.free, self.wall.scale
        scaled = self.parts[2][free][:, free].toarray() * scale[free, None] * scale[free]
        negative = int(np.count_nonzero(eigvalsh(scaled) < 0.0))
        return negative - self.wall.multipliers

    @property
    def stable(self) -> bool:
        """Whether no direction is unstable."""
        return self.unstable_directions == 0

    @cached_property
    def force_gradient(self) -> tuple[FloatArray, float]:
        """Derivative of the force by the free unknowns, and by the length at held free unknowns [N/m]."""
        wall, rows = self.wall, self.parts[2][self.wall.plate_z].sum(axis=0).A1 / 2.0
        return rows[wall.free], float(rows[wall.held] @ wall.at_length(1.0 + wall.segment.rest_length))

    @property
    def residual(self) -> float:
        """Norm of the residual, relative (`RESIDUAL_TOLERANCE`)."""
        free = self.wall.free
        return float(np.linalg.norm(self.parts[1][free] * self.wall.scale[free])) / self.wall.energy_unit

    def moved(self, step: FloatArray, length: float, value: float) -> State:
        """Return the state after a step of the free unknowns, at a length and an input."""
        x = self.x.copy()
        x[self.wall.free] += step
        x[self.wall.held] = self.wall.at_length(length)
        return State(self.wall, x, length, value, self.iterations + 1)

    def sensitivity(self, length: float, value: float) -> FloatArray:
        """Return the derivative of the residual by a parameter t with dl/dt = length, d(input)/dt = value."""
        wall, (_, _, tangent, _, slope) = self.wall, self.parts
        held = length * wall.at_length(1.0 + wall.segment.rest_length)
        change: FloatArray = (
            tangent[wall.free][:, wall.held] @ held - (0.0 if self.is_cable else value) * slope[wall.free]
        )
        return change


def rest(wall: Wall) -> State:
    """Return the state at rest: no load, rest length."""
    return State(wall, np.zeros(wall.size), wall.segment.rest_length, 0.0)


def followed(step_to: Callable[[T, float], T | None], start: T, largest: float, least: float) -> tuple[T, float]:
    """Go from t = 0 towards 1 with steps that are halved on failure and doubled after success, within bounds.

    `step_to` returns the result at t from a result close by, or None on failure. Returns the last result and its t.
    """
    result, t, step = start, 0.0, largest
    while t < 1.0:
        step = min(step, 1.0 - t)
        after = t + step if t + step < 1.0 - 1e-12 else 1.0
        found = step_to(result, after)
        if found is not None:
            result, t, step = found, after, min(2.0 * step, largest)
        elif step <= least:
            break
        else:
            step /= 2.0
    return result, t


Constraint = Callable[[State], tuple[float, FloatArray, float]]
"""Function of a state that returns the value of a constraint, its derivative by the free unknowns, and its derivative
by the parameter t of the path."""


def solved(state: State, length: float, value: float) -> State | None:
    """Return the equilibrium at a length [m] and an input, from a close equilibrium; None if Newton's method fails."""
    start = state.parts[1][state.wall.free] + state.sensitivity(length - state.length, value - state.input)
    step = _linear(state, -start)
    if step is None:
        return None
    return constrained(replace(state.moved(step, length, value), iterations=1), (0.0, 0.0), None)


def tangent_of(state: State, direction: tuple[float, float]) -> FloatArray | None:
    """Return the derivative of the free unknowns by t along (length, input) + t direction, None at a turning point."""
    return _linear(state, -state.sensitivity(*direction))


def constrained(state: State, direction: tuple[float, float], constraint: Constraint | None) -> State | None:
    """Return the equilibrium on a path (length, input) + t direction where a constraint is zero; None on failure.

    Without a constraint t stays 0.
    """
    norm = _norm(state, constraint)
    for _ in range(NEWTON_STEPS):
        if norm <= RESIDUAL_TOLERANCE:
            return state
        step = _step(state, direction, constraint)
        if step is None:
            return None
        fraction = 1.0
        while fraction >= SMALLEST_STEP:
            dx, dt = fraction * step[0], fraction * step[1]
            tried = state.moved(dx, state.length + dt * direction[0], state.input + dt * direction[1])
            tried_norm = _norm(tried, constraint)
            if tried_norm < norm:  # False for NaN
                break
            fraction /= 2.0
        else:
            return state if norm <= 100.0 * RESIDUAL_TOLERANCE else None
        state, norm = tried, tried_norm
    return None


def _norm(state: State, constraint: Constraint | None) -> float:
    return float(np.hypot(state.residual, constraint(state)[0] if constraint else 0.0))


def _step(
    state: State, direction: tuple[float, float], constraint: Constraint | None
) -> tuple[FloatArray, float] | None:
    """Return the Newton step of the free unknowns and of t."""
    residual = state.parts[1][state.wall.free]
    if constraint is None:
        plain = _linear(state, -residual)
        return None if plain is None else (plain, 0.0)
    both = _linear(state, np.stack([-residual, -state.sensitivity(*direction)], axis=1))
    if both is None:
        return None
    value, row, by_t = constraint(state)
    t = -(value + row @ both[:, 0]) / (by_t + row @ both[:, 1])
    return both[:, 0] + t * both[:, 1], float(t)


def _linear(state: State, right: FloatArray) -> FloatArray | None:
    """Return the solution of tangent * x = right on the free unknowns, or None if the tangent is singular."""
    free, scale = state.wall.free, state.wall.scale[state.wall.free]
    tangent = state.parts[2][free][:, free]
    scaled = (tangent.multiply(scale[:, None]).multiply(scale[None, :])).tocsc()
    try:
        found = splu(scaled, permc_spec="COLAMD").solve((right.T * scale).T)
    except (RuntimeError, ValueError):  # singular, or not finite
        return None
    return (found.T * scale).T if np.isfinite(found).all() else None
