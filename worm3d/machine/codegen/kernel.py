"""Kernels: CasADi functions compiled for many instances at once. The public interface of `worm3d.machine.codegen`."""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from pathlib import Path

import casadi
import numpy as np

from worm3d.machine import cache
from worm3d.machine.codegen import native
from worm3d.machine.codegen.emit import require_sx
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True)
class Kernel:
    """A CasADi function y = f(x), evaluated for many instances at once by `worm3d.machine.codegen.evaluate`.

    Inputs and outputs are arrays. Column k belongs to instance k. Row r of `inputs` is the r-th nonzero entry of the
    inputs of the function, in the order of the inputs and, within each, in CasADi's (column-major) order. The arrays
    of inputs and outputs must not overlap.
    """

    name: str
    rows_in: int
    rows_out: int
    width: int
    """Number W of instances that are computed together."""
    address: int
    """Address of the C function (`emit`), valid until the process ends."""

    def lanes(self, count: int) -> int:
        """Return the number of columns for `count` instances, which is rounded up to a multiple of W."""
        return -(-count // self.width) * self.width

    def allocate(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return zeros for the inputs, shape (rows_in, lanes(count)), and outputs, shape (rows_out, lanes(count))."""
        return np.zeros((self.rows_in, self.lanes(count))), np.zeros((self.rows_out, self.lanes(count)))


LONG_COMPILATION = 20_000
"""Number of instructions of a function whose compilation is announced; it takes about a second."""
_LOCK = threading.Lock()
_LOADED: dict[str, tuple[int, object]] = {}
"""Address and owner of every kernel. They are never freed, since compiled code may use the address."""


def compile_kernel(
    function: casadi.Function,
    *,
    folder: Path | None = None,
    host: native.Host | None = None,
    padded: bool = False,
    exact: bool = False,
) -> Kernel:
    """Return a kernel that evaluates `function` for many instances at once.

    Parameters
    ----------
    function : casadi.Function
        An SX function. Only the nonzero entries of sparse inputs and outputs count.
    folder : Path, optional
        Folder of the cache on disk. The default is `worm3d.machine.cache.folder("kernels")`. The folder need not exist
        or be writable.
    host : Host, optional
        Processor to compile for. The default is the processor of this computer.
    padded : bool
        Whether the lanes after the last instance contain numbers that can be computed without harm. The kernel then
        treats these lanes like all other lanes.
    exact : bool
        Whether the function is computed as written, with the functions of the C library. All bits then equal the
        results of NumPy and Numba.

    Raises
    ------
    UnsupportedError
        If `function` is not an SX function, has free variables, or has an operation without native form.
    """
    require_sx(function)
    host, folder = host or native.this_host(), folder or cache.folder("kernels")
    key = native.cache_key(function, host, padded, exact)

    def compiled() -> tuple[bytes, bool]:
        if function.n_instructions() > LONG_COMPILATION:
            sys.stderr.write(f"worm3d: compiling {function.name()!r}, once, for some seconds\n")
        return native.compile_function(function, host, padded, exact), True

    with _LOCK:
        if key not in _LOADED:
            _LOADED[key] = native.load(cache.load_or_make(folder, key, compiled), host)
    return Kernel(function.name(), function.nnz_in(), function.nnz_out(), host.width, _LOADED[key][0])
