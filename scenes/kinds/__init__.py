"""The models that a scene can choose by `model = "..."`; each is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenes.kinds.base import Kind

_MODULES = {
    "worm": "scenes.kinds.worm",
    "worm_control": "scenes.kinds.worm_control",
    "worm_planar": "scenes.kinds.worm_planar",
    "planar_published": "scenes.kinds.planar_published",
    "planar_linkage": "scenes.kinds.planar_linkage",
    "planar_study": "scenes.kinds.planar_study",
}


def names() -> tuple[str, ...]:
    """Return the names of all models."""
    return tuple(_MODULES)


def get(name: str) -> Kind[Any]:
    """Return a model by its name; KeyError if there is none."""
    kind: Kind[Any] = import_module(_MODULES[name]).KIND
    return kind
