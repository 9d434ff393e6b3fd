"""Numba's compiler with a cache of its own: functions are kept under a digest of all sources they are made of.

Any change makes them other functions. Where nothing can be written nothing is kept.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from worm3d.machine import cache
from worm3d.machine.functions import FOLDER, Function, _dispatcher
from worm3d.machine.later import later

F = TypeVar("F", bound=Callable[..., Any])

COMPILED = {"worm3d": ("machine", "physics", "solver", "worlds", "recorded/energy.py"), "planar": (".",)}
"""Folders and files, by package, of the modules that a compiled function of the package is made of."""

OPTIMISATION = 1
"""Numba's optimisation level for C functions; a higher one compiles a quarter longer and makes no step faster."""


def njit(function: F) -> F:
    """Compile a function by Numba, without Python objects and their lock, and keep the result on disk."""
    return cast(F, Function(function, _version_of(function), OPTIMISATION, lambda: None))


def inner(function: F) -> F:
    """Let compiled code call a function; it is compiled with its caller."""
    return cast(F, later(function, functools.partial(_dispatcher, function)))


def cfunc(
    function: Callable[..., Any], optimisation: int = OPTIMISATION, missed: Callable[[], None] = lambda: None
) -> Function:
    """Return a function as a C function with an `address`, of numbers as in its annotations, kept on disk.

    `missed` is called before the function is compiled because it is not on disk.
    """
    return Function(function, _version_of(function), optimisation, missed)


@functools.cache
def announce() -> None:
    """Say on stderr, once, that the solver is compiled, for half a minute."""
    from worm3d.machine import packed  # imports what unpacks

    folder = cache.folder(FOLDER)
    why = cache.obstacle(folder)
    if why is None:
        sys.stderr.write(f"worm3d: compiling, once, for about half a minute (kept in {folder}){packed.reason()}\n")
    else:
        sys.stderr.write(f"worm3d: compiling, for about half a minute, every time: {why}{packed.reason()}\n")
    sys.stderr.flush()


def _version_of(function: Callable[..., Any]) -> Callable[[], str]:
    package = function.__module__.partition(".")[0]
    return functools.partial(version, package if package in COMPILED else "worm3d")  # others call worm3d's functions


@functools.cache
def version(package: str = "worm3d") -> str:
    """Return a digest of all that compiled functions of a package are made of, besides their own file."""
    root = Path(__file__).parents[2] / package
    parts = [root / name for name in COMPILED[package]]
    sources = sorted(path for part in parts for path in (part.rglob("*.py") if part.is_dir() else [part]))
    known = (each for path in sources for each in (str(path.relative_to(root)).encode(), path.read_bytes()))
    return hashlib.sha256(b"\0".join(known)).hexdigest()
