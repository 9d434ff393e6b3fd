"""LLVM: the vectors of this computer's processor, object code of a function, and the address of loaded object code."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import sys
from pathlib import Path
from typing import Any, NamedTuple

import casadi
import llvmlite
import llvmlite.binding as llvm

from worm3d.machine.codegen.emit import FLAGS, SYMBOL, module
from worm3d.machine.codegen.lanes import LIBRARY


class Host(NamedTuple):
    """A processor: the name and features that LLVM uses, and the vectors that suit it."""

    cpu: str
    features: str
    width: int
    """Doubles in a vector: 8 with AVX-512, 4 with AVX2, 2 otherwise."""
    fused: bool
    """Whether the processor has fused multiply-add."""


_V2 = ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3")
_V3 = (*_V2, "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
FEATURES = {"x86-64-v4": (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"), "x86-64-v3": _V3}
FEATURES["x86-64-v2"] = _V2
"""Features of each kind of processor, the best kind first."""
PROCESSOR_VECTORS = {"x86-64-v4": (8, True), "x86-64-v3": (4, True), "x86-64-v2": (2, False)}
"""Vectors of each kind of processor: `width` and `fused` of `Host`."""
SWITCH = "WORM3D_COMPILE_FOR"
"""Environment variable with the kind of processor to compile for, or "host" for this processor. If it is set, the
object code in the package is not used."""


def kind(name: str) -> Host:
    """Return the kind of processor with this name, as a target for compilation."""
    return Host(name, "", *PROCESSOR_VECTORS[name])


@functools.cache
def this_host() -> Host:
    """Return the processor of this computer, or the kind that `SWITCH` names.

    Raises
    ------
    ValueError
        The variable contains no kind of processor, or a kind whose code this processor cannot run.
    """
    features = llvm.get_host_cpu_features()
    asked = os.environ.get(SWITCH, "host") or "host"
    able = [name for name, needed in FEATURES.items() if all(map(features.get, needed))]
    if asked in able:
        return kind(asked)
    if asked != "host":
        raise ValueError(f"{SWITCH} is {asked!r}, on this processor it must be one of {', '.join(['host', *able])}")
    width = 8 if features.get("avx512f") else 4 if features.get("avx2") else 2
    arm = llvm.get_process_triple().startswith(("aarch64", "arm64"))
    return Host(llvm.get_host_cpu_name(), features.flatten(), width, arm or bool(features.get("fma")))


def cache_key(function: casadi.Function, host: Host, padded: bool = False, exact: bool = False) -> str:
    """Return a digest of everything that affects the object code: function, generator, libraries, processor."""
    parts = (
        function.serialize(),
        _generator(),
        casadi.CasadiMeta.version(),
        llvmlite.__version__,
        llvm.get_process_triple(),
        *map(repr, host),
        repr((padded, exact)),
    )
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@functools.cache
def _generator() -> str:
    """Return a digest of the sources of this package, which serves as a version number."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in sources)).hexdigest()


def compile_function(function: casadi.Function, host: Host, padded: bool = False, exact: bool = False) -> bytes:
    """Return the object code of a function.

    The text has no repeated subexpression (`Writer`), and is one long block, so that little is left to optimise. Only
    neighbouring instructions are combined. LLVM's optimisation pipelines would gain 2 to 5 % for 50 % more compile
    time. Raises UnsupportedError for an operation that has no native form, and RuntimeError if LLVM fails.
    """
    return compile_text(module(function, host.width, host.fused and not exact, () if exact else FLAGS, padded), host)


def compile_text(text: str, host: Host) -> bytes:
    """Return the object code of a module in LLVM's language."""
    machine, unit = _machine(host), llvm.parse_assembly(text)
    unit.triple, unit.data_layout = machine.triple, str(machine.target_data)
    unit.verify()
    passes = llvm.create_new_module_pass_manager()
    passes.add_instruction_combine_pass()
    passes.run(unit, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    code: bytes = machine.emit_object(unit)
    return code


def load(code: bytes, host: Host, more: bytes = b"") -> tuple[int, object]:
    """Return the address of the kernel in object code, and an owner that must exist as long as the address is used.

    `more` is object code that the kernel calls.
    """
    _bind_library()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine(host))
    for each in (code, more):
        if each:
            engine.add_object_file(llvm.ObjectFileRef.from_data(each))
    engine.finalize_object()
    return engine.get_function_address(SYMBOL), engine


def _machine(host: Host) -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=host.cpu, features=host.features, opt=2, codemodel="jitdefault", jit=True)


@functools.cache
def c_library() -> Any:
    """Return the C library. On Linux and macOS it also contains all other names of a fresh process."""
    return ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)


@functools.cache
def _bind_library() -> None:
    """Give LLVM the addresses of C functions that it does not find itself, since LLVM aborts at unknown functions."""
    for name in LIBRARY:
        if not llvm.address_of_symbol(name):
            llvm.add_symbol(name, ctypes.cast(getattr(c_library(), name), ctypes.c_void_p).value)
