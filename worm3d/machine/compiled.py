"""Numba's compiler with a cache of its own: functions are kept under a digest of all sources they are made of.

Any change makes them other functions (`worm3d.machine.cache.functions`). Where nothing can be written nothing is kept.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.ccallback import CFunc
from numba.core.sigutils import normalize_signature

from worm3d.machine import cache
from worm3d.machine.cache.functions import FOLDER, keep, sources_digest

_typed: Any = normalize_signature
F = TypeVar("F", bound=Callable[..., Any])

COMPILED = {"worm3d": ("machine", "physics", "solver", "worlds", "energy.py"), "planar": (".",)}
"""Folders and files, by package, of the modules that a compiled function of the package is made of."""

OPTIMISATION = 1
"""Numba's optimisation level for C functions; a higher one compiles a quarter longer and makes no step faster."""


def njit(function: F) -> F:
    """Compile a function by Numba, without Python objects and their lock, and keep the result on disk."""
    return cast(F, keep(numba.njit(error_model="numpy", nogil=True)(function), _version_of(function)))


def kept(function: F) -> F:
    """Compile a function by Numba as it comes, and keep the result on disk."""
    return cast(F, keep(numba.njit(function), _version_of(function)))


def inner(function: F) -> F:
    """Compile a function that only compiled code calls: without what Python needs to call it; kept with its caller."""
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return cast(F, numba.njit(error_model="numpy", nogil=True, **options)(function))


def cfunc(
    signature: str,
    function: Callable[..., Any],
    optimisation: int = OPTIMISATION,
    missed: Callable[[], None] = lambda: None,
) -> Any:
    """Compile a function as a C function with an `address`, and keep the result on disk.

    `missed` is called before the function is compiled because it is not on disk.
    """
    # numba.cfunc, which compiles at once, lets nobody choose the cache.
    compiled = keep(CFunc(function, _typed(signature), locals={}, options={}), _version_of(function), missed)
    before, numba.config.OPT = numba.config.OPT, optimisation  # type: ignore[attr-defined]
    try:
        compiled.compile()
    finally:
        numba.config.OPT = before  # type: ignore[attr-defined]
    return compiled


@functools.cache
def announce() -> None:
    """Say on stderr, once, that the solver is compiled, for half a minute."""
    folder = cache.folder(FOLDER)
    why = cache.obstacle(folder)
    if why is None:
        sys.stderr.write(f"worm3d: compiling, once, for about half a minute (kept in {folder})\n")
    else:
        sys.stderr.write(f"worm3d: compiling, for about half a minute, every time: {why}\n")
    sys.stderr.flush()


def _version_of(function: Callable[..., Any]) -> Callable[[], str]:
    package = function.__module__.partition(".")[0]
    return functools.partial(version, package if package in COMPILED else "worm3d")  # others call worm3d's functions


@functools.cache
def version(package: str = "worm3d") -> str:
    """Return a digest of all that compiled functions of a package are made of, besides their own file."""
    root = Path(__file__).parents[2] / package
    parts = [root / name for name in COMPILED[package]]
    return sources_digest(root, [path for part in parts for path in (part.rglob("*.py") if part.is_dir() else [part])])
