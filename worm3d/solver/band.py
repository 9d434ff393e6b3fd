"""The band of Newton's Jacobian, put together from what joints, segments and contacts contribute.

A contact that changes what it does between two steps of Newton changes its K (3, 3) by so much that the Jacobian is of
no more use. Then dK alone is exchanged: J^T dK J is added, J being the derivative of the point in the coordinates of
its segment when one of these was first exchanged. Its force stays as it was where it counts for the point's second
derivatives: that is less than dK by the ratio of penetration, or of the way to the yield limit, to segment length.
"""

from __future__ import annotations

from worm3d.machine import vectors
from worm3d.machine.banded import B
from worm3d.machine.codegen import evaluate_some as run_some
from worm3d.machine.compiled import inner
from worm3d.machine.vectors import add_congruent
from worm3d.physics.kernels import joint, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, POINTS, Core
from worm3d.solver.block import address, fill, matrix, vector
from worm3d.solver.entry import kernel

_OWN = segment.COORDINATES
_BOTH = joint.COORDINATES
STIFFNESS, _ROWS = 8, 17
"""First row of K in "point_out", its last rows, and the number of all of them."""


@inner
def fill_joint_band(core: Core) -> None:
    """Put together what joints and their masses contribute to the band."""
    band = matrix(core.block, a.JOINT_BAND)
    inertia, drag = vector(core.block, a.JOINT_INERTIA), vector(core.block, a.JOINT_DRAG)
    vectors.clear(address(core.block, a.JOINT_BAND, 0), band.size)
    for j in range(core.n + 1):
        for d in range(3):
            band[BLOCK * j + d, B] = inertia[j] + drag[j]
    for first in range(0, core.n - 1, vectors.WIDTH):
        _transpose(core, a.JOINT_OUT, 1 + _BOTH, a.JOINT_BLOCKS, first)
    for i in range(core.n - 1):
        own = address(core.block, a.JOINT_BLOCKS, i)
        for r in range(_BOTH):
            vectors.add_16(_place(core, a.JOINT_BAND, i, r), own + 8 * joint.ROW * r)


@inner
def fill_band(core: Core) -> None:
    """Put the band together from the joints' part and what the segments contribute."""
    to, count = address(core.block, a.BAND, 0), vector(core.block, a.BAND).size
    vectors.move(to, address(core.block, a.JOINT_BAND, 0), count)
    for first in range(0, core.n, vectors.WIDTH):
        _transpose(core, a.SEGMENT_OUT, 1 + _OWN, a.SEGMENT_BLOCKS, first)
    for i in range(core.n):
        own = address(core.block, a.SEGMENT_BLOCKS, i)
        for r in range(_OWN):
            vectors.add_8(_place(core, a.BAND, i, r), own + 8 * _OWN * r)
    fill(vector(core.block, a.KNOWN), 0.0)


@inner
def exchange(core: Core) -> None:
    """Exchange what the contacts that "changed" names contribute to the band."""
    changed, known = vector(core.block, a.CHANGED), vector(core.block, a.KNOWN)
    point_in, lanes = matrix(core.block, a.POINT_IN), len(changed) // POINTS
    for first in range(0, len(changed), vectors.WIDTH):
        if vectors.greatest(address(core.block, a.CHANGED, 0) + 8 * first, vectors.WIDTH) == 0.0:
            continue
        run_some(kernel(core, a.POINT_STIFFNESS), point_in, matrix(core.block, a.POINT_ANEW), first, vectors.WIDTH)
        if known[first % lanes // vectors.WIDTH] == 0.0:
            _differentiate(core, first % lanes)
        for k in range(first, first + vectors.WIDTH):
            if changed[k] != 0.0:
                _exchange_one(core, k)


@inner
def _differentiate(core: Core, first: int) -> None:
    """Compute the derivatives of the points of a vector of segments."""
    segment_in, count = matrix(core.block, a.SEGMENT_IN), min(vectors.WIDTH, core.n - first)
    run_some(kernel(core, a.SEGMENT_JACOBIAN), segment_in, matrix(core.block, a.POINTS_JACOBIAN), first, count)
    _transpose(core, a.POINTS_JACOBIAN, 0, a.JACOBIANS, first)
    vector(core.block, a.KNOWN)[first // vectors.WIDTH] = 1.0


@inner
def _exchange_one(core: Core, k: int) -> None:
    """Exchange what a contact contributes: its K is the new one from now on, and the array beside it holds dK."""
    old, new = matrix(core.block, a.POINT_OUT), matrix(core.block, a.POINT_ANEW)
    lanes = old.shape[1] // POINTS
    slot, i = k // lanes, k % lanes
    for r in range(STIFFNESS, _ROWS):
        new[r, k], old[r, k] = new[r, k] - old[r, k], new[r, k]
    jacobian = address(core.block, a.JACOBIANS, i) + 8 * 3 * _OWN * slot
    more = address(core.block, a.POINT_ANEW, STIFFNESS) + 8 * k
    pitch = 8 * (matrix(core.block, a.BAND).shape[1] - 1)
    add_congruent(_place(core, a.BAND, i, 0), pitch, jacobian, more, 8 * old.shape[1])


@inner
def _place(core: Core, k: int, i: int, r: int) -> int:
    """Return where, in a band, row r of the Hessian of segment or joint i begins."""
    return int(address(core.block, k, BLOCK * i + r) + 8 * (B - r))


@inner
def _transpose(core: Core, source: int, row: int, to: int, first: int) -> None:
    """Write the derivatives of a vector of lanes, rows from `row` on, as rows of an array."""
    lanes, size = matrix(core.block, source).shape[1], matrix(core.block, to).shape[1]
    for r in range(0, size, vectors.WIDTH):
        here = address(core.block, source, row + r) + 8 * first
        vectors.transpose(address(core.block, to, first) + 8 * r, size, here, lanes)
