"""The environment of the program: a check of the imported packages, the versions of packages, and the machine.

The import name `control` is also the name of python-control, and pip installs both into the same folder without a
warning; then `import control` imports the other package, or a mixture.
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
"""Line that only our `control` contains."""
HOME = Path(__file__).resolve().parents[2]


def require_own_packages() -> None:
    """Check, without importing them, that our import names lead to our packages.

    Raises
    ------
    SceneError
        Another file was found; the sentence names the file and the remedy.
    """
    for name in OURS:
        found, own = _found(name), HOME / name / "__init__.py"
        if found != own or (name == "control" and OWN_CONTROL_LINE not in own.read_text(encoding="utf-8")):
            raise SceneError(
                f"the import name '{name}' leads to {found or 'nothing'}, which is not worm3d's package; "
                f"run 'pip uninstall {name}' (or take its folder off PYTHONPATH), then install worm3d again"
            )


_version = cache(metadata.version)
"""Function that returns the version of a package; cached, because the search would take longer than a short run."""


def versions() -> dict[str, str]:
    """Return the version of worm3d, of Python and of the libraries that results depend on."""
    packages = {name: _version(name) for name in ("worm3d", *LIBRARIES)}
    return {"python": platform.python_version(), **packages}


@cache
def sources() -> str:
    """Return a digest of all modules of the program."""
    digest = hashlib.sha256()
    for name in ("worm3d", "control", "planar", "scenes"):
        for path in sorted((HOME / name).rglob("*.py")):
            digest.update(f"{path.relative_to(HOME).as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def machine() -> dict[str, Any]:
    """Return processor, cores, system, date and versions, without the machine's name or any path."""
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %z}",
        "versions": versions(),
    }


def cpu_name(listing: Path = Path("/proc/cpuinfo")) -> str:
    """Return the name of the processor, as given by the system."""
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
