"""Wavelength of a case, counted in segments: whether the segments can carry the wave."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from scenes import models
from scenes.language.schema import key_at
from scenes.sweep.case_file import CaseResult

WAVELENGTHS = {"wavelength": "", "wavelength_m": "length_m"}
"""Keys of [gait] that are a wavelength, and the key of [worm] that is its unit; body lengths if empty."""
ALIASED = 1.0 + math.sqrt(2.0)
"""Wavelength up to which a wave is aliased [segments].

Each segment has one contraction, so that a wave of n segments comes with an image, a wave of n / (n - 1) segments that
runs the other way with 1 / (n - 1) of its amplitude: the same amplitude at two segments, half of the power here, a
quarter of the power at three segments.
"""


def segments_per_wave(case: CaseResult) -> float:
    """Return the commanded wavelength of a case [segments]; NaN for a gait that has none."""
    gait, worm = (case.scene.get(name, {}) for name in ("gait", "worm"))
    for key, unit in WAVELENGTHS.items():
        if key in gait and "segments" in worm and _counts(case.model, key, gait):
            return float(gait[key] * worm["segments"] / (worm[unit] if unit else 1.0))
    return math.nan


def _counts(model: str, key: str, gait: Mapping[str, Any]) -> bool:
    """Return whether the gait of a scene takes a key of its section."""
    known = key_at(models.get(model).schema, ("gait", key))
    kinds = known.only if known else ()
    return not kinds or gait.get("kind") in kinds
