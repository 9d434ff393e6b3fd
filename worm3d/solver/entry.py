"""Calls by address within the compiled code, between functions that are compiled separately.

Numba optimises all called functions again together with each caller. In a deep call tree, compilation would take
minutes. An entry is a C function `double f(int64 handle, double value, int64 a, int64 b)`. The handle is the address of
the numbers of a `Core`.
"""

from __future__ import annotations

from typing import Any

from worm3d.machine.codegen import evaluate
from worm3d.machine.compiled import inner
from worm3d.machine.writer import DOUBLE, Writer, on_addresses
from worm3d.solver.arrays import COUNTERS, HANDLE, Core
from worm3d.solver.block import Block, integers, matrix


@on_addresses(float)
def call(w: Writer, address: Any, handle: Any, value: Any, a: Any, b: Any) -> Any:
    """Call the entry at an address."""
    return w.invoke(address, DOUBLE, handle, value, a, b)


@inner
def opened(handle: int) -> Core:
    """Return the core that belongs to a handle."""
    n, memory, table, kernels, counters = integers(handle, HANDLE)
    return Core(n, kernels, Block(memory, table), counters, handle)


@inner
def kernel(core: Core, k: int) -> int:
    """Return the address of a kernel or entry, one of `worm3d.solver.arrays.KERNELS`."""
    return int(integers(core.kernels, k + 1)[k])


@inner
def run(core: Core, k: int, given: int, out: int, count: int, first: int = 0) -> None:
    """Run kernel k on `count` lanes, starting at lane `first`, of the arrays with the indices `given` and `out`."""
    evaluate(kernel(core, k), matrix(core.block, given), matrix(core.block, out), count, first)


@inner
def reset(core: Core) -> None:
    """Set all counters to zero."""
    for k in range(COUNTERS):
        integers(core.counters, COUNTERS)[k] = 0


@inner
def count(core: Core, k: int) -> None:
    """Add 1 to counter k."""
    integers(core.counters, k + 1)[k] += 1
