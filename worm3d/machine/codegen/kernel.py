"""Kernels: CasADi functions compiled for many instances at once; the user's side of `worm3d.machine.codegen`."""

from __future__ import annotations

import enum
import sys
import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import casadi
import numpy as np

from worm3d.machine import cache
from worm3d.machine.codegen import casadi_vm, native, program
from worm3d.machine.codegen.emit import SHAPES_FIT
from worm3d.values.arrays import FloatArray

KERNEL_FOLDER = "kernels"
"""Folder of kernels in the cache."""

Backend = Literal["llvm", "casadi"]
ALIGNMENT = 64
"""Size of a cache line, and of the widest vector [byte]."""
SECONDS_PER_INSTRUCTION = 5e-5
"""Time to compile an instruction, measured with functions of 8,000 to 34,000 instructions [s]."""
SILENT_COMPILE_TIME = 1.0
"""Longest expected compile time without an announcement [s]."""


class FallbackWarning(RuntimeWarning):
    """A kernel could not be compiled and runs on CasADi's virtual machine, about 200 times slower."""


class Origin(enum.Enum):
    """Source of the code of a kernel."""

    COMPILED = "compiled in this process"
    DISK = "read from the cache on disk"
    MEMORY = "made earlier in this process"
    VIRTUAL_MACHINE = "none: CasADi's virtual machine evaluates it"


