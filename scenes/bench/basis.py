"""What a kept case depends on besides its scene: the programs, and what the controller knows of the worm."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from importlib import import_module
from pathlib import Path

from scenes.models.control.build import identified_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import Scene
from scenes.records.versions import versions

PACKAGES = ("worm3d", "control", "scenes")
"""Whose sources count."""


def basis(scene: Scene) -> str:
    """Return a digest of the versions, of all sources and of the identified map of a scene with a controller."""
    assert isinstance(scene.settings, ControlScene)
    found = identified_of(scene.settings)
    content = {"versions": versions(), "sources": sources(), "map": None if found is None else found.as_dict()}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


@cache
def sources() -> str:
    """Return a digest of all modules of the packages."""
    digest = hashlib.sha256()
    for name in PACKAGES:
        root = Path(str(import_module(name).__file__)).parent
        for path in sorted(root.rglob("*.py")):
            digest.update(f"{name}/{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()
