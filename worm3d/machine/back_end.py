"""The part of compilation that needs Numba: the object code of a function, and a C wrapper of the function.

The C wrapper has the name `SYMBOL`. With a result type, the wrapper takes the numbers of the function's arguments and
returns a number of this type. Without a result type, the wrapper takes two addresses, of the results and of the numbers
of the arguments. Each number has 8 bytes. An array is represented by its address and its sizes. The wrapper then
returns 0, or another value if the function has raised an error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import types
from numba.core.registry import cpu_target

from worm3d.machine import vectors
from worm3d.machine.codegen import native
from worm3d.machine.codegen.emit import SYMBOL
from worm3d.machine.later import ready

_POINTERS = {"float64": "doubles_at", "int64": "integers_at", "float32": "singles_at", "int32": "indices_at"}


def dispatcher(function: Callable[..., Any]) -> Any:
    """Return Numba's dispatcher of a function. It makes no wrappers for calls from Python."""
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(error_model="numpy", nogil=True, **options)(function)


def objects_of(
    function: Callable[..., Any], args: Any, level: int, result: Any, host: native.Host
) -> tuple[bytes, bytes, set[str]]:
    """Return the object code of a function for arguments like `args`, the object code of its C wrapper, and names.

    The names are the functions that Numba's code calls and that neither object defines.
    """
    _aim_at(host)
    ready()
    kinds = [types.float64 if isinstance(each, float) else types.int64 for arg in args for each in _places(arg)]
    signature = tuple(kinds)
    before, numba.config.OPT = numba.config.OPT, level  # type: ignore[attr-defined]
    try:
        compiled = dispatcher(_shim(function, args))
        compiled.compile(signature)
    finally:
        numba.config.OPT = before  # type: ignore[attr-defined]
    made = compiled.overloads[signature]
    around = _around(made.fndesc.mangled_name, kinds, result)
    named = _declared(made.library._final_module) - _declared(llvm.parse_assembly(around), declared=False)
    return made.library._get_compiled_object(), native.compile_text(around, host), named


def _declared(module: Any, declared: bool = True) -> set[str]:
    """Return the names of the functions that a module declares, or, if `declared` is False, defines."""
    names = {each.name for each in module.functions if bool(each.is_declaration) is declared}
    return {name for name in names if not name.startswith("llvm.")}


def _aim_at(host: native.Host) -> None:
    """Make Numba compile for `host` if it is one of the named kinds of processors.

    Numba reads this setting only when it is used first.

    Raises
    ------
    RuntimeError
        Numba has already been used for another processor.
    """
    if host.cpu not in native.PROCESSOR_VECTORS:
        return
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = host.cpu, host.features  # type: ignore[attr-defined]
    aim = cpu_target.target_context.codegen().magic_tuple()[1]
    if aim != host.cpu:
        raise RuntimeError(
            f"{native.SWITCH} asks for {host.cpu}, but Numba compiles for {aim} in this process: "
            f"import worm3d before Numba compiles anything, or set NUMBA_CPU_NAME to {host.cpu} too"
        )


def _places(arg: Any) -> Iterator[Any]:
    if isinstance(arg, np.ndarray):
        yield from [0] * (1 + arg.ndim)
    elif isinstance(arg, tuple):
        for each in arg:
            yield from _places(each)
    else:
        yield arg