@dataclass(frozen=True)
class Kernel:
    """A CasADi function y = f(x), evaluated for many instances at once.

    Inputs and outputs are stored as rows: row r of `inputs` is the r-th nonzero of all inputs of the function, one
    input after the other in CasADi's (column-major) order, and column k is instance k. The two arrays must not overlap.
    """

    name: str
    rows_in: int
    rows_out: int
    width: int
    """Instances computed together, W."""
    backend: Backend
    origin: Origin
    address: int
    """Address of the C function (`emit`), for `evaluate` in compiled code; valid until the process ends."""
    _call: Callable[..., int] = field(repr=False, compare=False)

    def lanes(self, count: int) -> int:
        """Return the number of columns for `count` instances: a multiple of W."""
        return -(-count // self.width) * self.width

    def allocate(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return zero inputs, shape (rows_in, lanes(count)), and outputs, (rows_out, ...), aligned to cache lines."""
        return _aligned(self.rows_in, self.lanes(count)), _aligned(self.rows_out, self.lanes(count))

    def __call__(self, inputs: FloatArray, outputs: FloatArray, count: int) -> None:
        """Evaluate `count` instances.

        Parameters
        ----------
        inputs : ndarray, shape (rows_in, lanes(count) or more), C-contiguous
        outputs : ndarray, shape (rows_out, lanes(count) or more), C-contiguous
            Columns from `count` to `lanes(count)` may be overwritten.
        count : int
            Number of instances.

        Raises
        ------
        ValueError
            If an array has the wrong kind or shape.
        """
        for label, array, rows in (("inputs", inputs, self.rows_in), ("outputs", outputs, self.rows_out)):
            self._check(label, array, rows, count)
        if not outputs.flags.writeable:
            raise ValueError(f"kernel {self.name!r}: outputs are read-only; pass a writeable array")
        status = self._call(inputs.ctypes.data, *inputs.shape, outputs.ctypes.data, *outputs.shape, int(count))
        if status != SHAPES_FIT:
            raise ValueError(f"kernel {self.name!r}: CasADi's virtual machine failed; check the function by calling it")

    def _check(self, label: str, array: FloatArray, rows: int, count: int) -> None:
        allowed = f"float64, C-contiguous, ({rows}, {self.lanes(max(count, 0))} or more)"
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.ndim != 2:
            got = f"{array.dtype}, {array.ndim} dimensions, {'' if array.flags.c_contiguous else 'not '}C-contiguous"
        elif array.shape[0] != rows or array.shape[1] < self.lanes(max(count, 0)):
            got = f"shape {array.shape}"
        elif count < 0:
            raise ValueError(f"kernel {self.name!r}: count is {count}, must be 0 or more")
        else:
            return
        raise ValueError(f"kernel {self.name!r}: {label} must be {allowed}, got {got}; allocate({count}) makes them")


def compile_kernel(
    function: casadi.Function,
    *,
    backend: Backend = "llvm",
    folder: Path | None = None,
    host: native.Host | None = None,
    notify: Callable[[str], None] | None = None,
    padded: bool = False,
    exact: bool = False,
) -> Kernel:
    """Return a kernel that evaluates `function` for many instances at once.

    Parameters
    ----------
    function : casadi.Function
        An SX function; sparse inputs and outputs count their nonzeros only.
    backend : {"llvm", "casadi"}
        Native code, or CasADi's virtual machine. If LLVM fails, the virtual machine steps in with a `FallbackWarning`.
    folder : Path, optional
        Folder of the cache on disk; default `worm3d.machine.cache.folder("kernels")`. The folder need not exist or be
        writeable.
    host : Host, optional
        Processor to compile for; default the processor of this computer.
    notify : callable, optional
        Receives one sentence before a long compilation; default: standard error.
    padded : bool
        Whether lanes beyond the last instance hold harmless numbers; these lanes are then computed like all other
        lanes.
    exact : bool
        Whether the function is computed as written, with the C library's functions, so that all bits equal the results
        of NumPy or Numba.

    Raises
    ------
    UnsupportedError
        If `function` is not an SX function, has free variables, or has an operation without native form.
    ValueError
        If the backend is unknown.
    """
    if backend not in ("llvm", "casadi"):
        raise ValueError(f"backend is {backend!r}, must be 'llvm' or 'casadi'")
    program.require_sx(function)
    if backend == "casadi":
        return _virtual(function)
    try:
        host, folder = host or native.this_host(), folder or cache.folder(KERNEL_FOLDER)
        code, origin, width = _native(function, folder, host, notify, (padded, exact))
    except program.UnsupportedError:
        raise
    except Exception as error:
        warnings.warn(
            f"kernel {function.name()!r} runs on CasADi's virtual machine, about 200 times slower: "
            f"LLVM failed with {error!r}",
            FallbackWarning,
            stacklevel=2,
        )
        return _virtual(function)
    return _kernel(function, width, "llvm", origin, code)


_LOCK = threading.Lock()
_LOADED: dict[str, tuple[int, object]] = {}
"""Address and owner of every native kernel; never freed, since compiled code may hold the address."""
_VIRTUAL: list[object] = []
"""Owners of the virtual machines; never freed, since compiled code may hold their addresses."""


def _native(
    function: casadi.Function,
    folder: Path | None,
    host: native.Host,
    notify: Callable[[str], None] | None,
    options: tuple[bool, bool],
) -> tuple[int, Origin, int]:
    key = native.cache_key(function, host, *options)
    with _LOCK:
        if key in _LOADED:
            return _LOADED[key][0], Origin.MEMORY, host.width
        code, origin = cache.load(folder, key), Origin.DISK
        if code is None:
            with cache.alone(folder, key):
                code = cache.load(folder, key)  # another process may have compiled it
                if code is None:
                    _announce(function, notify or _to_standard_error)
                    code, origin = native.compile_program(program.read(function), host, *options), Origin.COMPILED
                    cache.store(folder, key, code)
        _LOADED[key] = native.load(code, host)
        return _LOADED[key][0], origin, host.width


def _announce(function: casadi.Function, notify: Callable[[str], None]) -> None:
    count = function.n_instructions()
    seconds = count * SECONDS_PER_INSTRUCTION
    if seconds > SILENT_COMPILE_TIME:
        notify(f"Compiling {function.name()!r} ({count} instructions): about {seconds:.0f} s, this once.")


def _to_standard_error(message: str) -> None:
    sys.stderr.write(message + "\n")


def _virtual(function: casadi.Function) -> Kernel:
    address, owner = casadi_vm.evaluator(function)
    _VIRTUAL.append(owner)
    return _kernel(function, 1, "casadi", Origin.VIRTUAL_MACHINE, address)


def _kernel(function: casadi.Function, width: int, backend: Backend, origin: Origin, address: int) -> Kernel:
    call = casadi_vm.SIGNATURE(address)
    return Kernel(function.name(), function.nnz_in(), function.nnz_out(), width, backend, origin, address, call)


def _aligned(rows: int, lanes: int) -> FloatArray:
    """Return zeros that begin on a cache line, shape (rows, lanes)."""
    spare = ALIGNMENT // 8
    raw = np.zeros(rows * lanes + spare)
    first = -raw.ctypes.data % ALIGNMENT // 8
    return raw[first : first + rows * lanes].reshape(rows, lanes)
