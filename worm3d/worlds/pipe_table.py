"""The compiled kernel of a pipe whose centre line has many pieces.

The formulas are in `worm3d.worlds.pipe_formula`. They are evaluated for all points at once, each with the piece in
which the point was found in the previous call (its last piece). The formula also returns whether this is certainly the
nearest piece. If it is not certain, a search walks along the chain from the last piece, and the formula is evaluated
again if the piece has changed. The results therefore do not depend on the stored pieces, which only save time.

Candidates for the nearest piece are the pieces between whose end planes the point lies. The candidate with the smallest
distance from the centre line is chosen. A point that is closer to the line than the reach (`Centreline.reach`) has only
one candidate.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine.codegen import evaluate
from worm3d.machine.codegen.emit import SHAPES_FIT, WRONG_SHAPE
from worm3d.machine.compiled import inner
from worm3d.machine.later import carray
from worm3d.machine.vectors import integers_at
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.worlds import kernels
from worm3d.worlds.pipe_formula import BETWEEN, PIECE

PIECE_ROWS = PIECE + BETWEEN
"""Number of the input rows after the point that describe a piece. This kernel changes these rows."""

NO_PIECE = -1.0
"""Number in place of the last piece for a point that has no last piece."""

TABLE_ROWS = 9
"""Number of the input rows after the rows of the formula. They are the number of the point's last piece; the addresses
of the table of pieces, of the table of planes where the pieces begin (normal and distance from the origin), and of the
formula's kernel (2 rows each); the number of pieces; and the reach [m]."""

_GRIP = kernels.WORLD_ROWS - 1


@inner
def _signs(outputs: int, lanes: int) -> IntArray:
    """Return the output row of the friction multipliers as integers, without copying it.

    An integer is negative if the sign bit of the multiplier is set, also for -0.0.
    """
    found: IntArray = carray(integers_at(outputs + 8 * _GRIP * lanes), (lanes,))
    return found


@inner
def _any_negative(signs: IntArray, count: int) -> bool:
    """Return whether one of the first `count` integers is negative."""
    bits = 0
    for lane in range(count):
        bits |= signs[lane]
    return bits < 0


@inner
def _ahead(planes: FloatArray, k: int, p: FloatArray, lane: int) -> float:
    """Return the signed distance of a point beyond the plane where a piece begins [m]."""
    return float(planes[k, 0] * p[0, lane] + planes[k, 1] * p[1, lane] + planes[k, 2] * p[2, lane] - planes[k, 3])


@inner
def _walk(planes: FloatArray, k: int, p: FloatArray, lane: int) -> int:
    """Walk along the chain from piece k, and return the first piece between whose end planes the point lies."""
    while k > 0 and _ahead(planes, k, p, lane) < 0.0:
        k -= 1
    while k < len(planes) - 1 and _ahead(planes, k + 1, p, lane) >= 0.0:
        k += 1
    return k


@inner
def _square(pieces: FloatArray, k: int, p: FloatArray, lane: int) -> float:
    """Return the square of a point's distance from piece k of the centre line, by (WP1) and (WP3) [m^2]."""
    ahead = aside = square = 0.0
    for d in range(3):
        ahead += (p[d, lane] - pieces[k, d]) * pieces[k, 3 + d]
        aside += (p[d, lane] - pieces[k, d]) * pieces[k, 6 + d]
    for d in range(3):
        across = p[d, lane] - pieces[k, d] - ahead * pieces[k, 3 + d] - aside * pieces[k, 6 + d]
        square += across * across
    kappa = pieces[k, 10]
    w = np.sqrt((kappa * ahead) ** 2 + (1.0 - kappa * aside) ** 2)
    delta = (kappa * (ahead * ahead + aside * aside) - 2.0 * aside) / (1.0 + w)
    return float(square + delta * delta)


@inner
def _nearest(pieces: FloatArray, planes: FloatArray, p: FloatArray, lane: int) -> int:
    """Return the nearest of all pieces between whose end planes the point lies, or -1 if there is no such piece."""
    last, found, nearest, begun = len(pieces) - 1, -1, 0.0, True
    for k in range(last + 1):
        ended = k < last and _ahead(planes, k + 1, p, lane) >= 0.0
        if begun and not ended:
            square = _square(pieces, k, p, lane)
            if found < 0 or square < nearest:
                found, nearest = k, square
        begun = ended
    return found


@inner
def _search(pieces: FloatArray, planes: FloatArray, reach: float, k: int, p: FloatArray, lane: int) -> int:
    """Return the piece nearest to the point of a lane, searched from piece k."""
    if reach > 0.0:
        here = _walk(planes, k, p, lane)
        if _square(pieces, here, p, lane) < reach * reach:
            return here
    return _nearest(pieces, planes, p, lane)


@inner
def _keep(pieces: FloatArray, k: int, p: FloatArray, lane: int, last: int) -> None:
    """Write piece k to the input rows of a lane, and its number to the row `last`."""
    for r in range(PIECE_ROWS):
        p[3 + r, lane] = pieces[k, r]
    p[last, lane] = k


@inner
def _choose(p: FloatArray, signs: IntArray, own: int, first: int, end: int) -> bool:
    """Search the pieces of the points whose piece is uncertain, in the lanes from `first` to before `end`.

    Return whether the piece of a point has changed. `own` is the first of the `TABLE_ROWS`.
    """
    count = int(p[own + 7, 0])
    pieces, planes = kernels.table(p, own + 1, count, PIECE_ROWS), kernels.table(p, own + 3, count, 4)
    reach, last, changed = p[own + 8, 0], own, False
    for lane in range(first, end):
        if signs[lane] >= 0:
            continue
        before = int(p[last, lane])
        if kernels.repeats(p, lane):
            found = int(p[last, lane - 1])
        else:
            start = before if before >= 0 or lane == 0 else int(p[last, lane - 1])
            found = _search(pieces, planes, reach, max(start, 0), p, lane)
        if found != before:
            _keep(pieces, found, p, lane, last)
            changed = True
    return changed


def pipe(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points. This function is the kernel of a `Pipe` of many pieces."""
    own = rows_in - TABLE_ROWS
    if own < 3 + PIECE_ROWS or rows_out != kernels.WORLD_ROWS or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    if count == 0:
        return SHAPES_FIT
    p, out = kernels.doubles(inputs, rows_in, lanes_in), kernels.doubles(outputs, rows_out, lanes_out)
    given = kernels.doubles(inputs, own, lanes_in)
    formula, signs = kernels.address(p[own + 5, 0], p[own + 6, 0]), _signs(outputs, lanes_out)
    evaluate(formula, given, out, count)
    if not _any_negative(signs, count):
        return SHAPES_FIT
    for first in range(0, count, kernels.LANES):
        end = min(first + kernels.LANES, count)
        if _choose(p, signs, own, first, end):
            evaluate(formula, given, out, end - first, first)
        for lane in range(first, end):
            out[_GRIP, lane] = abs(out[_GRIP, lane])
    return SHAPES_FIT
