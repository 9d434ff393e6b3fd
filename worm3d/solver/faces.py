"""End faces: the point on the rim that touches the world in a step."""

from __future__ import annotations

from worm3d.machine import vectors
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner, njit
from worm3d.physics.kernels import point, segment
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, matrix
from worm3d.solver.entry import kernel, run

FACES = POINTS_PER_SEGMENT - 2
"""Index of the tail face among the points of a segment. The head face is the next point."""

_RADIUS, _NORMAL, _RIM = segment.SEGMENT_LAYOUT.firsts("radius", "normal", "rim")
_POINT_NORMAL, _ANCHOR = point.POINT_LAYOUT.firsts("normal", "anchor")


@njit
def turn_faces(core: Core) -> None:
    """Choose the points of the rims that are nearest to the world. They stay fixed to the body until the next call.

    A face that rolls touches the world with one point after the other. The anchor and the past positions are shifted
    together with the point. The positions of the new points are computed, but the distances still belong to the old
    points. The difference is of second order in the roll of a step.
    """
    radii = matrix(core.block, a.SEGMENT_IN)[_RADIUS : _RADIUS + 2]  # of the worm's ends
    for first in range(0, core.n, vectors.VECTOR_WIDTH):
        if radii[0, first] > 0.0 or radii[1, min(first + vectors.VECTOR_WIDTH, core.n) - 1] > 0.0:
            _turn(core, first)


@inner
def _turn(core: Core, first: int) -> None:
    """Choose the points of the faces for a vector of segments."""
    block, count = core.block, min(vectors.VECTOR_WIDTH, core.n - first)
    segments, p, before = matrix(block, a.SEGMENT_IN), matrix(block, a.POINT_IN), matrix(block, a.FIRST)
    past, lanes = matrix(block, a.POINTS_PAST), segments.shape[1]
    for face in range(2):
        k = (FACES + face) * lanes + first
        for d in range(3):
            normal, place = address(block, a.POINT_IN, _POINT_NORMAL + d), address(block, a.POINT_IN, d)
            vectors.move(address(block, a.SEGMENT_IN, _NORMAL + 3 * face + d) + 8 * first, normal + 8 * k, count)
            vectors.move(address(block, a.FIRST, 2 * d + face) + 8 * first, place + 8 * k, count)
    evaluate_kernel(kernel(core, a.SEGMENT_RIMS), segments, matrix(block, a.SEGMENT_OUT)[:4], count, first)
    for r in range(4):
        here = address(block, a.SEGMENT_OUT, r) + 8 * first
        vectors.move(address(block, a.SEGMENT_IN, _RIM + r) + 8 * first, here, count)
    run(core, a.SEGMENT_SHAPE, a.FORMED, a.SEGMENT_SHAPE_OUT, count, first)
    for face in range(2):
        for i in range(first, first + count):
            if segments[_RADIUS + face, i] > 0.0:
                k = (FACES + face) * lanes + i
                for d in range(3):
                    turned = p[d, k] - before[2 * d + face, i]
                    p[_ANCHOR + d, k] += turned
                    past[d, k] += turned
                    past[3 + d, k] += turned
