"""Calls of kernels by address from code that Numba compiles.

The address is an ordinary value. The compiled caller contains no symbol of the kernel and can therefore be stored on
disk. In a later process it receives, as an argument, the address that the kernel has in that process.
"""

from __future__ import annotations

import ctypes
from types import FunctionType
from typing import Any

import numpy as np
import numpy.typing as npt

from worm3d.machine.codegen.emit import SHAPES_FIT
from worm3d.machine.later import later
from worm3d.machine.writer import BYTES, INT, Writer, intrinsic

SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int64, *(ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64) * 2, ctypes.c_int64)
"""C signature of a kernel (`worm3d.machine.codegen.emit`)."""

REFUSED = "kernel: the arrays have not the kernel's rows or not enough lanes (see Kernel.allocate)"


def _run(address: int, at: int, rows_in: int, lanes_in: int, to: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Run the kernel at an address (`worm3d.machine.codegen.emit`), and return its status."""
    return int(SIGNATURE(address)(at, rows_in, lanes_in, to, rows_out, lanes_out, count))


def _write(
    w: Writer, address: Any, at: Any, rows_in: Any, lanes_in: Any, to: Any, rows_out: Any, lanes_out: Any, count: Any
) -> Any:
    return w.invoke(address, INT, at, rows_in, lanes_in, to, rows_out, lanes_out, count)


def evaluate(
    address: int, inputs: npt.NDArray[np.float64], outputs: npt.NDArray[np.float64], count: int, first: int = 0
) -> None:
    """Evaluate `count` instances of the kernel at `address`, from Python or compiled code.

    The arrays are as for `Kernel.__call__`. The instances begin at lane `first`, a multiple of the kernel's width.

    Raises
    ------
    ValueError
        The numbers of rows differ from the kernel's, or there are too few lanes.
    """
    rows_in, lanes_in = inputs.shape
    rows_out, lanes_out = outputs.shape
    at, to = inputs.ctypes.data + BYTES * first, outputs.ctypes.data + BYTES * first
    fits = first + count <= lanes_in
    if not fits or _run(address, at, rows_in, lanes_in, to, rows_out, lanes_out, count) != SHAPES_FIT:
        raise ValueError(REFUSED)


def _compiled() -> Any:
    import numba

    # An exception names the file. Without the folder, the object code is the same in every folder.
    code = evaluate.__code__.replace(co_filename=__name__)
    return numba.njit(FunctionType(code, evaluate.__globals__, evaluate.__name__, evaluate.__defaults__))


later(_run, lambda: intrinsic(_write, int))
later(evaluate, _compiled)
