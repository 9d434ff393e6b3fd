"""The compiled pipe of many pieces: those that come into question are looked up, and the formula read for many at once.

The formulas are in `worm3d.worlds.pipe_kernel`. Of the pieces between whose end planes a point lies (see
`worm3d.worlds.chain`) the one with the smallest distance from the centre line counts; mostly there is one only. A point
closer to the line than its reach (`Centreline.reach`) has one only: it is found from that of the point before, on foot.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.codegen import evaluate
from worm3d.codegen.emit import FINE, WRONG_SHAPE
from worm3d.compiled import inner
from worm3d.worlds import table
from worm3d.worlds.pipe_kernel import PIECE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TOGETHER = 32
"""Points of which the formula is read together: a multiple of every vector."""

FIRST = 3 + PIECE
"""Rows of the formula's inputs that are written here; the others are the same for all points."""

ROWS = table.WORLD_ROWS + 1
"""Of the formula's outputs: the world's, and the distance from the centre line."""

ROWS_IN = 3 + 10 + 3
"""Point; addresses of the pieces, of the planes at which they begin (normal and distance from the origin, a row each),
of the formula's kernel, its inputs and its outputs (2 each); number of pieces, and of rows of the inputs; reach [m]."""

_PIECES, _PLANES, _KERNEL, _INPUTS, _OUTPUTS, _COUNT, _ROWS, _REACH = 3, 5, 7, 9, 11, 13, 14, 15


@inner
def _ahead(planes: FloatArray, k: int, p: FloatArray, lane: int) -> float:
    """Return how far a point lies beyond the plane at which a piece begins [m]."""
    return float(planes[k, 0] * p[0, lane] + planes[k, 1] * p[1, lane] + planes[k, 2] * p[2, lane] - planes[k, 3])


@inner
def _walk(planes: FloatArray, k: int, p: FloatArray, lane: int) -> int:
    """Return a piece between whose end planes a point lies, the first one on the way from a piece."""
    while k > 0 and _ahead(planes, k, p, lane) < 0.0:
        k -= 1
    while k < len(planes) - 1 and _ahead(planes, k + 1, p, lane) >= 0.0:
        k += 1
    return k


@inner
def _close(pieces: FloatArray, k: int, p: FloatArray, lane: int, reach: float) -> bool:
    """Return whether a point is closer than the reach to where a piece begins, so that its nearest piece is known."""
    x, y, z = p[0, lane] - pieces[k, 0], p[1, lane] - pieces[k, 1], p[2, lane] - pieces[k, 2]
    return bool(x * x + y * y + z * z < reach * reach)


@inner
def _collect(inputs: FloatArray, n: int, pieces: FloatArray, k: int, p: FloatArray, lane: int) -> None:
    """Write point and piece as column n."""
    for d in range(3):
        inputs[d, n] = p[d, lane]
    for r in range(PIECE):
        inputs[3 + r, n] = pieces[k, r]


@inner
def _read(outputs: FloatArray, lanes: IntArray, n: int, nearest: FloatArray, out: FloatArray) -> None:
    """Write the rows of the points of n columns that have been evaluated, each of the piece nearest to it so far."""
    for m in range(n):
        lane, d = lanes[m], outputs[table.WORLD_ROWS, m]
        if not d >= nearest[lane]:  # NaN too
            nearest[lane] = d
            for r in range(table.WORLD_ROWS):
                out[r, lane] = outputs[r, m]


def pipe(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points; the kernel of a `Pipe` of many pieces."""
    if rows_in != ROWS_IN or rows_out != table.WORLD_ROWS or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    if count == 0:
        return FINE
    p, out = table.doubles(inputs, rows_in, lanes_in), table.doubles(outputs, rows_out, lanes_out)
    pieces = table.doubles(table.address(p[_PIECES, 0], p[_PIECES + 1, 0]), int(p[_COUNT, 0]), PIECE)
    given = table.doubles(table.address(p[_INPUTS, 0], p[_INPUTS + 1, 0]), int(p[_ROWS, 0]), TOGETHER)
    found = table.doubles(table.address(p[_OUTPUTS, 0], p[_OUTPUTS + 1, 0]), ROWS, TOGETHER)
    planes = table.doubles(table.address(p[_PLANES, 0], p[_PLANES + 1, 0]), len(pieces), 4)
    formula, reach = table.address(p[_KERNEL, 0], p[_KERNEL + 1, 0]), p[_REACH, 0]
    lanes, nearest, collected, last = np.empty(TOGETHER, np.int64), np.full(count, np.inf), 0, len(pieces) - 1
    here = 0
    for lane in range(count):
        if table.repeats(p, lane):
            continue
        here = _walk(planes, here, p, lane)
        known = _close(pieces, here, p, lane, reach)
        first, end = (here, here + 1) if known else (0, last + 1)
        begun = True
        for k in range(first, end):
            ended = not known and k < last and _ahead(planes, k + 1, p, lane) >= 0.0
            if begun and not ended:
                _collect(given, collected, pieces, k, p, lane)
                lanes[collected] = lane
                collected += 1
                if collected == TOGETHER:
                    evaluate(formula, given, found, collected)
                    _read(found, lanes, collected, nearest, out)
                    collected = 0
            begun = ended
    evaluate(formula, given, found, collected)
    _read(found, lanes, collected, nearest, out)
    for lane in range(count):
        if table.repeats(p, lane):
            table.repeat(out, lane)
    return FINE