def _shim(function: Callable[..., Any], args: Any) -> Callable[..., Any]:
    """Return a function whose arguments are the single numbers of which the arguments in `args` consist."""
    known: dict[str, Any] = {"function": function, "carray": numba.carray}  # type: ignore[attr-defined]
    count = 0

    def name() -> str:
        nonlocal count
        count += 1
        return f"x{count - 1}"

    def written(arg: Any) -> str:
        if isinstance(arg, np.ndarray):
            at = _POINTERS[arg.dtype.name]
            known[at] = getattr(vectors, at)
            return f"carray({at}({name()}), ({', '.join(name() for _ in arg.shape)},))"
        if isinstance(arg, tuple):
            of = f"C{len(known)}"
            known[of] = type(arg)
            inside = "".join(f"{written(each)}, " for each in arg)
            return f"{of}({inside})" if hasattr(arg, "_fields") else f"({inside})"
        return f"({name()} != 0)" if isinstance(arg, bool | np.bool_) else name()

    call = f"function({', '.join(map(written, args))})"
    exec(f"def shim({', '.join(f'x{k}' for k in range(count))}):\n    return {call}", known)
    shim: Callable[..., Any] = known["shim"]
    return shim


def _around(name: str, kinds: list[Any], result: Any) -> str:
    """Return the LLVM module of the C wrapper, with the memory functions that Numba's code calls."""
    values = [f"{'double' if kind == types.float64 else 'i64'} %x{k}" for k, kind in enumerate(kinds)]
    declared = ", ".join(["ptr", "ptr", *(value.split()[0] for value in values)])
    call = f'%s = call i32 @"{name}"({", ".join(["ptr %r", "ptr %e", *values])})'
    if result is None:
        head, body = f"i32 @{SYMBOL}(ptr %r, ptr %n)", []
        for k, value in enumerate(values):
            body += [f"%p{k} = getelementptr i64, ptr %n, i64 {k}", f"%x{k} = load {value.split()[0]}, ptr %p{k}"]
        body += [call, "ret i32 %s"]
    else:
        kind = "double" if result is float else "i64"
        head = f"{kind} @{SYMBOL}({', '.join(values)})"
        body = [f"%r = alloca {kind}", call, f"%v = load {kind}, ptr %r", f"ret {kind} %v"]
    return "\n".join(
        [_MEMORY, f'declare i32 @"{name}"({declared})', f"define {head} {{", "%e = alloca ptr", *body, "}"]
    )


_MEMORY = """
declare ptr @malloc(i64)
declare ptr @realloc(ptr, i64)
declare void @free(ptr)
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %whole = add i64 %size, 128
  %info = call ptr @malloc(i64 %whole)
  %begin = ptrtoint ptr %info to i64
  %behind = add i64 %begin, 127
  %aligned = and i64 %behind, -64
  %place = getelementptr i64, ptr %info, i64 3
  %length = getelementptr i64, ptr %info, i64 4
  store i64 1, ptr %info
  store i64 %aligned, ptr %place
  store i64 %size, ptr %length
  ret ptr %info
}
define ptr @NRT_MemInfo_alloc(i64 %size) {
  %info = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 64)
  ret ptr %info
}
define ptr @NRT_MemInfo_new_varsize_dtor(i64 %size, ptr %dtor) {
  %info = call ptr @NRT_MemInfo_alloc_aligned(i64 0, i32 64)
  %data = call ptr @malloc(i64 %size)
  %place = getelementptr i64, ptr %info, i64 3
  store ptr %data, ptr %place
  ret ptr %info
}
define ptr @NRT_MemInfo_varsize_realloc(ptr %info, i64 %size) {
  %place = getelementptr i64, ptr %info, i64 3
  %before = load ptr, ptr %place
  %data = call ptr @realloc(ptr %before, i64 %size)
  store ptr %data, ptr %place
  ret ptr %data
}
define ptr @NRT_Allocate(i64 %size) {
  %data = call ptr @malloc(i64 %size)
  ret ptr %data
}
define void @NRT_Free(ptr %data) {
  call void @free(ptr %data)
  ret void
}
define void @NRT_MemInfo_call_dtor(ptr %info) {
  call void @free(ptr %info)
  ret void
}
"""
"""Numba's memory functions, so that code runs without Numba. In the record of an allocation, the reference count comes
first, and the address and size of the data are the fields 3 and 4. Memory of lists, which only error messages use, is
never freed. All names are defined here, since a missing function would be called at address 0."""
