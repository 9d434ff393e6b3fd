"""Kernels called through their address, from Python and from compiled code.

No symbol of the kernel enters the compiled caller, which may be kept on disk: in the next process it receives that
process's address as an argument.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from worm3d.machine.codegen.casadi_vm import SIGNATURE
from worm3d.machine.codegen.emit import FINE
from worm3d.machine.writer import INT, Writer, declared
from worm3d.values.arrays import FloatArray

WRONG = "worm3d_wrong_shape"
"""Symbol of the function that compiled code calls where a kernel refuses its arrays."""
_refused: list[bool] = []


def evaluate(address: int, inputs: FloatArray, outputs: FloatArray, count: int, first: int = 0) -> None:
    """Evaluate `count` instances of the kernel at `address`; arrays as for `Kernel.__call__`.

    The instances begin at lane `first`, a multiple of the kernel's width.

    Raises
    ------
    ValueError
        If the shapes are not the kernel's, or there are fewer lanes.
    """
    at, to = (array.ctypes.data + 8 * first for array in (inputs, outputs))
    if first + count > inputs.shape[1] or SIGNATURE(address)(at, *inputs.shape, to, *outputs.shape, count) != FINE:
        _refused.append(True)
        require_accepted()


def _write(w: Writer, address: Any, inputs: Any, outputs: Any, count: Any, first: Any) -> None:
    """Write the call in compiled code."""
    b = w.builder
    places = [b.gep(array.pointer, [first], source_etype=array.kind) for array in (inputs, outputs)]
    beyond = b.icmp_signed(">", b.add(first, count), inputs.shape[1])
    values = [places[0], *inputs.shape, places[1], *outputs.shape, b.select(beyond, w.count(-1), count)]
    kind = ir.FunctionType(INT, [value.type for value in values])
    status = b.call(b.inttoptr(address, kind.as_pointer()), values)
    with b.if_then(b.icmp_signed("!=", status, w.count(FINE)), likely=False):
        b.call(declared(b.module, ir.FunctionType(ir.VoidType(), []), WRONG), [])


evaluate.write = _write  # type: ignore[attr-defined]


def require_accepted() -> None:
    """Raise ValueError where a kernel has refused its arrays since this was asked last."""
    if _refused:
        _refused.clear()
        raise ValueError("kernel: the arrays have not the kernel's rows or not enough lanes (see Kernel.allocate)")


@cache
def bind() -> Callable[[], None]:
    """Tell LLVM what `WRONG` is; the result lives as long as the process."""
    wrong = ctypes.CFUNCTYPE(None)(lambda: _refused.append(True))
    llvm.add_symbol(WRONG, ctypes.cast(wrong, ctypes.c_void_p).value)
    return wrong
