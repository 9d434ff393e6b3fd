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

are sums of the residual over the nodes of the plate, and for the stiffness one linear solution. Flat rigid ground
without friction at x = d presses against the outer surface. It is stiff, with the energy and the load

    Pi_g = integral of kappa/2 max(0, x - d)^2 dA over the outer surface at rest,   load = -dPi/dd.              (FB4)

Sources: Bonet, Wood, Nonlinear Continuum Mechanics for Finite Element Analysis (2008), sections 8.5 and 9.4; Wriggers,
Computational Contact Mechanics (2006), section 6.3, for (FB4).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from scipy.linalg import eigvalsh

from worm3d.fem.axisymmetric import followed, graded
from worm3d.fem.description import Segment
from worm3d.fem.potential import Assembly, Potential, operator
from worm3d.values import arguments
from worm3d.values.arrays import BoolArray, FloatArray, IntArray

try:
    import skfem
except ImportError as error:
    raise ImportError("worm3d fem needs scikit-fem: pip install 'worm3d[fem]'") from error

QUADRATURE_ORDER = 4
"""Degree of the polynomials that the quadrature integrates exactly: 3 x 3 x 3 points in an element."""

NEWTON_ITERATIONS = 12
"""Largest number of Newton iterations for a step of the continuation. Most steps need 4 to 7, and up to 12 where fibres
become slack. Half this number doubles the time, and double this number changes nothing for the barrel in `description`.
"""

STEP_TOLERANCE = 1e-7
"""Newton's method has converged if no node moves by more than this fraction of the rest length in an iteration. A
hundredth of this value changes no force of the barrel in `description` by more than 2e-9 N, and needs a quarter more
iterations. A hundred times this value changes forces by up to 1e-5 N."""

STEP_LIMIT = 0.5
"""Largest motion of a node in an iteration, as a fraction of the rest length. Larger motions are signs of divergence,
and the step is halved. Half and double give the same results for the barrel in `description`."""

SMALLEST_STEP = 1.0 / 64.0
"""Smallest step of the continuation, as a fraction of the way to a state. The continuation stops at a smaller one."""

GREATEST_BEND = np.pi / 2.0
"""Largest angle between the plates [rad]. Larger angles let the wall of usual segments touch itself, without contact
in this model."""

BENDS = (0.1, 0.2, 0.3, 0.4)
"""Angles between the plates of `with_bends` [rad]. Up to 0.4 rad, moments of the shipped barrel are linear within 2.1 %
at 3 kPa and above. Where the wall is nearly slack they grow faster: up to 18 % at 1.5 kPa, up to 90 % at 0.5 kPa."""

NO_GROUND = 1e3
"""Distance of the ground from the axis that stands for no ground [m]."""

GROUND_STIFFNESS = 1000.0
"""Stiffness kappa of (FB4), relative to the shear modulus over the thickness of the wall. A thirtieth needs two
thirds of the iterations, and changes the load on the shipped barrel by 0.8 %, on a thick sphere by 20 to 30 %."""

PRESSED = (0.005, 0.01, 0.02, 0.04)
"""Indentations of `pressed_states`, as fractions of the outer radius. The shipped barrel then bears 0.02 to 2 N, which
is 0.1 to 12 times the weight of a segment of the default worm."""

QUARTERS = 4.0
"""Number of quarters of a segment."""


class Condition(NamedTuple):
    """Held distance of the plates, held angle between the plates, gauge pressure, distance of ground from the axis."""

    length_m: float
    bend_rad: float
    pressure_Pa: float
    ground_m: float = NO_GROUND


