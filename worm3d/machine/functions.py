"""Functions that Numba compiles, stored on disk as object code, which later processes call without Numba."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import inspect
import os
import struct
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import llvmlite
import llvmlite.binding as llvm
import numpy as np

from worm3d.machine import cache
from worm3d.machine.codegen import native
from worm3d.machine.codegen.call import REFUSED
from worm3d.machine.later import later
from worm3d.machine.writer import BYTES

Objects = tuple[bytes, bytes]
"""Object code of a function, and object code of a C wrapper that calls the function."""
FUNCTION_FOLDER = "compiled"
"""Name of the folder of compiled functions in the cache."""
_LOCK = threading.RLock()


class Function:
    """A function that is compiled on the first call, once for each structure of the arguments.

    Python calls the function with numbers, C-contiguous arrays, and tuples of both. The function returns a number or a
    tuple of numbers, according to its annotation.

    Parameters
    ----------
    function : function
        The Python function.
    version : callable
        Returns a digest of the sources on which the function depends, other than its own file.
    level : int
        Numba's optimisation level.
    missed : callable
        Called before a compilation, if the compiled function is not on disk.
    """

    def __init__(
        self, function: Callable[..., Any], version: Callable[[], str], level: int, missed: Callable[[], None]
    ) -> None:
        functools.update_wrapper(self, function)
        self._function, self._version, self._level, self._missed = function, version, level, missed
        self._known: dict[Any, Callable[..., Any]] = {}
        self._tuples: dict[int, tuple[Any, Any, bytes]] = {}
        self._owners: list[object] = []
        later(self, functools.partial(_dispatcher, function))

    def __call__(self, *args: Any) -> Any:
        """Call the function."""
        given = [self._given(place, arg) for place, arg in enumerate(args)]
        key = tuple([structure for _, structure, _ in given])
        call = self._known.get(key)
        if call is None:
            call = self._known[key] = self._prepared(args)
        return call(b"".join([numbers for _, _, numbers in given]))

    def _given(self, place: int, arg: Any) -> tuple[Any, Any, bytes]:
        """Return an argument, its structure and its numbers. Results for tuples are stored, since calls repeat them."""
        known = self._tuples.get(place)
        if known is None or known[0] is not arg:
            known = arg, *_read(arg)
            if isinstance(arg, tuple):
                self._tuples[place] = known
        return known

    @functools.cached_property
    def address(self) -> int:
        """Address of the C function, with the annotated types of arguments and result."""
        hints = get_type_hints(self._function)
        return self._built([hints[name](0) for name in inspect.signature(self._function).parameters], hints["return"])

    def _built(self, args: Any, result: Any = None) -> int:
        """Return the address of the function for such arguments (`worm3d.machine.back_end`)."""
        with _LOCK:
            folder, host = cache.folder(FUNCTION_FOLDER), native.this_host()
            key = self.key(args, result, host)
            code = cache.load_or_make(folder, key, lambda: self._made(args, result, host))
            end = BYTES + int.from_bytes(code[:BYTES], "little")
            address, owner = native.load(code[end:], host, code[BYTES:end])
            self._owners.append(owner)
            return address

    def _made(self, args: Any, result: Any, host: native.Host) -> tuple[bytes, bool]:
        """Return both objects, joined, and whether they may be stored on disk."""
        found = self._packed(args, result, host)
        if found is not None:
            return found, True
        self._missed()
        objects, lacking = self.compiled(args, result, host)
        if lacking:
            self._tell(lacking)
        return joined(objects), not lacking

    def _packed(self, args: Any, result: Any, host: native.Host) -> bytes | None:
        """Return the joined objects that the package contains for such a processor and the same sources, or None."""
        if os.environ.get(native.SWITCH):
            return None
        from worm3d.machine import packed  # imports modules that unpack

        kind = packed.kind_of(host)
        return None if kind is None else packed.load(self.key(args, result, kind), kind)

    def compiled(self, args: Any, result: Any, host: native.Host) -> tuple[Objects, tuple[str, ...]]:
        """Return the two objects, and the names that they need and that a fresh process lacks.

        When Numba compiles, it registers names of its own, such as `numba_attempt_nocopy_reshape`. A process that reads
        the code from disk never imports Numba, and would call address 0 for such a name.
        """
        from worm3d.machine.back_end import objects_of  # imports Numba

        function, around, named = objects_of(self, args, self._level, result, host)
        return (function, around), tuple(sorted(name for name in named if not hasattr(native.c_library(), name)))

    def _tell(self, lacking: tuple[str, ...]) -> None:
        sys.stderr.write(
            f"worm3d: {self._function.__module__}.{self._function.__qualname__} is compiled in every process: its code "
            f"cannot be kept, for it calls {', '.join(lacking)}, which only a compiling Numba has; .ravel(), "
            ".reshape() and np.dot make such calls, loops over the axes of arrays do not\n"
        )
        sys.stderr.flush()

    def key(self, args: Any, result: Any, host: native.Host) -> str:
        """Return the key of the object code in the cache.

        The key contains the version of llvmlite, which determines the version of Numba.
        """
        function = self._function
        own = hashlib.sha256(Path(inspect.getfile(function)).read_bytes()).hexdigest()
        parts: list[Any] = [self._version(), own, function.__module__, function.__qualname__, self._level, host]
        parts += [[_read(arg)[0] for arg in args], result, llvm.get_process_triple(), llvmlite.__version__]
        return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()

    def _prepared(self, args: Any) -> Callable[..., Any]:
        """Return a callable that calls the function with arguments of this structure."""
        result = get_type_hints(self._function).get("return", type(None))
        parts = get_args(result) or ((result,) if result is not type(None) else ())
        function = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_char_p)(self._built(args))

        def call(numbers: bytes) -> Any:
            found = (ctypes.c_int64 * max(len(parts), 1))()
            if function(ctypes.addressof(found), numbers) != 0:
                raise ValueError(REFUSED)
            values = [_OF[part].from_buffer(found, 8 * k).value for k, part in enumerate(parts)]
            return values[0] if len(values) == 1 else tuple(values) if values else None

        return call


_OF: dict[Any, Any] = {float: ctypes.c_double, int: ctypes.c_int64, bool: ctypes.c_bool}


def joined(objects: Objects) -> bytes:
    """Return two objects in the form stored on disk: the length of the first object, then both objects."""
    return len(objects[0]).to_bytes(BYTES, "little") + b"".join(objects)


def _dispatcher(function: Callable[..., Any]) -> Any:
    from worm3d.machine.back_end import dispatcher

    return dispatcher(function)


def _read(value: Any) -> tuple[Any, bytes]:
    """Return a key that is equal for all values of the same structure, and the numbers that represent this value.

    Each number has 8 bytes. An array is represented by its address and its sizes.
    """
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError("an array must be C-contiguous")
        return (value.dtype.str, value.ndim), _PACKS[value.ndim](value.ctypes.data, *value.shape)
    if isinstance(value, tuple):
        parts = [_read(each) for each in value]
        return (type(value).__qualname__, *(each for each, _ in parts)), b"".join([numbers for _, numbers in parts])
    if isinstance(value, float):
        return float, _DOUBLE(value)
    return bool if isinstance(value, bool | np.bool_) else int, _PACKS[0](int(value))


_PACKS = [struct.Struct(f"{1 + ndim}q").pack for ndim in range(8)]
_DOUBLE = struct.Struct("d").pack
