"""A segment between tilted end plates: a 3D model of a quarter of the segment.

The middle cross-section and the plane of bending are planes of symmetry. The model is half of the length and half of
the circumference, meshed with hexahedra: quadratic positions, linear multiplier of the incompressibility (Q2/Q1). The
middle cross-section is at z = 0, the plane of bending is y = 0 and x points to the left. The plate at the end holds the
rim of the wall. It is rigid: a point at X of the body at rest moves to

    x = R(th/2) (X - X_c) + l/2 e_z,   R: rotation about y, X_c: centre of the plate at rest,                    (FB1)

so that l is the distance between the centres of both plates, and th is the angle between the plates. With the
density W + q (J - 1) of `material`, and the enclosed volume V, an equilibrium is a stationary point of

    Pi(l, th, p) = 4 (integral of W + q (J - 1) dX - p V/4),   V/4 = integral of y n_y da,                       (FB2)

where the integral of V is over the deformed inner surface of the quarter. The divergence theorem with the field y e_y
leaves no integral over the plate and over the planes of symmetry, where y or n_y is zero. By the envelope theorem,

    force = dPi/dl,   moment = dPi/dth,   stiffness = d2Pi/dth2,                                                (FB3)

are sums of the residual over the nodes of the plate, and for the stiffness one linear solution. Source: Bonet, Wood,
Nonlinear Continuum Mechanics for Finite Element Analysis (2008), sections 8.5 and 9.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl
import skfem

from worm3d.fem.potential import Assembly, Potential
from worm3d.values.arrays import BoolArray, FloatArray, IntArray

QUADRATURE_ORDER = 4
"""Degree of the polynomials that the quadrature integrates exactly: 3 x 3 x 3 points in an element."""

NEWTON_ITERATIONS = 12
"""Largest number of Newton iterations for a step of the continuation. Steps that converge need 4 to 7; half as many
iterations halve steps that would converge."""

STEP_TOLERANCE = 1e-9
"""Newton's method has converged if no node moves by more than this fraction of the rest length."""

STEP_LIMIT = 0.5
"""Largest motion of a node in an iteration, as a fraction of the rest length. A larger one halves the step."""

SMALLEST_STEP = 1.0 / 64.0
"""Smallest step of the continuation, as a fraction of the way to a state. The continuation stops at a smaller one."""

QUARTERS = 4.0
"""Number of quarters of a segment."""


class Load(NamedTuple):
    """What is held and applied: distance of the plates, their angle, and gauge pressure."""

    length_m: float
    bend_rad: float
    pressure_Pa: float


@dataclass(frozen=True)
class BentState:
    """An equilibrium between tilted plates.

    Attributes
    ----------
    load : Load
        Length, bend and pressure.
    force_N, moment_Nm, bending_stiffness_Nm : float
        First derivatives of the potential by length and bend, and second derivative by the bend [N m/rad], (FB3).
    volume_m3, radius_m : float
        Enclosed volume, and greatest distance of the outer surface from the plane of bending.
    stable : bool
        Whether the tangent at held plates is positive definite.
    unknowns : ndarray, shape (3 nodes + multipliers,)
        Positions of the nodes [m], then multipliers over the shear modulus.
    iterations : int
        Newton iterations since the start.
    """

    load: Load
    force_N: float
    moment_Nm: float
    bending_stiffness_Nm: float
    volume_m3: float
    radius_m: float
    stable: bool
    unknowns: FloatArray
    iterations: int


class NoEquilibriumError(ArithmeticError):
    """The continuation stopped before it reached a state."""


