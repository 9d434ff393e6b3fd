"""The environment of the program: a check of the imported packages, the versions of packages, and the machine.

The package python-control has the import name `control`, too. If both are installed, pip writes them to the same folder
without a warning, and `import control` imports the other package or a mixture of both.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from scenes.language.errors import SceneError

LIBRARIES = ("numpy", "scipy", "casadi", "numba", "llvmlite", "h5netcdf", "h5py", "matplotlib")
OURS = ("control", "planar", "worm3d")
OWN_CONTROL_LINE = 'DISTRIBUTION = "worm3d"'
"""Line of `control/__init__.py` that only the package of worm3d contains."""
HOME = Path(__file__).resolve().parents[2]


def require_own_packages() -> None:
    """Check that the import names of worm3d lead to the packages of worm3d. The packages are not imported.

    Raises
    ------
    SceneError
        If a name leads to another file. The message names the file and says what to do.
    """
    for name in OURS:
        found, own = _found(name), HOME / name / "__init__.py"
        if found != own or (name == "control" and OWN_CONTROL_LINE not in own.read_text(encoding="utf-8")):
            raise SceneError(
                f"the import name '{name}' leads to {found or 'nothing'}, must lead to worm3d's own package; "
                f"run 'pip uninstall {name}' (or take its folder off PYTHONPATH), then install worm3d again"
            )


_version = cache(metadata.version)
"""Function that returns the version of a package. It is cached, since each search takes longer than a short run."""


def versions() -> dict[str, str]:
    """Return the versions of worm3d, of Python, and of the libraries on whose versions results may depend."""
    packages = {name: _version(name) for name in ("worm3d", *LIBRARIES)}
    return {"python": platform.python_version(), **packages}


@cache
def sources() -> str:
    """Return a hash of the source code of all modules of the program."""
    digest = hashlib.sha256()
    for name in ("worm3d", "control", "planar", "scenes"):
        for path in sorted((HOME / name).rglob("*.py")):
            digest.update(f"{path.relative_to(HOME).as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def machine() -> dict[str, Any]:
    """Return the processor, the number of cores, the system, the date and the versions.

    The result contains neither the name of the machine nor any path.
    """
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %z}",
        "versions": versions(),
    }


def cpu_name(listing: Path = Path("/proc/cpuinfo")) -> str:
    """Return the name of the processor as the operating system gives it."""
    with suppress(OSError):
        for line in listing.read_text().splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def info_lines() -> Iterator[str]:
    """Yield the lines of `worm3d info`."""
    found = versions()
    yield f"worm3d {found.pop('worm3d')}"
    yield f"python {found.pop('python')} at {sys.executable}"
    yield f"platform {platform.platform()}"
    yield "libraries " + ", ".join(f"{name} {version}" for name, version in found.items())
    for name in ("scenes", *OURS):
        yield f"package {name} at {_found(name) or 'nowhere'}"


def _found(name: str) -> Path | None:
    spec = find_spec(name)
    return Path(spec.origin).resolve() if spec and spec.origin else None
