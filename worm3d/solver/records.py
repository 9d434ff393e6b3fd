"""What is kept of a run: a row of every recorded instant, and counters of every step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.compiled import inner, njit
from worm3d.kernels import point, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, POINTS, TERMS, Core
from worm3d.solver.block import Block, Memory, copy, fill, matrix, vector

FloatArray = NDArray[np.float64]

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
    "energy",  # (14,) ledger since the row before
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
    block, n = records, core.n
    _segments(core, records, row)
    velocity, joints = matrix(core.block, a.JOINT_VELOCITY), matrix(core.block, a.JOINTS)
    friction = matrix(core.block, a.JOINT_FRICTION)
    for j in range(n + 1):
        for d in range(3):
            matrix(block, JOINTS)[row, 3 * j + d] = joints[d, j]
            matrix(block, JOINT_VELOCITY)[row, 3 * j + d] = velocity[d, j]
            matrix(block, JOINT_FRICTION)[row, 3 * j + d] = friction[d, j]
    copy(matrix(block, JOINT_LOAD)[row], vector(core.block, a.JOINT_LOAD))
    copy(matrix(block, ASKED)[row], vector(core.block, a.ASKED))
    copy(matrix(block, GIVEN)[row], vector(core.block, a.GIVEN))
    _momenta(core, matrix(block, MOMENTUM)[row], matrix(block, COM)[row])
    copy(matrix(block, ENERGY)[row], vector(core.block, a.TERMS_))
    fill(vector(core.block, a.TERMS_), 0.0)
    fill(vector(core.block, a.SLID), 0.0)


@inner
def _segments(core: Core, records: Block, row: int) -> None:
    x, lengths = vector(core.block, a.X), matrix(core.block, a.LENGTHS)
    rows, p = matrix(core.block, a.SEGMENT_IN), matrix(core.block, a.POINT_IN)
    past, lanes = matrix(core.block, a.POINTS_PAST), rows.shape[1]
    points, anchors = matrix(records, POINTS_)[row], matrix(records, ANCHORS)[row]
    directors, chamber = matrix(records, DIRECTORS)[row], matrix(records, CHAMBER_LENGTH)[row]
    load, slip = matrix(records, LOAD)[row], matrix(records, SLIP)[row]
    bend, slid = matrix(records, BEND)[row], matrix(core.block, a.SLID)
    kept, force = matrix(records, CONTACT_FORCE)[row], matrix(core.block, a.CONTACT_FORCE)
    for i in range(core.n):
        bend[i] = x[BLOCK * i + 4]
        for side in range(2):
            chamber[2 * i + side] = lengths[side, i]
        for d in range(3):
            directors[3 * i + d] = rows[_D_REF + d, i]
        for s in range(POINTS):
            k, m = s * lanes + i, POINTS * i + s
            load[m], slip[m] = p[_LOAD_N, k], slid[s, i]
            for d in range(3):
                points[3 * m + d], anchors[3 * m + d], kept[3 * m + d] = past[d, k], p[_ANCHOR + d, k], force[d, k]


@njit
def mass_centre(core: Core) -> tuple[FloatArray, FloatArray]:
    """Return linear and angular momentum, shape (6,), and the centre of mass, shape (3,)."""
    momentum, com = np.zeros(6), np.zeros(3)
    _momenta(core, momentum, com)
    return momentum, com


@inner
def _momenta(core: Core, momentum: FloatArray, com: FloatArray) -> None:
    """Momentum, angular momentum and centre of mass of all mass points."""
    fill(momentum, 0.0)
    fill(com, 0.0)
    total, mass = 0.0, vector(core.block, a.JOINT_MASS)
    x, v = matrix(core.block, a.JOINTS), matrix(core.block, a.JOINT_VELOCITY)
    for j in range(core.n + 1):
        total += _add_mass_point(mass[j], x[:3, j], v[:3, j], momentum, com)
    masses, x, v = (
        matrix(core.block, a.POINT_MASS),
        matrix(core.block, a.POINTS_PAST),
        matrix(core.block, a.POINT_VELOCITY),
    )
    for s in range(POINTS):
        for i in range(core.n):
            k = s * masses.shape[1] + i
            if masses[s, i] > 0.0:
                total += _add_mass_point(masses[s, i], x[:3, k], v[:3, k], momentum, com)
    for d in range(3):
        com[d] /= total


@inner
def _add_mass_point(mass: float, x: FloatArray, v: FloatArray, momentum: FloatArray, com: FloatArray) -> float:
    for d in range(3):
        b, c = (d + 1) % 3, (d + 2) % 3
        momentum[d] += mass * v[d]
        momentum[3 + d] += mass * (x[b] * v[c] - x[c] * v[b])
        com[d] += mass * x[d]
    return mass
