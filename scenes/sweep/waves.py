"""Wavelength of a case in segments, and whether the segments can carry the wave."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from scenes import models
from scenes.language.schema import key_at
from scenes.sweep.case_file import CaseResult

WAVELENGTHS = {"wavelength": "", "wavelength_m": "length_m"}
"""Wavelength keys of [gait], and the key of [worm] that is the unit; body lengths if empty."""
ALIASED = 1.0 + math.sqrt(2.0)
"""Wavelength up to which a wave is aliased [segments].

Each segment has one contraction, so that a wave of n segments has an alias, a wave of n / (n - 1) segments in the
opposite direction with 1 / (n - 1) of the amplitude: equal amplitude at two segments, half the power at this limit, a
quarter of the power at three segments.
"""


def segments_per_wave(case: CaseResult) -> float:
    """Return the commanded wavelength of a case [segments]; NaN for a gait without a wavelength."""
    gait, worm = (case.scene.get(name, {}) for name in ("gait", "worm"))
    for key, unit in WAVELENGTHS.items():
        if key in gait and "segments" in worm and _counts(case.model, key, gait):
            return float(gait[key] * worm["segments"] / (worm[unit] if unit else 1.0))
    return math.nan


def _counts(model: str, key: str, gait: Mapping[str, Any]) -> bool:
    """Return whether the gait of a scene uses a key of the section."""
    known = key_at(models.get(model).schema, ("gait", key))
    kinds = known.only if known else ()
    return not kinds or gait.get("kind") in kinds
