"""Calls of kernels by their address, from Python and from code that Numba has compiled.

The address of a kernel is an ordinary argument of the compiled code. The compiled code therefore contains no symbol of
the kernel and can be stored on disk. Another process can load it and call it with the kernel's address in that process.
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

REFUSED = "kernel: got arrays with the wrong number of rows or too few lanes: create them with Kernel.allocate"


def _run(address: int, at: int, rows_in: int, lanes_in: int, to: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Run the kernel at `address`, and return its status (`worm3d.machine.codegen.emit`).

    `at` and `to` are the addresses of the first input and of the first output.
    """
    return int(SIGNATURE(address)(at, rows_in, lanes_in, to, rows_out, lanes_out, count))


def _write(
    w: Writer, address: Any, at: Any, rows_in: Any, lanes_in: Any, to: Any, rows_out: Any, lanes_out: Any, count: Any
) -> Any:
    return w.invoke(address, INT, at, rows_in, lanes_in, to, rows_out, lanes_out, count)


def evaluate(
    address: int, inputs: npt.NDArray[np.float64], outputs: npt.NDArray[np.float64], count: int, first: int = 0
) -> None:
    """Evaluate `count` instances of the kernel at `address`. The function can also be called from compiled code.

    Each instance uses one lane, which is a column of the arrays. The arrays have the layout that `Kernel`
    describes. The first instance uses the lane `first`, which must be a multiple of the kernel's width.

    Raises
    ------
    ValueError
        The arrays do not have the numbers of rows that the kernel needs, or they have too few lanes.
    """
    rows_in, lanes_in = inputs.shape
    rows_out, lanes_out = outputs.shape
    at, to = inputs.ctypes.data + BYTES * first, outputs.ctypes.data + BYTES * first
    fits = first + count <= lanes_in
    if not fits or _run(address, at, rows_in, lanes_in, to, rows_out, lanes_out, count) != SHAPES_FIT:
        raise ValueError(REFUSED)


def _compiled() -> Any:
    import numba

    # The compiled code contains a file name, for exceptions. The name of the module makes it independent of the folder.
    code = evaluate.__code__.replace(co_filename=__name__)
    return numba.njit(FunctionType(code, evaluate.__globals__, evaluate.__name__, evaluate.__defaults__))


later(_run, lambda: intrinsic(_write, int))
later(evaluate, _compiled)