class QuarterModel:
    """The discretised quarter of a segment.

    Parameters
    ----------
    description : Description
        The segment.
    along, around : int
        Number of elements along half of the length, and around half of the circumference.
    """

    def __init__(self, description: Any, along: int = 12, around: int = 8) -> None:
        self.description = description
        self.mesh, self.grid = _mesh(description, along, around)
        basis = skfem.Basis(self.mesh, skfem.ElementHex2(), intorder=QUADRATURE_ORDER)
        multiplier = basis.with_element(skfem.ElementHex1())
        self.nodes = basis.N
        size = 3 * basis.N + multiplier.N
        self.wall = _wall(description, basis, multiplier)
        self.volume = _volume(self.mesh, self.grid)
        self.assembly = Assembly([self.wall.unknowns, self.volume.unknowns], size)
        self.rim = np.flatnonzero(self.grid[0] == 1.0)
        self.held = _held(self.grid, self.rim, size)
        self.free = np.flatnonzero(~self.held)
        self.rest = np.concatenate([self.mesh.doflocs.T.ravel(), np.zeros(multiplier.N)])

    def placed(self, load: Load) -> FloatArray:
        """Return the positions of the rim, (FB1), shape (rim nodes, 3)."""
        offset = np.array([0.0, 0.0, load.length_m / 2.0])
        return self._arms @ _rotation(load.bend_rad / 2.0, 0).T + offset

    def rates(self, load: Load) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the derivatives of (FB1): by length, by bend, twice by bend; each of shape (rim nodes, 3)."""
        by_length = np.zeros((len(self.rim), 3))
        by_length[:, 2] = 0.5
        turned = [self._arms @ _rotation(load.bend_rad / 2.0, order).T / 2.0**order for order in (1, 2)]
        return by_length, turned[0], turned[1]

    def derivatives(self, v: FloatArray, pressure: float) -> tuple[FloatArray, sp.csc_matrix]:
        """Return the gradient and the Hessian of Pi/4, shapes (unknowns,) and (unknowns, unknowns)."""
        wall, enclosed = self.wall.derivatives(v), self.volume.derivatives(v)
        gradient, hessian = ([a, -pressure * b] for a, b in zip(wall, enclosed, strict=True))
        return self.assembly.vector(gradient), self.assembly.matrix(hessian)

    def potential(self, state: BentState) -> float:
        """Return Pi [J], (FB2)."""
        wall, enclosed = self.wall.value(state.unknowns), self.volume.value(state.unknowns)
        return QUARTERS * (wall - state.load.pressure_Pa * enclosed)

    @property
    def _arms(self) -> FloatArray:
        """Positions of the rim from the centre of the plate at rest, shape (rim nodes, 3)."""
        return self.mesh.doflocs.T[self.rim] * (1.0, 1.0, 0.0)


def equilibrium(model: QuarterModel, load: Load, start: BentState | None = None) -> BentState:
    """Return the equilibrium at a load, by continuation in a straight line of loads.

    Parameters
    ----------
    model : QuarterModel
        The segment.
    load : Load
        Length, bend and pressure.
    start : BentState, optional
        An equilibrium nearby. Default: the segment at rest.

    Raises
    ------
    NoEquilibriumError
        The continuation stops before the load.
    """
    rest = Load(model.description.rest_length_m, 0.0, 0.0)
    here, v, count = (rest, model.rest, 0) if start is None else (start.load, start.unknowns, 0)
    begin, done, step = np.array(here), 0.0, 1.0
    while done < 1.0:
        ahead = Load(*(begin + min(done + step, 1.0) * (np.array(load) - begin)))
        found, used = _newton(model, v, ahead)
        count += used
        if found is None:
            step /= 2.0
        else:
            v, done, step = found, min(done + step, 1.0), 2.0 * step
        if step < SMALLEST_STEP:
            reached = Load(*(begin + done * (np.array(load) - begin)))
            raise NoEquilibriumError(
                f"bent segment: found no equilibrium at {_said(load)}; the continuation stopped at {_said(reached)}; "
                "the wall probably buckles there, so leave the state out or use more pressure"
            )
    return _state(model, v, load, count)


def bent_states(
    description: Any,
    states: Iterable[tuple[float, float, float]],
    *,
    along: int = 12,
    around: int = 8,
    report: Callable[[str], None] = lambda _: None,
) -> list[Mapping[str, float]]:
    """Return the rows of a table of states with bent plates.

    Each state starts from the nearest one that is solved. The order of the rows is the order of the states.

    Parameters
    ----------
    description : Description
        The segment.
    states : iterable of (float, float, float)
        Length [m], bend [rad] and pressure [Pa] of each state.
    along, around : int
        Number of elements along half of the length, and around half of the circumference.
    report : callable, optional
        Called with a sentence after each state.
    """
    raise NotImplementedError


def _newton(model: QuarterModel, v: FloatArray, load: Load) -> tuple[FloatArray | None, int]:
    """Return the equilibrium near v, or None, and the number of iterations. The first iteration moves the plate."""
    v = v.copy()
    plate = _of(model.rim)
    scale = model.description.rest_length_m
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        gradient, K = model.derivatives(v, load.pressure_Pa)
        moved = np.zeros(len(v))
        moved[plate] = model.placed(load).ravel() - v[plate]
        residual = (gradient + K @ moved)[model.free]
        moved[model.free] = -_factored(K, model.free).solve(residual)
        largest = np.abs(moved[: 3 * model.nodes]).max() / scale
        if not largest < STEP_LIMIT:
            return None, iteration
        v += moved
        if largest < STEP_TOLERANCE:
            return v, iteration
    return None, NEWTON_ITERATIONS


def _state(model: QuarterModel, v: FloatArray, load: Load, iterations: int) -> BentState:
    """Return what is measured at an equilibrium, (FB3)."""
    gradient, K = model.derivatives(v, load.pressure_Pa)
    factored = _factored(K, model.free)
    reaction = gradient[_of(model.rim)]
    by_length, by_bend, twice = (rate.ravel() for rate in model.rates(load))
    moved = np.zeros(len(v))
    moved[_of(model.rim)] = by_bend
    moved[model.free] = -factored.solve((K @ moved)[model.free])
    return BentState(
        load=load,
        force_N=QUARTERS * float(reaction @ by_length),
        moment_Nm=QUARTERS * float(reaction @ by_bend),
        bending_stiffness_Nm=QUARTERS * float(moved @ (K @ moved) + reaction @ twice),
        volume_m3=QUARTERS * model.volume.value(v),
        radius_m=float(v[1 : 3 * model.nodes : 3].max()),
        stable=bool(np.sum(factored.U.diagonal() < 0.0) == len(v) - 3 * model.nodes),
        unknowns=v,
        iterations=iterations,
    )


def _factored(K: sp.csc_matrix, free: IntArray) -> spl.SuperLU:
    """Return the factors of the rows and columns `free`. Pivots stay on the diagonal, so that their signs are inertia."""
    options = {"SymmetricMode": True}
    return spl.splu(K[free][:, free].tocsc(), permc_spec="COLAMD", diag_pivot_thresh=0.0, options=options)


def _of(nodes: IntArray) -> IntArray:
    """Return the indices of the coordinates of nodes, node by node."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _rotation(angle: float, order: int) -> FloatArray:
    """Return a rotation about y, or its derivative by the angle of the given order: e_z turns to e_x."""
    c, s = np.cos(angle + order * np.pi / 2.0), np.sin(angle + order * np.pi / 2.0)
    return np.array([[c, 0.0, s], [0.0, 1.0 if order == 0 else 0.0, 0.0], [-s, 0.0, c]])


