"""Potential, residual and Jacobian of a step at a trial state, assembled from the kernels' outputs.

A Jacobian is first assembled as if all points were free masses. Then the contacts are added: the contribution of a
contact with the stiffness K (3, 3) is J^T K J. J contains the derivatives of the point with respect to the coordinates
of the segment. If K changes by dK between two Newton steps, J^T dK J is added, with the J of the first addition. The
second derivatives of the point keep the old contact force. Relative to dK, the error of these terms is the ratio of the
penetration, or of the distance to the yield limit, to the segment length.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine import vectors
from worm3d.machine.banded import B
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner, njit
from worm3d.machine.vectors import BLOCK_SIZE, add_congruent
from worm3d.physics.kernels import joint, point, segment
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver import arrays as a
from worm3d.solver import loads
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, copy, fill, matrix, rows, vector
from worm3d.solver.entry import call, count, kernel, opened, run
from worm3d.values.arrays import FloatArray

_Q, _LINK, _T_REF = segment.SEGMENT_LAYOUT.firsts("q", "link", "t_ref")
_JOINT_Q = joint.JOINT_LAYOUT.first("q")
_COUPLED, _REGIME = point.POINT_LAYOUT.firsts("coupled", "regime")
_OWN = segment.COORDINATES
_BOTH = joint.COORDINATES
MIN_CHAMBER_LENGTH = 1e-4
"""Length of a chamber below which a shape is impossible, as a fraction of the link length."""
LENGTHS, TANGENT, DIRECTOR = a.SHAPE.firsts("lengths", "tangent", "director")
PHI, LOAD_ROW, _AHEAD, STIFFNESS = a.POINT_FORCES.firsts("phi", "load", "f_ahead", "K")
NO_HESSIAN, WHOLE_HESSIAN, LOCAL_HESSIAN, CHOICES = range(4)
"""Choices for the argument `hessian` of `evaluate`, and the number of choices."""


@inner
def to_segments(core: Core, row: int, x: int) -> None:
    """Write coordinates, or their change, which begin at the address x, into rows of the segments' inputs."""
    for i in range(0, core.n, vectors.VECTOR_WIDTH):
        to = address(core.block, a.SEGMENT_IN, row) + 8 * i
        vectors.transpose(to, matrix(core.block, a.SEGMENT_IN).shape[1], x + 8 * BLOCK_SIZE * i, BLOCK_SIZE)


@inner
def to_joints(core: Core, row: int, x: int) -> None:
    """Write coordinates, or their change, which begin at the address x, into rows of the joints' inputs."""
    for i in range(0, core.n - 1, vectors.VECTOR_WIDTH):
        for r in (0, _BOTH - vectors.VECTOR_WIDTH):  # two overlapping groups of rows
            to = address(core.block, a.JOINT_IN, row + r) + 8 * i
            vectors.transpose(to, matrix(core.block, a.JOINT_IN).shape[1], x + 8 * (BLOCK_SIZE * i + r), BLOCK_SIZE)


@inner
def place(core: Core, x: FloatArray) -> bool:
    """Compute points and distances at x, and return whether the linkages can have this shape."""
    segment_in, rest = matrix(core.block, a.SEGMENT_IN), matrix(core.block, a.SEGMENT_SHAPE_OUT)
    to_segments(core, _Q, x.ctypes.data)
    run(core, a.SEGMENT_SHAPE, a.FORMED, a.SEGMENT_SHAPE_OUT, core.n)
    for i in range(core.n):
        link, turned = segment_in[_LINK, i], 0.0
        for d in range(3):
            turned += rest[TANGENT + d, i] * segment_in[_T_REF + d, i]
        for c in range(2):
            length = rest[LENGTHS + c, i]
            if not (MIN_CHAMBER_LENGTH * link < length < 2.0 * link * (1.0 - 1e-12)):
                return False
        if not turned > -0.9:
            return False
    find_distances(core)
    return True


@inner
def find_distances(core: Core) -> None:
    """Run the kernel of the world for all points."""
    copy(rows(core.block, a.WORLD_IN, 0, 3), rows(core.block, a.POINT_IN, 0, 3))
    run(core, a.WORLD, a.WORLD_IN, a.WORLD_OUT, matrix(core.block, a.WORLD_IN).shape[1])


