"""Key of a case, a hash of everything that affects its result."""

from __future__ import annotations

import hashlib
import json
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from scenes.language.loader import SHIPPED_FOLDER
from scenes.language.schema import Section, keys_in
from scenes.models.loading import Scene
from scenes.running.packages import sources, versions
from worm3d.values import named

KEY_LENGTH = 20
"""Number of hexadecimal digits of a key. With 80 bits, it is very unlikely that two of a million cases have the same
key."""


def key_of(scene: Scene, *, possible: bool = True) -> str:
    """Return the key of a checked scene.

    It is a hash of the settings including the seed, of the files that the scene names, of the modules of a user's own
    parts, of further data that affect the run (`Model.refers_to`), and of the programs. For a scene that is not
    `possible`, the further data are left out.
    """
    refers = scene.model.refers_to if possible else None
    basis = {
        "scene": scene.to_toml(),
        "files": [_digest_of(path) for path in _files(scene.settings)],
        "code": [_digest_of(path) for path in _modules(scene.to_toml())],
        "refers_to": None if refers is None else refers(scene.settings),
        "versions": versions(),
        "sources": sources(),
    }
    return hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()[:KEY_LENGTH]


def _modules(text: str) -> list[Path]:
    """Return the files of the modules of a user's own parts in a scene; `text` is the scene as TOML."""
    modules = [
        sys.modules.get(name.partition(":")[0]) for name in named.names_in(tomllib.loads(text) if ":" in text else {})
    ]
    return [Path(file) for module in modules if (file := getattr(module, "__file__", None))]


def _files(section: Section) -> Iterator[Path]:
    """Yield the files that a scene names. They may be shipped files."""
    for path in _named(type(section)):
        value: Any = section
        for name in path:
            value = getattr(value, name)
        if isinstance(value, str):
            yield from [path for path in (Path(value), SHIPPED_FOLDER / value) if path.is_file()][:1]


@cache
def _named(section: type[Section]) -> tuple[tuple[str, ...], ...]:
    """Return the path of each key whose value is the path of a file."""
    found: list[tuple[str, ...]] = []
    for name, known in keys_in(section).items():
        if known.section:
            found += [(name, *rest) for rest in _named(known.section)]
        elif known.is_file:
            found.append((name,))
    return tuple(found)


def _digest_of(path: Path) -> str:
    stat = path.stat()
    return _digest_at(path, stat.st_mtime_ns, stat.st_size)


@cache
def _digest_at(path: Path, changed: int, size: int) -> str:
    """Return a hash of a file. It is cached; the time of the last change and the size are part of the cache's key."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
