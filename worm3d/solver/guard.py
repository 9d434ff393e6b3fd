"""What becomes of a worm whose shape the model no longer stands for."""

from __future__ import annotations

import numpy as np

from worm3d.machine.compiled import inner
from worm3d.physics.kernels import joint, point
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, POINTS, Core
from worm3d.solver.block import matrix, total, vector
from worm3d.solver.evaluate import LENGTHS, TANGENT

OK, NO_CONVERGENCE, NOT_FINITE, FLATTENED, FOLDED, SUNK = range(6)
"""How a step ended."""

_HINGE = joint.LAYOUT.first("hinge")
_DISTANCE = point.LAYOUT.first("distance")


@inner
def guard(core: Core) -> int:
    """Return OK for a shape that the model stands for, else what became of it."""
    rest, longest = matrix(core.block, a.REST), vector(core.block, a.LONGEST)
    if not np.isfinite(total(vector(core.block, a.X))):
        return NOT_FINITE
    for i in range(core.n):
        if max(rest[LENGTHS, i], rest[LENGTHS + 1, i]) > longest[i]:
            return FLATTENED
    if _folded(core):
        return FOLDED
    return SUNK if _sunk(core) else OK


@inner
def _folded(core: Core) -> bool:
    """Return whether neighbouring segments enclose 90 degrees or more, or bends and hinge together ask for it."""
    rest, joints = matrix(core.block, a.REST), matrix(core.block, a.JOINT_IN)
    x = vector(core.block, a.X)
    for i in range(core.n - 1):
        cosine = 0.0
        for d in range(3):
            cosine += rest[TANGENT + d, i] * rest[TANGENT + d, i + 1]
        if cosine <= 0.0 or abs(0.5 * (x[BLOCK * i + 4] + x[BLOCK * i + 9]) + joints[_HINGE, i]) >= 0.5 * np.pi:
            return True
    return False


@inner
def _sunk(core: Core) -> bool:
    """Return whether a joint is too deep in the world."""
    numbers, distance = vector(core.block, a.NUMBERS_), matrix(core.block, a.POINT_IN)[_DISTANCE]
    lanes = len(distance) // POINTS
    if numbers[a.CLAMPED] != 0.0:
        return False
    for i in range(core.n):
        if distance[6 * lanes + i] <= -numbers[a.DEEPEST]:
            return True
    return bool(distance[7 * lanes + core.n - 1] <= -numbers[a.DEEPEST])