@dataclass(frozen=True)
class BentState:
    """An equilibrium between tilted plates.

    Attributes
    ----------
    condition : Condition
        Length, bend, pressure and ground.
    force_N, moment_Nm, bending_stiffness_Nm : float
        First derivatives of the potential by length and bend, and second derivative by the bend [N m/rad], (FB3).
    load_N : float
        Force between wall and ground, (FB4).
    volume_m3, radius_m : float
        Enclosed volume, and greatest distance of the outer surface from the plane of bending.
    stable : bool
        Whether the tangent at held plates is positive definite.
    unknowns : ndarray, shape (3 nodes + multipliers + 1,)
        Positions of the nodes [m], then multipliers over the shear modulus, then the distance of the ground [m].
    iterations : int
        Newton iterations since the start.
    """

    condition: Condition
    force_N: float
    moment_Nm: float
    bending_stiffness_Nm: float
    load_N: float
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
    segment : Segment
        The segment.
    along, around, across : int
        Number of elements along half of the length, around half of the circumference, and through the wall.
    pressed : bool
        Whether elements are smaller where the ground touches first.
    """

    def __init__(
        self, segment: Segment, along: int = 12, around: int = 4, across: int = 1, *, pressed: bool = False
    ) -> None:
        self.segment = segment
        length, depth, turn = (np.linspace(0.0, 1.0, n + 1) for n in (along, across, around))
        lines = (np.sin(np.pi / 2.0 * length) ** 2, depth, turn**2) if pressed else (graded(along), depth, turn)
        self.mesh, self.grid = _mesh(segment, lines)
        basis = skfem.Basis(self.mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=QUADRATURE_ORDER)
        multiplier = basis.with_element(skfem.ElementHex1())
        self.nodes, self.multipliers = basis.N // 3, multiplier.N
        size = basis.N + multiplier.N + 1
        self.wall = _wall(segment, self.grid, basis, multiplier)
        self.volume = _volume(self.mesh, self.grid)
        self.ground = _ground(segment, self.mesh, self.grid, size - 1)
        self.assembly = Assembly([each.unknowns for each in (self.wall, self.volume, self.ground)], size)
        self.rim = np.flatnonzero(self.grid[0] == 1.0)
        self.driven = np.append(_of(self.rim), size - 1)
        self.held = _held(self.grid, self.driven, size)
        self.free = np.flatnonzero(~self.held)
        inside = segment.wall(np.ones(1), -np.ones(1))[:, 0]
        self.recess = float(np.pi * inside[0] ** 2 * (segment.rest_length - 2.0 * inside[1]))
        self.rest = np.concatenate([self.mesh.doflocs.T.ravel(), np.zeros(multiplier.N), [NO_GROUND]])

    def placed(self, condition: Condition) -> FloatArray:
        """Return the unknowns `driven`: positions of the rim, (FB1), and distance of the ground, shape (driven,)."""
        offset = np.array([0.0, 0.0, condition.length_m / 2.0])
        return np.append(self._arms @ _rotation(condition.bend_rad / 2.0, 0).T + offset, condition.ground_m)

    def rates(self, condition: Condition) -> list[FloatArray]:
        """Return the derivatives of `placed` by length, by bend, and twice by bend; each of shape (driven,)."""
        by_length = np.tile([0.0, 0.0, 0.5], (len(self.rim), 1))
        turned = [self._arms @ _rotation(condition.bend_rad / 2.0, order).T / 2.0**order for order in (1, 2)]
        return [np.append(rate, 0.0) for rate in (by_length, *turned)]

    def derivatives(self, v: FloatArray, pressure: float) -> tuple[FloatArray, sp.csc_matrix]:
        """Return the gradient and the Hessian of Pi/4, shapes (unknowns,) and (unknowns, unknowns)."""
        parts = ((self.wall, 1.0), (self.volume, -pressure), (self.ground, 1.0))
        found = [[factor * each for each in part.derivatives(v)] for part, factor in parts]
        gradient, hessian = (list(each) for each in zip(*found, strict=True))
        return self.assembly.vector(gradient), self.assembly.matrix(hessian)

    def potential(self, state: BentState) -> float:
        """Return Pi with the ground [J], (FB2) and (FB4)."""
        v = state.unknowns
        return QUARTERS * (self.wall.value(v) + self.ground.value(v)) - state.condition.pressure_Pa * self.enclosed(v)

    def enclosed(self, v: FloatArray) -> float:
        """Return the volume between wall and plates [m^3], with the recess between each plate and the inner edge."""
        return QUARTERS * self.volume.value(v) + self.recess

    @property
    def _arms(self) -> FloatArray:
        """Positions of the rim from the centre of the plate at rest, shape (rim nodes, 3)."""
        arms: FloatArray = self.mesh.doflocs.T[self.rim] - (0.0, 0.0, self.segment.rest_length / 2.0)
        return arms


def equilibrium(model: QuarterModel, condition: Condition, start: BentState | None = None) -> BentState:
    """Return the equilibrium at a condition, by continuation along a straight line of conditions.

    Parameters
    ----------
    model : QuarterModel
        The segment.
    condition : Condition
        Distance of the plates, angle and pressure.
    start : BentState, optional
        An equilibrium nearby. Default: the segment at rest.

    Raises
    ------
    NoEquilibriumError
        The continuation stops before the condition. The message gives the last condition that was reached.
    """
    begin, v = Condition(model.segment.rest_length, 0.0, 0.0), model.rest
    if start is not None:
        begin, v = start.condition, start.unknowns
    used = []

    def step_to(v: FloatArray, t: float) -> FloatArray | None:
        found, iterations = _newton(model, v, _between(begin, condition, t))
        used.append(iterations)
        return found

    v, done = followed(step_to, v, 1.0, SMALLEST_STEP)
    if done < 1.0:
        raise NoEquilibriumError(
            f"bent segment: found no equilibrium at {_said(condition)}; the continuation stopped at "
            f"{_said(_between(begin, condition, done))}; use more pressure there, or leave the state out"
        )
    return _measured(model, v, condition, sum(used))


def with_bends(straight: Sequence[tuple[float, float]], count: int) -> list[tuple[float, float, float]]:
    """Return states for `bent_states`: lengths and inputs of stable straight states, and the angles `BENDS` in turn.

    Parameters
    ----------
    straight : sequence of (float, float)
        Length [m] and input [Pa or N] of at least one stable straight state.
    count : int
        Number of states. They are spread evenly over `straight`, and repeat it if `count` is larger.
    """
    chosen = spread(straight, count)
    return [(length, BENDS[i % len(BENDS)], value) for i, (length, value) in enumerate(chosen)]


def spread(straight: Sequence[tuple[float, float]], count: int) -> list[tuple[float, float]]:
    """Return `count` states, spread evenly over at least one state; states are repeated if `count` is larger."""
    return [straight[i * len(straight) // count] for i in range(count)]


def pressed_states(
    model: QuarterModel, straight: Iterable[tuple[float, float]], report: Callable[[str], None] = lambda _: None
) -> list[tuple[float, BentState]]:
    """Return straight states that flat ground presses by each of `PRESSED`: indentation [m] and state.

    The indentation is the loss of the distance between ground and axis since the first touch.

    Parameters
    ----------
    model : QuarterModel
        The segment, with `pressed=True`.
    straight : iterable of (float, float)
        Length [m] and pressure [Pa] of each straight state.
    report : callable, optional
        Called with a sentence after each straight state, and where no equilibrium is found.
    """
    conditions = [Condition(length, 0.0, pressure) for length, pressure in straight]
    found = []
    for _, free in sorted(_solved(model, conditions, report), key=lambda each: each[0]):
        radius = float(free.unknowns[: 3 * model.nodes : 3].max())
        touching = free.condition._replace(ground_m=radius)
        state = replace(free, condition=touching, unknowns=np.append(free.unknowns[:-1], radius))
        try:
            for share in PRESSED:
                state = equilibrium(model, free.condition._replace(ground_m=(1.0 - share) * radius), state)
                found.append((share * radius, state))
        except NoEquilibriumError as error:
            report(str(error))
    return found


def bent_states(
    segment: Segment,
    states: Iterable[tuple[float, float, float]],
    *,
    along: int = 12,
    around: int = 4,
    report: Callable[[str], None] = lambda _: None,
) -> list[dict[str, float]]:
    """Return rows of a table of states with bent plates.

    The continuation to a state starts from the nearest solved state. States without an equilibrium are left out.

    Parameters
    ----------
    segment : Segment
        The segment, with its input: gauge pressure, or a cable between the centres of the plates.
    states : iterable of (float, float, float)
        Length [m], bend [rad] and input [Pa or N] of each state.
    along, around : int
        Number of elements along half of the length, and around half of the circumference.
    report : callable, optional
        Called with a sentence after each state.

    Raises
    ------
    ValueError
        There is no state, or a state is out of range.

    Returns
    -------
    list of dict
        A row for each state, in the order of the states, with the keys `length_m`, `bend_rad`, `pressure_Pa` or
        `cable_N`, `force_N`, `moment_Nm`, `radius_m`, `volume_m3` and `stable` (0 or 1). `force_N` includes the cable's
        tension.
    """
    name = segment.load.input
    given = _checked(states, name)
    conditions = [Condition(*state) for state in (given * (1.0, 1.0, name == "pressure_Pa")).tolist()]
    solved = dict(_solved(QuarterModel(segment, along, around), conditions, report))
    return [_row(name, float(given[i, 2]), solved[i]) for i in sorted(solved)]


def _checked(states: Iterable[tuple[float, float, float]], name: str) -> FloatArray:
    """Return the states as an array, shape (states, 3)."""
    given = arguments.array("states", list(states), ("M", 3))
    arguments.array("length_m", given[:, 0], ("M",), gt=0.0)
    arguments.array("bend_rad", given[:, 1], ("M",), ge=-GREATEST_BEND, le=GREATEST_BEND)
    arguments.array(name, given[:, 2], ("M",), ge=0.0)
    return given


def _solved(
    model: QuarterModel, conditions: list[Condition], report: Callable[[str], None]
) -> Iterator[tuple[int, BentState]]:
    """Yield the index and the equilibrium of each condition, each started from the nearest one before.

    The first start is the segment at rest length under the greatest pressure, or at rest if there is no such
    equilibrium. Under less pressure, a segment that becomes shorter crumples.
    """
    begin = Condition(model.segment.rest_length, 0.0, max(each.pressure_Pa for each in conditions))
    inflated: BentState | None
    try:
        inflated = equilibrium(model, begin)
    except NoEquilibriumError:
        begin, inflated = begin._replace(pressure_Pa=0.0), None
    points = np.array([begin, *conditions])
    points /= np.maximum(np.abs(points).max(axis=0), np.finfo(float).tiny)
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    reached = {0: inflated}
    left = list(range(1, len(points)))
    while left:
        near = distance[np.ix_(list(reached), left)]
        start, at = np.unravel_index(near.argmin(), near.shape)
        index = left.pop(at)
        try:
            state = equilibrium(model, conditions[index - 1], reached[list(reached)[start]])
        except NoEquilibriumError as error:
            report(str(error))
            continue
        reached[index] = state
        report(f"{len(points) - 1 - len(left)} of {len(points) - 1}: {_said(state.condition)}")
        yield index - 1, state


def _row(name: str, value: float, state: BentState) -> dict[str, float]:
    """Return a row of the table."""
    return {
        "length_m": state.condition.length_m,
        "bend_rad": state.condition.bend_rad,
        name: value,
        "force_N": state.force_N + (value if name == "cable_N" else 0.0),
        "moment_Nm": state.moment_Nm,
        "radius_m": state.radius_m,
        "volume_m3": state.volume_m3,
        "stable": float(state.stable),
    }


def _between(begin: Condition, end: Condition, part: float) -> Condition:
    """Return the condition after a part of the way. The end is exact."""
    return end if part == 1.0 else Condition(*((1.0 - part) * np.array(begin) + part * np.array(end)))


def _newton(model: QuarterModel, v: FloatArray, condition: Condition) -> tuple[FloatArray | None, int]:
    """Return the equilibrium near v, or None, and the number of iterations. The first iteration moves the plate."""
    v = v.copy()
    scale = model.segment.rest_length
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        gradient, K = model.derivatives(v, condition.pressure_Pa)
        moved = np.zeros(len(v))
        moved[model.driven] = model.placed(condition) - v[model.driven]
        residual = (gradient + K @ moved)[model.free]
        try:
            moved[model.free] = -_factored(K, model.free).solve(residual)
        except RuntimeError:  # the matrix is singular
            return None, iteration
        largest = np.abs(np.append(moved[: 3 * model.nodes], moved[-1])).max() / scale
        if not largest < STEP_LIMIT:
            return None, iteration
        v += moved
        if largest < STEP_TOLERANCE:
            return v, iteration
    return None, NEWTON_ITERATIONS


def _measured(model: QuarterModel, v: FloatArray, condition: Condition, iterations: int) -> BentState:
    """Return the measures of an equilibrium, (FB3)."""
    gradient, K = model.derivatives(v, condition.pressure_Pa)
    factored = _factored(K, model.free)
    reaction = gradient[model.driven]
    by_length, by_bend, twice = model.rates(condition)
    moved = np.zeros(len(v))
    moved[model.driven] = by_bend
    moved[model.free] = -factored.solve((K @ moved)[model.free])
    return BentState(
        condition=condition,
        force_N=QUARTERS * float(reaction @ by_length),
        moment_Nm=QUARTERS * float(reaction @ by_bend),
        bending_stiffness_Nm=QUARTERS * float(moved @ (K @ moved) + reaction @ twice),
        load_N=-QUARTERS * float(reaction[-1]),
        volume_m3=model.enclosed(v),
        radius_m=float(v[1 : 3 * model.nodes : 3].max()),
        stable=_negative(factored, K, model.free) == model.multipliers,
        unknowns=v,
        iterations=iterations,
    )


def _factored(K: sp.csc_matrix, free: IntArray) -> spl.SuperLU:
    """Return the factors of the rows and columns `free`. Pivots are diagonal unless zero."""
    options = {"SymmetricMode": True}
    return spl.splu(K[free][:, free].tocsc(), permc_spec="COLAMD", diag_pivot_thresh=0.0, options=options)


def _negative(factored: spl.SuperLU, K: sp.csc_matrix, free: IntArray) -> int:
    """Return the number of negative eigenvalues. Diagonal pivots have their signs (Sylvester's law of inertia)."""
    diagonal = (factored.perm_r == factored.perm_c).all()
    signed = factored.U.diagonal() if diagonal else eigvalsh(K[free][:, free].toarray())
    return int(np.sum(signed < 0.0))


def _of(nodes: IntArray) -> IntArray:
    """Return the indices of the coordinates of nodes, node by node."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _rotation(angle: float, order: int) -> FloatArray:
    """Return a rotation about y, or its derivative by the angle of the given order: e_z turns to e_x."""
    c, s = np.cos(angle + order * np.pi / 2.0), np.sin(angle + order * np.pi / 2.0)
    return np.array([[c, 0.0, s], [0.0, 1.0 if order == 0 else 0.0, 0.0], [-s, 0.0, c]])


def _said(condition: Condition) -> str:
    return (
        f"length {condition.length_m:.4g} m, bend {condition.bend_rad:.3g} rad, pressure {condition.pressure_Pa:.4g} Pa"
    )


def _mesh(segment: Segment, lines: tuple[FloatArray, ...]) -> tuple[skfem.MeshHex2, FloatArray]:
    """Return the mesh, and the places of its nodes along (0 to 1), across the wall and around, shape (3, nodes)."""
    mesh = skfem.MeshHex2.from_mesh(skfem.MeshHex.init_tensor(*lines))
    grid = mesh.doflocs
    r, z = segment.wall(grid[0], 2.0 * grid[1] - 1.0)
    angle = np.pi * grid[2]
    return replace(mesh, doflocs=np.array([r * np.cos(angle), r * np.sin(angle), z])), grid


def _held(grid: FloatArray, driven: IntArray, size: int) -> BoolArray:
    """Return which unknowns the planes of symmetry, plate and ground hold, shape (size,)."""
    held = np.zeros(size, bool)
    held[3 * np.flatnonzero(grid[0] == 0.0) + 2] = True
    held[3 * np.flatnonzero((grid[2] == 0.0) | (grid[2] == 1.0)) + 1] = True
    held[driven] = True
    return held


def _wall(segment: Segment, grid: FloatArray, basis: skfem.Basis, multiplier: skfem.Basis) -> Potential:
    """Return the strain energy of the wall. Local variables: F row by row, and multiplier over shear modulus."""
    zero = np.zeros_like(basis.dx)
    columns = [[*_gradient(each[0]), zero] for each in basis.basis]
    columns += [[zero] * 9 + [each[0] + zero] for each in multiplier.basis]
    e, c = ca.SX.sym("e", 10), ca.SX.sym("c", 7)
    F = ca.reshape(e[:9], 3, 3).T
    strain = segment.density(F.T @ F, c[0:3], c[3:6], c[6])
    density = strain + segment.rubber.constraint(ca.det(F), e[9] * segment.rubber.shear_modulus)
    unknowns = np.vstack([basis.element_dofs, basis.N + multiplier.element_dofs]).T
    return Potential(density, e, c, operator(columns), unknowns, basis.dx, _directions(segment, grid, basis))


def _directions(segment: Segment, grid: FloatArray, basis: skfem.Basis) -> FloatArray:
    """Return the unit vectors along the meridian and around the axis, and the radius, shape (7, elements, points)."""
    x, y, _ = np.asarray(basis.global_coordinates())
    s = np.asarray(basis.with_element(skfem.ElementHex2()).interpolate(grid[0]))
    outward, forward = segment.profile.meridian(s.ravel())[1].reshape(2, *s.shape)
    radius = np.hypot(x, y)
    cosine, sine, zero = x / radius, y / radius, np.zeros_like(x)
    return np.array([outward * cosine, outward * sine, forward, -sine, cosine, zero, radius])


def _volume(mesh: skfem.MeshHex2, grid: FloatArray) -> Potential:
    """Return V/4, (FB2). Local variables: F row by row, and y. Constant: normal N, with n da = cof(F) N dA."""
    basis = _surface(mesh, grid, 0.0)
    columns = [[*_gradient(each[0]), np.asarray(each[0])[1]] for each in basis.basis]
    e, N = ca.SX.sym("e", 10), ca.SX.sym("N", 3)
    density = -e[9] * ca.dot(ca.cross(e[6:9], e[0:3]), N)  # N points out of the wall, into the gas
    return Potential(density, e, N, operator(columns), basis.element_dofs.T, basis.dx, np.asarray(basis.normals))


def _ground(segment: Segment, mesh: skfem.MeshHex2, grid: FloatArray, distance: int) -> Potential:
    """Return Pi_g/4, (FB4). Local variables: x and d. `distance` is the index of the unknown d."""
    basis = _surface(mesh, grid, 1.0)
    zero = np.zeros_like(basis.dx)
    columns = [[np.asarray(each[0])[0], zero] for each in basis.basis] + [[zero, zero + 1.0]]
    unknowns = np.column_stack([basis.element_dofs.T, np.full(len(zero), distance)])
    e = ca.SX.sym("e", 2)
    kappa = GROUND_STIFFNESS * segment.rubber.shear_modulus / segment.thickness_m
    density = kappa / 2.0 * ca.fmax(e[0] - e[1], 0.0) ** 2
    return Potential(density, e, ca.SX.sym("c", 0), operator(columns), unknowns, basis.dx, np.zeros((0, *zero.shape)))


def _surface(mesh: skfem.MeshHex2, grid: FloatArray, depth: float) -> skfem.FacetBasis:
    """Return the basis on the surface at a depth."""
    facets = np.flatnonzero((grid[1][mesh.facets] == depth).all(axis=0))
    return skfem.FacetBasis(mesh, skfem.ElementVector(skfem.ElementHex2()), facets=facets, intorder=QUADRATURE_ORDER)


def _gradient(function: Any) -> FloatArray:
    """Return the gradient of a vector function row by row, shape (9, elements, points)."""
    gradient = np.asarray(function.grad)
    return gradient.reshape(9, *gradient.shape[2:])
