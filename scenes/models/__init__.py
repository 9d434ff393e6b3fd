"""The models that a scene can choose by `model = "..."`; each is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenes.models.base import Model

_MODULES = {
    "worm": "scenes.models.worm.model",
    "worm_control": "scenes.models.control.model",
    "worm_planar": "scenes.models.worm.planar",
    "planar_published": "scenes.models.planar.published",
    "planar_linkage": "scenes.models.planar.linkage",
    "planar_study": "scenes.models.planar.study",
}


def names() -> tuple[str, ...]:
    """Return the names of all models."""
    return tuple(_MODULES)


def get(name: str) -> Model[Any]:
    """Return a model by its name; KeyError if there is none."""
    model: Model[Any] = import_module(_MODULES[name]).MODEL
    return model
