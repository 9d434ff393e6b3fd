"""Key of a case: a digest of all that its result depends on."""

from __future__ import annotations

import hashlib
import json

from scenes.commands.packages import sources, versions
from scenes.models.loading import Scene

LENGTH = 20
"""Number of characters of a key: 80 bits, so that a million cases hardly ever share one."""


def key_of(scene: Scene) -> str:
    """Return the key of a checked scene: of its settings, seed included, of what they refer to, and of the programs.

    What a scene refers to are files, and what a controller knows of its worm (`Model.refers_to`).
    """
    refers = scene.model.refers_to
    basis = {
        "scene": scene.to_toml(),
        "refers_to": None if refers is None else refers(scene.settings),
        "versions": versions(),
        "sources": sources(),
    }
    return hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()[:LENGTH]
