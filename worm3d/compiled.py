"""Numba's compiler with a cache of its own: functions are kept under a digest of all sources they are made of.

Numba itself keeps a function until its own file changes, even if one that it calls has changed since: after an update
it would go on with the old one. Here any change begins a new folder. Where nothing can be written nothing is kept.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from worm3d.codegen.cache import default_folder

F = TypeVar("F", bound=Callable[..., Any])

COMPILED = (
    "banded.py",
    "banded_lu.py",
    "codegen",
    "compiled.py",
    "congruence.py",
    "kernels",
    "solver",
    "vector_writer.py",
    "vectors.py",
    "worlds",
)
"""What compiled functions are made of: modules that define them, and the layouts that they have as constants."""

OPTIMISATION = 1
"""Of Numba's for the entries: more takes a quarter longer to compile and does not show in the time of a step."""

KEPT = 4
"""Folders of older versions beyond this number are removed."""


def njit(function: F) -> F:
    """Compile a function by Numba, without Python objects and their lock, and keep the result on disk."""
    folder = _folder()
    if folder is None:
        return cast(F, numba.njit(error_model="numpy", nogil=True)(function))
    with _cache_at(folder):
        return cast(F, numba.njit(cache=True, error_model="numpy", nogil=True)(function))


def inner(function: F) -> F:
    """Compile a function that only compiled code calls: without what Python needs to call it; kept with its caller."""
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return cast(F, numba.njit(error_model="numpy", nogil=True, **options)(function))


def cfunc(signature: str, function: Callable[..., Any], optimisation: int = OPTIMISATION) -> Any:
    """Compile a function as a C function with an `address`, and keep the result on disk."""
    folder = _folder()
    if folder is None:
        return numba.cfunc(signature)(function)
    with _cache_at(folder), _configured("OPT", optimisation):
        return numba.cfunc(signature, cache=True)(function)


def announce() -> None:
    """Say on stderr that a minute will pass, if the compiled code is not on disk yet."""
    folder = _folder()
    if folder is None:
        sys.stderr.write(
            "worm3d: compiling, for about half a minute (every time: no folder for a cache can be written)\n"
        )
    elif not any(folder.rglob("*.nbi")):
        sys.stderr.write("worm3d: compiling, once, for about half a minute\n")
    sys.stderr.flush()


def _cache_at(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Make Numba choose this folder; it does so when a function is declared."""
    return _configured("CACHE_DIR", str(folder))


@contextlib.contextmanager
def _configured(name: str, value: object) -> Iterator[None]:
    """Set one of Numba's options for a while."""
    before = getattr(numba.config, name)
    setattr(numba.config, name, value)
    try:
        yield
    finally:
        setattr(numba.config, name, before)


@functools.cache
def _folder() -> Path | None:
    """Return the folder for this version of the package, or None if there is no writeable place."""
    base = default_folder()
    if base is None:
        return None
    folder = base.parent / "compiled" / _digest()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        probe = folder / ".writeable"
        probe.touch()
        probe.unlink()
        _prune(folder.parent)
    except OSError:
        return None
    return folder


def _digest() -> str:
    root = Path(__file__).parent
    sources = [root / name for name in COMPILED if name.endswith(".py")]
    sources += [path for name in COMPILED for path in (root / name).rglob("*.py")]
    parts = [numba.__version__.encode(), str(root).encode(), *(path.read_bytes() for path in sorted(sources))]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:24]


def _prune(parent: Path) -> None:
    folders = sorted((path for path in parent.iterdir() if path.is_dir()), key=lambda path: path.stat().st_mtime)
    for old in folders[:-KEPT]:
        shutil.rmtree(old, ignore_errors=True)
