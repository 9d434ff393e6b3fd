"""End faces: which place of the rim touches the world in a step."""

from __future__ import annotations

from worm3d.codegen import evaluate as run
from worm3d.compiled import njit
from worm3d.kernels import point, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import copy, matrix, rows
from worm3d.solver.entry import kernel

FACES = 6
"""Number of the tail face among the points of a segment; the head face follows."""

_RADIUS, _NORMAL, _RIM = segment.LAYOUT.firsts("radius", "normal", "rim")
_POINT_NORMAL, _ANCHOR = point.LAYOUT.firsts("normal", "anchor")


@njit
def turn_faces(core: Core) -> None:
    """Choose the places of the rims nearest to the world, fixed to the body until this is called again.

    A rolling face touches with one place after the other: anchor and past go over to the new one as they are to the
    old. The points are placed; distances stay those of the old places, a second-order difference in the roll of a step.
    """
    segments, p = matrix(core.block, a.SEGMENT_IN), matrix(core.block, a.POINT_IN)
    past, before = matrix(core.block, a.POINTS_PAST), matrix(core.block, a.FIRST)
    lanes = segments.shape[1]
    for face in range(2):
        first = (FACES + face) * lanes
        for d in range(3):
            copy(segments[_NORMAL + 3 * face + d], p[_POINT_NORMAL + d, first : first + lanes])
    run(kernel(core, a.SEGMENT_RIMS), segments, matrix(core.block, a.SEGMENT_OUT)[:4], core.n)
    copy(rows(core.block, a.SEGMENT_IN, _RIM, 4), rows(core.block, a.SEGMENT_OUT, 0, 4))
    copy(rows(core.block, a.FIRST, 0, before.shape[0]), rows(core.block, a.POINT_IN, 0, 3))
    run(kernel(core, a.SEGMENT_SHAPE), segments, matrix(core.block, a.REST), core.n)
    points = segment.POINTS
    for face in range(2):
        for i in range(core.n):
            if segments[_RADIUS + face, i] > 0.0:
                k = (FACES + face) * lanes + i
                for d in range(3):
                    turned = p[d, k] - before[points * d + FACES + face, i]
                    p[_ANCHOR + d, k] += turned
                    past[d, k] += turned
                    past[3 + d, k] += turned
