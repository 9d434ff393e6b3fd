"""The models that a scene can choose by `model = "..."`; a model is imported on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenes.models.base import Model

_PLACES = {
    "worm": ("scenes.models.worm.model", "WORM_MODEL"),
    "worm_control": ("scenes.models.control.model", "CONTROL_MODEL"),
    "load_frame": ("scenes.models.load_frame.model", "LOAD_FRAME_MODEL"),
    "worm_planar": ("scenes.models.worm.model", "PLANAR"),
    "planar_published": ("scenes.models.planar.published", "PUBLISHED_MODEL"),
    "planar_linkage": ("scenes.models.planar.linkage", "LINKAGE_MODEL"),
}
"""Module of each model, and the name of the model in the module."""


def names() -> tuple[str, ...]:
    """Return the names of all models."""
    return tuple(_PLACES)


def get(name: str) -> Model[Any]:
    """Return the model with the given name; raise KeyError if there is none."""
    module, attribute = _PLACES[name]
    model: Model[Any] = getattr(import_module(module), attribute)
    return model
