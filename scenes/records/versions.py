"""Which programs made a result, and where they come from."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from importlib import metadata
from importlib.util import find_spec

LIBRARIES = ("numpy", "scipy", "casadi", "numba", "llvmlite", "pydantic", "h5netcdf", "h5py", "matplotlib")
OURS = ("scenes", "control", "planar", "worm3d")


def versions() -> dict[str, str]:
    """Return the version of worm3d, of Python and of the libraries that results depend on."""
    packages = {name: metadata.version(name) for name in ("worm3d", *LIBRARIES)}
    return {"python": platform.python_version(), **packages}


def info_lines() -> Iterator[str]:
    """Yield the lines of `worm3d info`."""
    found = versions()
    yield f"worm3d {found.pop('worm3d')}"
    yield f"python {found.pop('python')} at {sys.executable}"
    yield f"platform {platform.platform()}"
    yield "libraries " + ", ".join(f"{name} {version}" for name, version in found.items())
    for name in OURS:
        spec = find_spec(name)
        yield f"package {name} at {spec.origin if spec else 'nowhere'}"