def _said(load: Load) -> str:
    return f"length {load.length_m:.4g} m, bend {load.bend_rad:.3g} rad, pressure {load.pressure_Pa:.4g} Pa"


def _mesh(description: Any, along: int, around: int) -> tuple[skfem.MeshHex2, FloatArray]:
    """Return the mesh, and the places of its nodes along (0 to 1), across the wall and around, shape (3, nodes)."""
    lines = (np.linspace(0.0, 1.0, n + 1) for n in (along, 1, around))
    grid = skfem.MeshHex2.from_mesh(skfem.MeshHex.init_tensor(*lines))
    s, across, angle = grid.doflocs[0], grid.doflocs[1], np.pi * grid.doflocs[2]
    r, z = description.wall(s, across)
    return replace(grid, doflocs=np.array([r * np.cos(angle), r * np.sin(angle), z])), grid.doflocs


def _held(grid: FloatArray, rim: IntArray, size: int) -> BoolArray:
    """Return which unknowns the planes of symmetry and the plate hold, shape (size,)."""
    held = np.zeros(size, bool)
    held[3 * np.flatnonzero(grid[0] == 0.0) + 2] = True
    held[3 * np.flatnonzero((grid[2] == 0.0) | (grid[2] == 1.0)) + 1] = True
    held[_of(rim)] = True
    return held


