"""Loading and checking of scenes: `scenes.language.loader` with the models of this program."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from scenes import models
from scenes.language import loader
from scenes.language.reading import trusted
from scenes.models.base import Model

Scene = loader.Scene[Model[Any]]
"""A checked scene of one of the models."""


def load_scene(name_or_path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene, by name or file; see `scenes.language.loader.load_scene`."""
    return loader.load_scene(models, name_or_path, overrides)


def parse_scene(text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Check a scene given as TOML text; see `scenes.language.loader.parse_scene`."""
    return loader.parse_scene(models, text, name, overrides, folder)


def draft(text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> loader.Draft[Model[Any]]:
    """Return a scene given as TOML text, for many checks; see `scenes.language.loader.Draft`."""
    return loader.Draft(models, text, name, overrides, folder)


def trusted_scene(data: Mapping[str, Any], name: str) -> Scene:
    """Return a resolved scene from data that have been checked before; many times as fast as `parse_scene`."""
    model, data, _ = loader.with_own_parts(models.get(data["model"]), data)
    return loader.Scene(name, model, trusted(model.schema, data))
