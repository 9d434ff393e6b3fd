"""The compiled union: the kernels of its worlds one after the other, and at each point the greatest distance."""

from __future__ import annotations

from worm3d.machine.codegen import evaluate
from worm3d.machine.codegen.emit import FINE, WRONG_SHAPE
from worm3d.machine.compiled import inner
from worm3d.values.arrays import FloatArray
from worm3d.worlds import table

TOGETHER = 528
"""Points that are handed over at once: a multiple of every vector, and no power of 2, by which rows would fall on the
same lines of the cache. Points of a longer worm share what a world keeps of them, which takes time."""

ROWS_IN = 3 + 3
"""Point; address (2) and number of the rows of `MEMBER`."""

MEMBER = 7
"""Of each world: addresses of kernel, inputs and outputs (2 each), `TOGETHER` columns; and the number of its inputs."""

_MEMBERS, _COUNT = 3, 5
_KERNEL, _INPUTS, _OUTPUTS, _ROWS = 0, 2, 4, 6


@inner
def _ask(member: FloatArray, p: FloatArray, first: int, count: int) -> FloatArray:
    """Return what a world says of some points, shape (11, `TOGETHER`)."""
    inputs = table.doubles(table.address(member[_INPUTS], member[_INPUTS + 1]), int(member[_ROWS]), TOGETHER)
    outputs = table.doubles(table.address(member[_OUTPUTS], member[_OUTPUTS + 1]), table.WORLD_ROWS, TOGETHER)
    for d in range(3):
        for k in range(count):
            inputs[d, k] = p[d, first + k]
    evaluate(table.address(member[_KERNEL], member[_KERNEL + 1]), inputs, outputs, count)
    return outputs


@inner
def _keep(rows: FloatArray, out: FloatArray, first: int, count: int) -> None:
    """Write the rows of a world."""
    for r in range(table.WORLD_ROWS):
        for k in range(count):
            out[r, first + k] = rows[r, k]


@inner
def _keep_greater(rows: FloatArray, out: FloatArray, first: int, count: int) -> None:
    """Write the rows of a world where its distance is greater than that of those before."""
    for k in range(count):
        if rows[0, k] > out[0, first + k]:
            for r in range(table.WORLD_ROWS):
                out[r, first + k] = rows[r, k]


def union(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points; the kernel of `Union`."""
    if rows_in != ROWS_IN or rows_out != table.WORLD_ROWS or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    if count == 0:
        return FINE
    p, out = table.doubles(inputs, rows_in, lanes_in), table.doubles(outputs, rows_out, lanes_out)
    members = table.doubles(table.address(p[_MEMBERS, 0], p[_MEMBERS + 1, 0]), int(p[_COUNT, 0]), MEMBER)
    for first in range(0, count, TOGETHER):
        some = min(TOGETHER, count - first)
        _keep(_ask(members[0], p, first, some), out, first, some)
        for m in range(1, len(members)):
            _keep_greater(_ask(members[m], p, first, some), out, first, some)
    return FINE