@njit
def evaluate(core: Core, which: int, coupled: bool, hessian: int) -> float:
    """Return the potential of a step (infinite for an impossible shape), and fill the gradient and the band.

    The gradient contains the forces of held coordinates.

    Parameters
    ----------
    which : int
        Array with the coordinates, X or TRIAL.
    coupled : bool
        Whether friction uses the normal loads at x. The gradient is then the true residual, the band is the unsymmetric
        Jacobian of the residual, and the return value is meaningless.
    hessian : int
        NO_HESSIAN does not fill the band. WHOLE_HESSIAN fills it. LOCAL_HESSIAN updates only the contributions of the
        contacts that are marked in "changed".
    """
    value: float = call(kernel(core, a.EVALUATE), core.handle, 0.0, which, CHOICES * coupled + hessian)
    return value


def evaluate_entry(handle: int, _value: float, which: int, flags: int) -> float:
    """`evaluate` as an entry of the table of functions (`worm3d.solver.entry`)."""
    core = opened(handle)
    return _evaluate(core, vector(core.block, which), flags >= CHOICES, flags % CHOICES)


@inner
def _evaluate(core: Core, x: FloatArray, coupled: bool, hessian: int) -> float:
    n = core.n
    count(core, 1 if hessian == NO_HESSIAN else 0)
    if not place(core, x):
        return np.inf
    fill(rows(core.block, a.POINT_IN, _COUPLED, 1), 1.0 if coupled else 0.0)
    _points(core, coupled, hessian)
    to_joints(core, _JOINT_Q, x.ctypes.data)
    if hessian == WHOLE_HESSIAN:
        run(core, a.JOINT_HESSIAN, a.JOINT_IN, a.JOINT_OUT, n - 1)
    else:
        gradient = matrix(core.block, a.JOINT_OUT)[: 1 + joint.ROW]
        evaluate_kernel(kernel(core, a.JOINT_GRADIENT), matrix(core.block, a.JOINT_IN), gradient, n - 1)
    _segments(core, hessian)
    phi = _joints(core, x)
    _add_gradients(core)
    if loads.loaded(core):
        phi += loads.add(core, x, hessian == WHOLE_HESSIAN)
    return 0.0 if coupled else phi + _potentials(core)


@inner
def _potentials(core: Core) -> float:
    """Return the sum of the potentials of segments, joints and points."""
    n, lanes = core.n, matrix(core.block, a.SEGMENT_OUT).shape[1]
    phi = vectors.total(address(core.block, a.SEGMENT_OUT, 0), n)
    phi += vectors.total(address(core.block, a.JOINT_OUT, 0), n - 1)
    for slot in range(POINTS_PER_SEGMENT):
        phi += vectors.total(address(core.block, a.POINT_OUT, PHI) + 8 * lanes * slot, n)
    return float(phi)


@inner
def open_at(core: Core, first: int) -> bool:
    """Return whether all points of the vector that starts at `first` have the regime OPEN."""
    return bool(vectors.all_equal(address(core.block, a.POINT_IN, _REGIME) + 8 * first, point.OPEN) != 0)


@inner
def _points(core: Core, coupled: bool, hessian: int) -> None:
    """Run the kernels of the points. For a vector whose points are all open, the kernel without contact runs."""
    point_in, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.POINT_OUT)
    changed, lanes = vector(core.block, a.CHANGED), point_in.shape[1] // POINTS_PER_SEGMENT
    for first in range(0, point_in.shape[1], vectors.VECTOR_WIDTH):
        free = coupled and open_at(core, first)
        if hessian in (NO_HESSIAN, LOCAL_HESSIAN):
            which = a.POINT_FREE_FORCE if free else a.POINT_FORCE
            evaluate_kernel(kernel(core, which), point_in, out[:_AHEAD], vectors.VECTOR_WIDTH, first)
            continue
        which = a.POINT_FREE_STIFFNESS if free else a.POINT_AHEAD
        run(core, which, a.POINT_IN, a.POINT_OUT, vectors.VECTOR_WIDTH, first)
        if not free:
            beyond = first + core.n - first % lanes
            for k in range(first, first + vectors.VECTOR_WIDTH):
                loaded = not coupled or point_in[_REGIME, k] != point.OPEN
                changed[k] = 1.0 if loaded and k < beyond else 0.0


