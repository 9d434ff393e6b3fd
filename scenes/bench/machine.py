"""Where and when something was measured: without the machine's name or any path."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from scenes.records.versions import versions

RIVALS = ("mujoco", "pyelastica")


def machine() -> dict[str, Any]:
    """Return processor, cores, system, date and versions."""
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %z}",
        "versions": versions() | _rivals(),
    }


def cpu_name(listing: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's name, as far as the system tells."""
    with suppress(OSError):
        for line in listing.read_text().splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _rivals() -> dict[str, str]:
    found = {}
    for name in RIVALS:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found