def _wall(description: Any, basis: skfem.Basis, multiplier: skfem.Basis) -> Potential:
    """Return the strain energy of the wall. Local variables: F row by row, and the multiplier over the shear modulus."""
    n = basis.Nbfun
    B = np.zeros((*basis.dx.shape, 10, 3 * n + multiplier.Nbfun))
    for i in range(3):
        B[:, :, 3 * i : 3 * i + 3, i * n : (i + 1) * n] = _gradients(basis)
    B[:, :, 9, 3 * n :] = _values(multiplier)
    unknowns = np.hstack([_coordinates(basis), 3 * basis.N + multiplier.element_dofs.T])
    e = ca.SX.sym("e", 10)
    F = ca.reshape(e[:9], 3, 3).T
    rubber = description.rubber
    density = rubber.density(F.T @ F) + rubber.constraint(ca.det(F), e[9] * rubber.shear_modulus)
    return Potential(density, e, ca.SX.sym("c", 0), B, unknowns, basis.dx, np.zeros((0, *basis.dx.shape)))


def _volume(mesh: skfem.MeshHex2, grid: FloatArray) -> Potential:
    """Return V/4, (FB2). Local variables: F row by row, and y. The constant is the normal N, with n da = cof(F) N dA."""
    inner = np.flatnonzero((grid[1][mesh.facets] == 0.0).all(axis=0))
    basis = skfem.FacetBasis(mesh, skfem.ElementHex2(), facets=inner, intorder=QUADRATURE_ORDER)
    n = basis.Nbfun
    B = np.zeros((*basis.dx.shape, 10, 3 * n))
    for i in range(3):
        B[:, :, 3 * i : 3 * i + 3, i * n : (i + 1) * n] = _gradients(basis)
    B[:, :, 9, n : 2 * n] = _values(basis)
    e, N = ca.SX.sym("e", 10), ca.SX.sym("N", 3)
    density = -e[9] * ca.dot(ca.cross(e[6:9], e[0:3]), N)  # N points out of the wall, into the gas
    return Potential(density, e, N, B, _coordinates(basis), basis.dx, np.asarray(basis.normals))


def _gradients(basis: skfem.Basis) -> FloatArray:
    """Return the gradients of the shape functions, shape (elements, points, 3, functions)."""
    return np.array([basis.basis[i][0].grad for i in range(basis.Nbfun)]).transpose(2, 3, 1, 0)


def _values(basis: skfem.Basis) -> FloatArray:
    """Return the shape functions, shape (elements, points, functions)."""
    values = [np.broadcast_to(basis.basis[i][0].value, basis.dx.shape) for i in range(basis.Nbfun)]
    return np.array(values).transpose(1, 2, 0)


def _coordinates(basis: skfem.Basis) -> IntArray:
    """Return the indices of all x, then y, then z, of the nodes of each element, shape (elements, 3 functions)."""
    return np.hstack([3 * basis.element_dofs.T + i for i in range(3)])
