"""The compiled mesh: for each point the coefficients about it are collected, and the spline is read for many at once.

The formulas are in `worm3d.worlds.mesh_spline`. Where the nearest coefficient says that a point is farther outside
than `CONTACT`, a parameter, the distance is read linearly from it: it only tells how far away the surface is.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine.codegen import evaluate
from worm3d.machine.codegen.emit import FINE, WRONG_SHAPE
from worm3d.machine.compiled import inner
from worm3d.values.arrays import FloatArray, SingleArray
from worm3d.worlds import mesh_spline, table
from worm3d.worlds.table import Jet

CONTACT = 2.8
"""Cells: the point is then a cell from the surface at least, as the node before it is at most sqrt(3) away."""

TOGETHER = 16
"""Points of which the splines are read together: a multiple of every vector, and few enough for the nearest cache."""

ROWS_IN, ROWS_OUT = 3 + 16, 11
"""Point; addresses of coefficients, of working memory and of the spline's kernel (2 each), nodes along each axis, first
node, cell, side of the solid, grip, `CONTACT`."""

_COEFFICIENTS, _WORK, _SPLINE, _NODES, _FIRST, _CELL, _SIDE, _GRIP, _CONTACT = 3, 5, 7, 9, 12, 15, 16, 17, 18

WORK_ROWS = mesh_spline.ROWS_IN + mesh_spline.ROWS_OUT + 1
"""Of the working memory, `TOGETHER` columns: inputs and outputs of the spline, and the lanes that they belong to."""

_PLACE, _OUT, _LANE = mesh_spline.SIDE**3, mesh_spline.ROWS_IN, mesh_spline.ROWS_IN + mesh_spline.ROWS_OUT

Nodes = tuple[int, int, int]
Cell = tuple[int, float, float, float]
"""Number of the node before a place, and the way from there along each axis."""


@inner
def _cell(nodes: Nodes, x: float, y: float, z: float) -> Cell:
    i, r = table.cell(x, nodes[0])
    j, s = table.cell(y, nodes[1])
    k, t = table.cell(z, nodes[2])
    return (i * nodes[1] + j) * nodes[2] + k, r, s, t


@inner
def _collect(work: FloatArray, n: int, c: SingleArray, nodes: Nodes, at: Cell, lane: int) -> None:
    """Write what the spline needs about a point as column n."""
    row, one = np.uint64(0), np.uint64(1)  # unsigned: a negative index would mean the end, and be looked for
    column = np.uint64(n)
    for a in range(4):
        for b in range(4):
            first = np.uint64(at[0] + ((a - 1) * nodes[1] + b - 1) * nodes[2] - 1)
            for _ in range(4):
                work[row, column] = c[first]
                row += one
                first += one
    work[_PLACE, n], work[_PLACE + 1, n], work[_PLACE + 2, n] = at[1], at[2], at[3]
    work[_LANE, n] = lane


@inner
def _linear(c: SingleArray, nodes: Nodes, at: Cell) -> Jet:
    """Return what is linear along each axis from the node before a point, and its direction of steepest ascent."""
    node, r, s, t = at
    here = np.float64(c[node])
    x, y, z = c[node + nodes[1] * nodes[2]] - here, c[node + nodes[2]] - here, c[node + 1] - here
    size = x * x + y * y + z * z
    unit = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
    return here + r * x + s * y + t * z, x * unit, y * unit, z * unit, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _outside(place: float, nodes: int) -> float:
    """Return how far a place lies beyond the grid, signed, in nodes."""
    return min(place - 1.0, 0.0) + max(place - (nodes - 2.0), 0.0)


@inner
def _beyond(jet: Jet, nodes: Nodes, x: float, y: float, z: float) -> Jet:
    """Return the distance where a place is beyond the grid, and with it outside the mesh; else as it is."""
    x, y, z = _outside(x, nodes[0]), _outside(y, nodes[1]), _outside(z, nodes[2])
    size = np.sqrt(x * x + y * y + z * z)
    if not size > 0.0:
        return jet
    return jet[0] + size, x / size, y / size, z / size, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inner
def _place(p: FloatArray, k: int) -> tuple[float, float, float]:
    """Return the place of a point in nodes."""
    share = 1.0 / p[_CELL, 0]
    return (
        (p[0, k] - p[_FIRST, 0]) * share,
        (p[1, k] - p[_FIRST + 1, 0]) * share,
        (p[2, k] - p[_FIRST + 2, 0]) * share,
    )


@inner
def _write(p: FloatArray, out: FloatArray, k: int, jet: Jet, nodes: Nodes) -> None:
    x, y, z = _place(p, k)
    cell, side = p[_CELL, 0], p[_SIDE, 0]
    table.write(out, k, _beyond(jet, nodes, x, y, z), side * cell, side, side / cell, p[_GRIP, 0])


@inner
def _read(p: FloatArray, out: FloatArray, work: FloatArray, n: int, nodes: Nodes) -> None:
    """Read the spline for the points collected, and write their rows."""
    found = work[_OUT:_LANE]
    evaluate(table.address(p[_SPLINE, 0], p[_SPLINE + 1, 0]), work[:_OUT], found, n)
    for m in range(n):
        jet = (
            *(found[0, m], found[1, m], found[2, m], found[3, m]),
            *(found[4, m], found[5, m], found[6, m], found[7, m], found[8, m], found[9, m]),
        )
        _write(p, out, int(work[_LANE, m]), jet, nodes)


def mesh(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points; the kernel of `Mesh`."""
    if rows_in != ROWS_IN or rows_out != ROWS_OUT or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    p, out = table.doubles(inputs, rows_in, lanes_in), table.doubles(outputs, rows_out, lanes_out)
    if count == 0:
        return FINE
    nodes = int(p[_NODES, 0]), int(p[_NODES + 1, 0]), int(p[_NODES + 2, 0])
    place = table.address(p[_COEFFICIENTS, 0], p[_COEFFICIENTS + 1, 0])
    c = table.singles(place, nodes[0] * nodes[1] * nodes[2])
    work = table.doubles(table.address(p[_WORK, 0], p[_WORK + 1, 0]), WORK_ROWS, TOGETHER)
    side, contact, collected = p[_SIDE, 0], p[_CONTACT, 0], 0
    for k in range(count):
        if not table.repeats(p, k):
            x, y, z = _place(p, k)
            at = _cell(nodes, x, y, z)
            if side * c[at[0]] > contact:
                _write(p, out, k, _linear(c, nodes, at), nodes)
            else:
                _collect(work, collected, c, nodes, at, k)
                collected += 1
        if collected == TOGETHER:
            _read(p, out, work, collected, nodes)
            collected = 0
    _read(p, out, work, collected, nodes)
    for k in range(count):
        if table.repeats(p, k):
            table.repeat(out, k)
    return FINE
