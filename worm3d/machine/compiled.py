"""Numba's compiler with a cache of its own. Compiled functions are stored under a digest of all their sources.

Any change of a source gives a new digest. If the cache cannot be written, nothing is stored.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from worm3d.machine import cache
from worm3d.machine.functions import FUNCTION_FOLDER, Function, _dispatcher
from worm3d.machine.later import later

F = TypeVar("F", bound=Callable[..., Any])

COMPILED = {"worm3d": ("machine", "physics", "solver", "worlds", "recorded/energy.py"), "planar": (".",)}
"""Source modules of the compiled functions of each package: folders and files relative to the package."""


def njit(function: F) -> F:
    """Compile a function by Numba without Python objects and without the interpreter lock; store the result on disk."""
    return cast(F, cfunc(function))


def inner(function: F) -> F:
    """Make a function callable from compiled code. The function is compiled together with each caller."""
    return cast(F, later(function, functools.partial(_dispatcher, function)))


def cfunc(function: Callable[..., Any], optimisation: int = 1, missed: Callable[[], None] = lambda: None) -> Function:
    """Return a C function with an `address`, for arguments of the annotated types, which is stored on disk.

    `missed` is called before a compilation, if the compiled function is not on disk. With an `optimisation` above 1,
    compiling the solver takes a quarter longer, and steps do not become faster.
    """
    return Function(function, _version_of(function), optimisation, missed)


@functools.cache
def announce() -> None:
    """Print on stderr, once, that compiling the solver takes half a minute."""
    from worm3d.machine import packed  # imports modules that unpack

    folder = cache.folder(FUNCTION_FOLDER)
    why = cache.obstacle(folder)
    when = (
        f"once, for about half a minute (kept in {folder})" if why is None else f"every time for half a minute: {why}"
    )
    sys.stderr.write(f"worm3d: compiling, {when}{packed.reason()}\n")
    sys.stderr.flush()


def _version_of(function: Callable[..., Any]) -> Callable[[], str]:
    package = function.__module__.partition(".")[0]
    return functools.partial(version, package if package in COMPILED else "worm3d")  # others call worm3d's functions


@functools.cache
def version(package: str = "worm3d") -> str:
    """Return a digest of all sources of a package's compiled functions, without files outside the package."""
    root = Path(__file__).parents[2] / package
    parts = [root / name for name in COMPILED[package]]
    sources = sorted(path for part in parts for path in (part.rglob("*.py") if part.is_dir() else [part]))
    known = (each for path in sources for each in (str(path.relative_to(root)).encode(), path.read_bytes()))
    return hashlib.sha256(b"\0".join(known)).hexdigest()
