"""Compiled functions: made of a translation by LLVM, kept on disk, called from Python or by their address."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import inspect
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import llvmlite
import llvmlite.binding as llvm
import numpy as np

from worm3d.machine import cache
from worm3d.machine.codegen import native
from worm3d.machine.codegen.call import bind, require_accepted

FOLDER = "compiled"
"""Folder of compiled functions in the cache."""
_C = {float: ctypes.c_double, int: ctypes.c_int64, bool: ctypes.c_int64, type(None): None}
_LOCK = threading.RLock()


class Compiled:
    """A function that is compiled when it is first called, once for each structure of its arguments.

    From Python it takes numbers, C-contiguous arrays and tuples of them, and returns numbers, or a tuple of some, as
    its annotation says.

    Parameters
    ----------
    function : function
        In the part of Python that `worm3d.machine.language.translate` knows.
    version : callable
        Returns a digest of what the function is made of besides its own file.
    level : int
        Optimisation level of LLVM.
    missed : callable
        Called before the function is compiled because it is not on disk.
    """

    def __init__(
        self, function: Callable[..., Any], version: Callable[[], str], level: int, missed: Callable[[], None]
    ) -> None:
        functools.update_wrapper(self, function)
        self._function, self._version, self._level, self._missed = function, version, level, missed
        self._known: dict[Any, Callable[..., Any]] = {}
        self._owners: list[object] = []

    def __call__(self, *args: Any) -> Any:
        """Call the function."""
        key = tuple(map(_structure, args))
        call = self._known.get(key)
        if call is None:
            call = self._known[key] = self._prepared(args)
        found = call(args)
        require_accepted()
        return found

    @functools.cached_property
    def address(self) -> int:
        """Address of the C function that takes and returns the numbers of the annotation."""
        hints = get_type_hints(self._function)
        names = inspect.signature(self._function).parameters
        return self._built([hints[name](0) for name in names])

    def _built(self, args: Any) -> int:
        """Return the address of the function for such arguments."""
        with _LOCK:
            folder, host = cache.folder(FOLDER), native.this_host()
            key = self._name(args, host)
            code = cache.load(folder, key)
            if code is None:
                with cache.alone(folder, key):
                    code = cache.load(folder, key)  # what another process has compiled meanwhile
                    if code is None:
                        self._missed()
                        code = self._code(args, host)
                        cache.store(folder, key, code)
            bind()
            address, owner = native.load(code, host)
            self._owners.append(owner)
            return address

    def _name(self, args: Any, host: native.Host) -> str:
        """Return the key of compiled code in the cache."""
        function = self._function
        own = Path(inspect.getfile(function)).read_bytes()
        parts: list[Any] = [self._version(), function.__module__, function.__qualname__, [*map(_structure, args)], host]
        parts += [self._level, llvmlite.__version__, llvm.get_process_triple(), hashlib.sha256(own).hexdigest()]
        return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()

    def _code(self, args: Any, host: native.Host) -> bytes:
        """Return the object code of the function for such arguments."""
        from worm3d.machine.language.module import module_of  # what only compiling needs

        return native.compile_text(module_of(self._function, args), host, self._level)

    def _prepared(self, args: Any) -> Callable[..., Any]:
        """Return what calls the function with arguments of this structure."""
        result = get_type_hints(self._function).get("return", type(None))
        parts, address = get_args(result), self._built(args)
        kinds = [_kind(each) for each in args for each in _numbers(each)]
        if not parts:
            function = ctypes.CFUNCTYPE(_C[result], *kinds)(address)
            of = bool if result is bool else lambda value: value
            return lambda args: of(function(*(each for arg in args for each in _numbers(arg))))
        several = ctypes.CFUNCTYPE(None, *kinds, ctypes.c_void_p)(address)

        def call(args: Any) -> Any:
            found = np.zeros(len(parts))
            several(*(each for arg in args for each in _numbers(arg)), found.ctypes.data)
            whole = found.view(np.int64)
            return tuple(part((found if part is float else whole)[k]) for k, part in enumerate(parts))

        return call


def _structure(value: Any) -> Any:
    """Return what values of the same structure have in common."""
    if isinstance(value, np.ndarray):
        return value.dtype.name, value.ndim
    if isinstance(value, tuple):
        return type(value).__qualname__, *map(_structure, value)
    return type(value).__name__


def _numbers(value: Any) -> Iterator[Any]:
    """Yield the numbers that are handed over for an argument."""
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError("an array must be C-contiguous")
        yield value.ctypes.data
        yield from value.shape
    elif isinstance(value, tuple):
        for each in value:
            yield from _numbers(each)
    else:
        yield value


def _kind(value: Any) -> Any:
    return ctypes.c_double if isinstance(value, float) else ctypes.c_int64
