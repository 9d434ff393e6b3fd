"""The model `worm_planar`: the planar special case of the 3D worm, with the keys of the planar model."""

from __future__ import annotations

from scenes.models.worm.checks import PLANAR_CHECKS
from scenes.models.worm.model import model_of
from scenes.models.worm.schema import PlanarWormScene

MODEL = model_of("worm_planar", "the planar worm as a special case of the 3D one", PlanarWormScene, PLANAR_CHECKS)
