"""What is kept of a run: a row of every recorded instant, and counters of every step."""

from __future__ import annotations

import numpy as np

from worm3d.machine import vectors
from worm3d.machine.codegen import evaluate as run
from worm3d.machine.compiled import inner, njit
from worm3d.physics.kernels import point, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, POINTS, TERMS, Core
from worm3d.solver.block import Block, Memory, address, copy, fill, matrix, vector
from worm3d.solver.entry import kernel
from worm3d.values.arrays import FloatArray

NAMES = (
    "joints",  # (N+1, 3)
    "joint_velocity",  # (N+1, 3)
    "points",  # (N, 8, 3)
    "directors",  # (N, 3)
    "bend",  # (N,)
    "chamber_length",  # (N, 2)
    "asked",  # (5 N,)
    "given",  # (5 N,)
    "load",  # (N, 8)
    "anchors",  # (N, 8, 3)
    "contact_force",  # (N, 8, 3)
    "joint_load",  # (N+1,) of the clamped worm
    "joint_friction",  # (N+1, 3) of the clamped worm
    "slip",  # (N, 8) since the row before
    "momentum",  # linear (3), angular about the origin (3)
    "com",  # (3,)
    "energy",  # (16,) ledger since the row before
)
"""Arrays of records, one row an instant, in the order of the block."""
(
    JOINTS,
    JOINT_VELOCITY,
    POINTS_,
    DIRECTORS,
    BEND,
    CHAMBER_LENGTH,
    ASKED,
    GIVEN,
    LOAD,
    ANCHORS,
    CONTACT_FORCE,
    JOINT_LOAD,
    JOINT_FRICTION,
    SLIP,
    MOMENTUM,
    COM,
    ENERGY,
) = range(len(NAMES))

_D_REF = segment.LAYOUT.first("d_ref")
_LOAD_N, _ANCHOR = point.LAYOUT.firsts("load_n", "anchor")


def record_memory(n: int, rows: int) -> Memory:
    """Return records for n segments and `rows` instants; `record` writes every number of a row."""
    joints, points = 3 * (n + 1), 3 * POINTS * n
    segments = (3 * n, n, 2 * n, 5 * n, 5 * n, 8 * n)
    widths = (joints, joints, points, *segments, points, points, n + 1, joints, 8 * n, 6, 3, len(TERMS))
    return Memory(NAMES, [(rows, width) for width in widths], cleared=False)


@njit
def record(core: Core, records: Block, row: int) -> None:
    """Write one row, and start to gather for the next."""
    block, n = core.block, core.n
    _segments(core, records, row)
    for source, to in ((a.JOINTS, JOINTS), (a.JOINT_VELOCITY, JOINT_VELOCITY), (a.JOINT_FRICTION, JOINT_FRICTION)):
        here, there = matrix(block, source), matrix(records, to)[row]
        for j in range(n + 1):
            for d in range(3):
                there[3 * j + d] = here[d, j]
    copy(matrix(records, JOINT_LOAD)[row], vector(block, a.JOINT_LOAD))
    copy(matrix(records, ASKED)[row], vector(block, a.ASKED))
    copy(matrix(records, GIVEN)[row], vector(block, a.GIVEN))
    _momenta(core, matrix(records, MOMENTUM)[row], matrix(records, COM)[row])
    copy(matrix(records, ENERGY)[row], vector(block, a.TERMS_))
    fill(vector(block, a.TERMS_), 0.0)
    fill(vector(block, a.SLID), 0.0)


@inner
def _segments(core: Core, records: Block, row: int) -> None:
    x, lengths, rows = vector(core.block, a.X), matrix(core.block, a.LENGTHS), matrix(core.block, a.SEGMENT_IN)
    directors, chamber = matrix(records, DIRECTORS)[row], matrix(records, CHAMBER_LENGTH)[row]
    bend = matrix(records, BEND)[row]
    for i in range(core.n):
        bend[i] = x[BLOCK * i + 4]
        for side in range(2):
            chamber[2 * i + side] = lengths[side, i]
        for d in range(3):
            directors[3 * i + d] = rows[_D_REF + d, i]
    _places(core, address(core.block, a.POINTS_PAST, 0), address(records, POINTS_, row))
    _places(core, address(core.block, a.POINT_IN, _ANCHOR), address(records, ANCHORS, row))
    _places(core, address(core.block, a.CONTACT_FORCE, 0), address(records, CONTACT_FORCE, row))
    _numbers(core, address(core.block, a.POINT_IN, _LOAD_N), address(records, LOAD, row))
    _numbers(core, address(core.block, a.SLID, 0), address(records, SLIP, row))


@inner
def _places(core: Core, rows: int, to: int) -> None:
    """Write three rows of the points, x, y and z, at an address as (N, 8, 3)."""
    lanes, turned = matrix(core.block, a.REST).shape[1], address(core.block, a.TURNED, 0)
    for i in range(0, core.n, vectors.WIDTH):
        vectors.transpose_places(turned + 8 * 3 * POINTS * i, 3 * POINTS, rows + 8 * i, lanes)
    vectors.move(to, turned, 3 * POINTS * core.n)


@inner
def _numbers(core: Core, rows: int, to: int) -> None:
    """Write one row of the points at an address as (N, 8)."""
    lanes, turned = matrix(core.block, a.REST).shape[1], address(core.block, a.TURNED, 0)
    for i in range(0, core.n, vectors.WIDTH):
        vectors.transpose(turned + 8 * POINTS * i, POINTS, rows + 8 * i, lanes)
    vectors.move(to, turned, POINTS * core.n)


@njit
def mass_centre(core: Core) -> tuple[FloatArray, FloatArray]:
    """Return linear and angular momentum, shape (6,), and the centre of mass, shape (3,)."""
    momentum, com = np.zeros(6), np.zeros(3)
    _momenta(core, momentum, com)
    return momentum, com


@inner
def _momenta(core: Core, momentum: FloatArray, com: FloatArray) -> None:
    """Momentum, angular momentum and centre of mass of all mass points."""
    points, nodes = matrix(core.block, a.POINT_IN), matrix(core.block, a.NODE_IN)
    fill(momentum, 0.0)
    fill(com, 0.0)
    out = matrix(core.block, a.MOMENTA_OUT)
    run(kernel(core, a.POINT_MOMENTA), points, out, points.shape[1])
    _add_sums(core, points.shape[1], momentum, com)
    run(kernel(core, a.NODE_MOMENTA), nodes, out, core.n + 1)
    _add_sums(core, core.n + 1, momentum, com)
    for d in range(3):
        com[d] /= vector(core.block, a.NUMBERS_)[a.MASS]


@inner
def _add_sums(core: Core, count: int, momentum: FloatArray, com: FloatArray) -> None:
    """Add the sums of what a kernel says of momenta and mass times place."""
    sums, lanes = vector(core.block, a.SUMS), matrix(core.block, a.MOMENTA_OUT).shape[1]
    vectors.totals(address(core.block, a.SUMS, 0), address(core.block, a.MOMENTA_OUT, 0), lanes, count)
    for k in range(6):
        momentum[k] += sums[k]
    com[0] += sums[6]
    com[1] += sums[7]
    com[2] += vectors.total(address(core.block, a.MOMENTA_OUT, vectors.WIDTH), count)