@inner
def _segments(core: Core, hessian: int) -> None:
    """Run the segments' kernel, and fill the band as `hessian` requests."""
    if hessian in (NO_HESSIAN, LOCAL_HESSIAN):
        gradient = matrix(core.block, a.SEGMENT_OUT)[: 1 + _OWN]
        evaluate_kernel(kernel(core, a.SEGMENT_GRADIENT), matrix(core.block, a.ACTUATED), gradient, core.n)
    else:
        run(core, a.SEGMENT_HESSIAN, a.ACTUATED, a.SEGMENT_OUT, core.n)
        _fill_band(core)
    if hessian != NO_HESSIAN:
        exchange(core)
        fill(vector(core.block, a.CHANGED), 0.0)


@inner
def _joints(core: Core, x: FloatArray) -> float:
    """Set the gradient to inertia (P4), weight, viscous medium (P8) and forces of the joints; return the potential."""
    gradient, numbers = vector(core.block, a.GRADIENT), vector(core.block, a.NUMBERS_)
    inertia, drag = vector(core.block, a.JOINT_INERTIA), vector(core.block, a.JOINT_DRAG)
    hat, drag_hat = matrix(core.block, a.JOINT_HAT), matrix(core.block, a.JOINT_DRAG_HAT)
    mass, external = vector(core.block, a.JOINT_MASS), matrix(core.block, a.EXTERNAL)
    friction = matrix(core.block, a.JOINT_FRICTION)
    phi = 0.0
    for j in range(core.n + 1):
        for d in range(BLOCK_SIZE):
            gradient[BLOCK_SIZE * j + d] = 0.0
        for d in range(3):
            k = BLOCK_SIZE * j + d
            away, moved = x[k] - hat[d, j], x[k] - drag_hat[d, j]
            push = mass[j] * numbers[a.GRAVITY + d] + external[d, j] + friction[d, j]
            phi += 0.5 * inertia[j] * away * away + 0.5 * drag[j] * moved * moved - push * x[k]
            gradient[k] = inertia[j] * away + drag[j] * moved - push
    return phi


@inner
def _add_gradients(core: Core) -> None:
    """Add the gradients of segments and joints, one number at a time, since overlapping vectors wait for each other."""
    gradient = vector(core.block, a.GRADIENT)
    segment_out, joint_out = matrix(core.block, a.SEGMENT_OUT), matrix(core.block, a.JOINT_OUT)
    for r in range(_OWN):
        for i in range(core.n):
            gradient[BLOCK_SIZE * i + r] += segment_out[1 + r, i]
    for r in range(_BOTH):
        for i in range(core.n - 1):
            gradient[BLOCK_SIZE * i + r] += joint_out[1 + r, i]


@inner
def hold(core: Core, in_band: bool) -> None:
    """Set the gradient of held coordinates to zero, and their rows and columns in the band to the identity."""
    held, gradient = vector(core.block, a.HELD), vector(core.block, a.GRADIENT)
    band, size = matrix(core.block, a.BANDED_JACOBIAN), vector(core.block, a.HELD).size
    for first in range(0, size, vectors.VECTOR_WIDTH):
        if vectors.all_equal(address(core.block, a.HELD, 0) + 8 * first, 0.0) != 0:
            continue
        for k in range(first, min(first + vectors.VECTOR_WIDTH, size)):
            if held[k] == 0.0:
                continue
            gradient[k] = 0.0
            if not in_band:
                continue
            fill(band[k], 0.0)
            for m in range(max(0, k - B), min(size, k + B + 1)):
                band[m, B + k - m] = 0.0
            band[k, B] = 1.0


