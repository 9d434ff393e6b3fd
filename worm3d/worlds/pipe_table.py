"""The compiled pipe of many pieces: those that come into question are looked up, and the formula read for many at once.

The formulas are in `worm3d.worlds.pipe_kernel`. Of the pieces between whose end planes a point lies (see
`worm3d.worlds.chain`) the one with the smallest distance from the centre line counts; mostly there is one only.
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

ROWS_IN = 3 + 10 + 2
"""Point; addresses of the pieces, of the planes at which they begin (normal and distance from the origin, a column
each), of the formula's kernel, its inputs and its outputs (2 each); number of pieces, and of rows of the inputs."""

_PIECES, _PLANES, _KERNEL, _INPUTS, _OUTPUTS, _COUNT, _ROWS = 3, 5, 7, 9, 11, 13, 14


@inner
def _ahead(planes: FloatArray, x: float, y: float, z: float, ahead: FloatArray) -> None:
    """Write how far a point lies beyond each plane at which a piece begins [m]."""
    for k in range(len(ahead)):
        ahead[k] = planes[0, k] * x + planes[1, k] * y + planes[2, k] * z - planes[3, k]


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
    planes = table.doubles(table.address(p[_PLANES, 0], p[_PLANES + 1, 0]), 4, len(pieces))
    formula = table.address(p[_KERNEL, 0], p[_KERNEL + 1, 0])
    lanes, nearest, collected, last = np.empty(TOGETHER, np.int64), np.full(count, np.inf), 0, len(pieces) - 1
    ahead = np.empty(len(pieces))
    for lane in range(count):
        if table.repeats(p, lane):
            continue
        _ahead(planes, p[0, lane], p[1, lane], p[2, lane], ahead)
        here = True
        for k in range(len(pieces)):
            after = k < last and ahead[k + 1] >= 0.0
            if here and not after:
                _collect(given, collected, pieces, k, p, lane)
                lanes[collected] = lane
                collected += 1
                if collected == TOGETHER:
                    evaluate(formula, given, found, collected)
                    _read(found, lanes, collected, nearest, out)
                    collected = 0
            here = after
    evaluate(formula, given, found, collected)
    _read(found, lanes, collected, nearest, out)
    for lane in range(count):
        if table.repeats(p, lane):
            table.repeat(out, lane)
    return FINE
