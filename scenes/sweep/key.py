"""Key of a case: a digest of all that its result depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pydantic import BaseModel

from scenes.commands.packages import sources, versions
from scenes.language.loader import SHIPPED
from scenes.language.schema import is_file
from scenes.models.loading import Scene

LENGTH = 20
"""Number of characters of a key: 80 bits, so that a million cases hardly ever share one."""


def key_of(scene: Scene) -> str:
    """Return the key of a checked scene: of its settings, seed included, of what they refer to, and of the programs.

    What a scene refers to are the content of its files, and what its model adds (`Model.refers_to`), such as the map by
    which a controller knows its worm.
    """
    refers = scene.model.refers_to
    basis = {
        "scene": scene.to_toml(),
        "files": [_digest_of(path) for path in _files(scene.settings)],
        "refers_to": None if refers is None else refers(scene.settings),
        "versions": versions(),
        "sources": sources(),
    }
    return hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()[:LENGTH]


def _files(section: BaseModel) -> Iterator[Path]:
    """Yield the files that a scene names, or that come with the program under the name."""
    for name, field in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, BaseModel):
            yield from _files(value)
        elif isinstance(value, str) and is_file(field):
            yield from [path for path in (Path(value), SHIPPED / value) if path.is_file()][:1]


def _digest_of(path: Path) -> str:
    stat = path.stat()
    return _digest_at(path, stat.st_mtime_ns, stat.st_size)


@cache
def _digest_at(path: Path, changed: int, size: int) -> str:
    """Return a digest of a file as it was changed last."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
