"""Kernels called from Numba's compiled code, through their address, which is a value like any other.

No symbol of the kernel enters the compiled caller, so that may be kept on disk: in the next process it receives that
process's address as an argument.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir

from worm3d.machine.codegen.casadi_vm import SIGNATURE
from worm3d.machine.codegen.emit import FINE
from worm3d.machine.later import later, placeholder
from worm3d.machine.writer import INT

REFUSED = "kernel: the arrays have not the kernel's rows or not enough lanes (see Kernel.allocate)"


def _intrinsic() -> Any:
    from numba.core import types
    from numba.core.errors import TypingError
    from numba.extending import intrinsic

    def typed(_context: Any, address: Any, inputs: Any, outputs: Any, first: Any, count: Any) -> Any:
        """Status of the kernel at `address`, with the arrays from lane `first` on (`worm3d.machine.codegen.emit`)."""
        for array in (inputs, outputs):
            if not (
                isinstance(array, types.Array) and (array.dtype, array.ndim, array.layout) == (types.float64, 2, "C")
            ):
                raise TypingError(f"kernel: arrays must be float64, two-dimensional and C-contiguous, got {array}")
        return types.int64(address, inputs, outputs, first, count), _generate

    return intrinsic(typed)


def _generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    from numba.core import types

    address, first, count = (context.cast(builder, args[i], signature.args[i], types.int64) for i in (0, 3, 4))
    values = [*_pointer_and_shape(context, builder, signature, args, 1)]
    values += [*_pointer_and_shape(context, builder, signature, args, 2), count]
    for k in (0, 3):
        values[k] = builder.gep(values[k], [first])
    kind = ir.FunctionType(INT, [value.type for value in values])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), values)


def _pointer_and_shape(context: Any, builder: Any, signature: Any, args: Any, i: int) -> tuple[Any, Any, Any]:
    array = context.make_array(signature.args[i])(context, builder, args[i])
    return (array.data, builder.extract_value(array.shape, 0), builder.extract_value(array.shape, 1))


_invoke: Any = placeholder(_intrinsic)


def evaluate(
    address: int, inputs: npt.NDArray[np.float64], outputs: npt.NDArray[np.float64], count: int, first: int = 0
) -> None:
    """Evaluate `count` instances of the kernel at `address`, in compiled code too; arrays as for `Kernel.__call__`.

    The instances begin at lane `first`, a multiple of the kernel's width.

    Raises
    ------
    ValueError
        If the shapes are not the kernel's, or there are fewer lanes.
    """
    at, to = (array.ctypes.data + 8 * first for array in (inputs, outputs))
    if first + count > inputs.shape[1] or SIGNATURE(address)(at, *inputs.shape, to, *outputs.shape, count) != FINE:
        raise ValueError(REFUSED)


def _compiled() -> Any:
    import numba

    @numba.njit
    def evaluate(
        address: int, inputs: npt.NDArray[np.float64], outputs: npt.NDArray[np.float64], count: int, first: int = 0
    ) -> None:
        if first + count > inputs.shape[1] or _invoke(address, inputs, outputs, first, count) != 0:
            raise ValueError(REFUSED)

    return evaluate


later(evaluate, _compiled)
