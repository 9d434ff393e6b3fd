"""Numba's compiler, with what it compiles kept on disk.

This is all that the package shares with `worm3d`: how files of a cache are verified, and no formula.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from worm3d.machine.cache.functions import keep, sources_digest

F = TypeVar("F", bound=Callable[..., Any])


def njit(function: F) -> F:
    """Compile a function by Numba, and keep the result under a digest of this package's sources."""
    return cast(F, keep(numba.njit(function), version))


@functools.cache
def version() -> str:
    """Return a digest of this package's sources."""
    root = Path(__file__).parent
    return sources_digest(root, root.rglob("*.py"))