@inner
def _fill_band(core: Core) -> None:
    """Assemble the band from the contributions of joints, masses of joints and segments."""
    band = matrix(core.block, a.BANDED_JACOBIAN)
    inertia, drag, pitch = vector(core.block, a.JOINT_INERTIA), vector(core.block, a.JOINT_DRAG), band.shape[1] - 1
    vectors.clear(address(core.block, a.BANDED_JACOBIAN, 0), band.size)
    for j in range(core.n + 1):
        for d in range(3):
            band[BLOCK_SIZE * j + d, B] = inertia[j] + drag[j]
    for first in range(0, core.n, vectors.VECTOR_WIDTH):
        _transpose(core, a.SEGMENT_OUT, a.SEGMENT_BLOCKS, first)
    for first in range(0, core.n - 1, vectors.VECTOR_WIDTH):
        _transpose(core, a.JOINT_OUT, a.JOINT_BLOCKS, first)
    for begin in range(2):  # neighbouring blocks overlap, and would wait for each other
        for i in range(begin, core.n, 2):
            own = address(core.block, a.SEGMENT_BLOCKS, i) + 8 * _OWN
            vectors.add_rows(_row(core, a.BANDED_JACOBIAN, i, 0), pitch, own, _OWN, _OWN)
    for i in range(core.n - 1):
        own, to = address(core.block, a.JOINT_BLOCKS, i) + 8 * joint.ROW, _row(core, a.BANDED_JACOBIAN, i, 0)
        for half in range(0, joint.ROW, vectors.VECTOR_WIDTH):
            vectors.add_rows(to + 8 * half, pitch, own + 8 * half, joint.ROW, _BOTH)
    fill(vector(core.block, a.DERIVATIVES_KNOWN), 0.0)


@inner
def exchange(core: Core) -> None:
    """Update the contributions to the band of the contacts that are marked in "changed"."""
    changed, known = vector(core.block, a.CHANGED), vector(core.block, a.DERIVATIVES_KNOWN)
    lanes = len(changed) // POINTS_PER_SEGMENT
    for first in range(0, len(changed), vectors.VECTOR_WIDTH):
        if vectors.all_equal(address(core.block, a.CHANGED, 0) + 8 * first, 0.0) != 0:
            continue
        run(core, a.POINT_STIFFNESS, a.POINT_IN, a.POINT_ANEW, vectors.VECTOR_WIDTH, first)
        if known[first % lanes // vectors.VECTOR_WIDTH] == 0.0:
            _differentiate(core, first % lanes)
        for k in range(first, first + vectors.VECTOR_WIDTH):
            if changed[k] != 0.0:
                _exchange_one(core, k)


@inner
def _differentiate(core: Core, first: int) -> None:
    """Compute the derivatives of the points of a vector of segments, which starts at `first`."""
    count = min(vectors.VECTOR_WIDTH, core.n - first)
    run(core, a.SEGMENT_JACOBIAN, a.FORMED, a.POINTS_JACOBIAN, count, first)
    _transpose(core, a.POINTS_JACOBIAN, a.JACOBIANS, first)
    vector(core.block, a.DERIVATIVES_KNOWN)[first // vectors.VECTOR_WIDTH] = 1.0


@inner
def _exchange_one(core: Core, k: int) -> None:
    """Update the contribution of contact k to the band. Its K in "point_out" is replaced; "point_anew" gets dK."""
    old, new = matrix(core.block, a.POINT_OUT), matrix(core.block, a.POINT_ANEW)
    lanes = old.shape[1] // POINTS_PER_SEGMENT
    slot, i = k // lanes, k % lanes
    for r in range(STIFFNESS, old.shape[0]):
        new[r, k], old[r, k] = new[r, k] - old[r, k], new[r, k]
    jacobian = address(core.block, a.JACOBIANS, i) + 8 * 3 * _OWN * slot
    more = address(core.block, a.POINT_ANEW, STIFFNESS) + 8 * k
    pitch = 8 * (matrix(core.block, a.BANDED_JACOBIAN).shape[1] - 1)
    add_congruent(_row(core, a.BANDED_JACOBIAN, i, 0), pitch, jacobian, more, 8 * old.shape[1])


@inner
def _row(core: Core, k: int, i: int, r: int) -> int:
    """Return the address in a band where row r of the Hessian of segment or joint i begins."""
    return int(address(core.block, k, BLOCK_SIZE * i + r) + 8 * (B - r))


@inner
def _transpose(core: Core, source: int, to: int, first: int) -> None:
    """Transpose the derivatives in the last rows of `source`, for a vector of lanes, to rows of `to`."""
    lanes, pitch = matrix(core.block, source).shape[1], matrix(core.block, to).shape[1]
    before = matrix(core.block, source).shape[0] - pitch
    for r in range(0, pitch, vectors.VECTOR_WIDTH):
        here = address(core.block, source, before + r) + 8 * first
        vectors.transpose(address(core.block, to, first) + 8 * r, pitch, here, lanes)
