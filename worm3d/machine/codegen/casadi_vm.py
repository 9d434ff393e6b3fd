"""The fall-back: CasADi's own virtual machine behind the interface of a native kernel, about 200 times slower."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable

import casadi
import numpy as np
import numpy.typing as npt

from worm3d.machine.codegen.emit import SHAPES_FIT, WRONG_SHAPE

FAILED_STATUS = 2
"""Status of a kernel whose virtual machine has thrown an error."""
SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int64, *(ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64) * 2, ctypes.c_int64)
"""C signature of a kernel, native or not (`worm3d.machine.codegen.emit`)."""


def evaluator(function: casadi.Function) -> tuple[int, object]:
    """Return the address of a C function of `SIGNATURE`, and an owner that must live as long as the address is used."""
    argument, result = np.zeros(function.nnz_in()), np.zeros(function.nnz_out())
    buffer, run = function.buffer()
    lock = threading.Lock()  # threads share the buffers
    _attach(buffer.set_arg, argument, [function.nnz_in(i) for i in range(function.n_in())])
    _attach(buffer.set_res, result, [function.nnz_out(i) for i in range(function.n_out())])

    def evaluate(in_: int, rows_in: int, lanes_in: int, out: int, rows_out: int, lanes_out: int, count: int) -> int:
        if (rows_in, rows_out) != (argument.size, result.size) or not 0 <= count <= min(lanes_in, lanes_out):
            return WRONG_SHAPE
        inputs, outputs = _view(in_, rows_in, lanes_in), _view(out, rows_out, lanes_out)
        with lock:
            for k in range(count):
                argument[:] = inputs[:, k]
                run()
                if buffer.ret():
                    return FAILED_STATUS
                outputs[:, k] = result
        return SHAPES_FIT

    callback = SIGNATURE(evaluate)
    return int(ctypes.cast(callback, ctypes.c_void_p).value or 0), (callback, buffer, argument, result)


def _attach(put: Callable[..., None], values: npt.NDArray[np.float64], sizes: list[int]) -> None:
    """Give CasADi consecutive parts of `values` as arguments or results."""
    first = 0
    for i, size in enumerate(sizes):
        put(i, values[first : first + size].data)
        first += size


def _view(address: int | None, rows: int, lanes: int) -> npt.NDArray[np.float64]:
    if address is None or rows * lanes == 0:
        return np.zeros((rows, lanes))
    return np.ctypeslib.as_array((ctypes.c_double * (rows * lanes)).from_address(address)).reshape(rows, lanes)
