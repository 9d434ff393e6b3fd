"""Wavelength of the gait of a case in segments, and the longest wave that segments cannot represent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from scenes import models
from scenes.language.schema import key_at
from scenes.sweep.case_file import CaseResult

WAVELENGTHS = {"wavelength": "", "wavelength_m": "length_m"}
"""Keys of the section [gait] for the wavelength. The value is a key of [worm], the divisor for body lengths, or
empty if the wavelength is in body lengths."""
ALIASED = 1.0 + math.sqrt(2.0)
"""Longest wavelength of a wave that counts as aliased [segments].

Since each segment has a single contraction, a wave of n segments contains a second wave, its alias. The alias has a
wavelength of n / (n - 1) segments, the opposite direction, and 1 / (n - 1) of the amplitude. At n = 2 both waves have
the same amplitude. At n = `ALIASED` the alias has half the power of the wave, and at n = 3 a quarter.
"""


def segments_per_wave(case: CaseResult) -> float:
    """Return the wavelength of the gait of a case [segments], or NaN for a gait without a wavelength."""
    gait, worm = (case.scene.get(name, {}) for name in ("gait", "worm"))
    for key, unit in WAVELENGTHS.items():
        if key in gait and "segments" in worm and _counts(case.model, key, gait):
            return float(gait[key] * worm["segments"] / (worm[unit] if unit else 1.0))
    return math.nan


def _counts(model: str, key: str, gait: Mapping[str, Any]) -> bool:
    """Return whether the kind of gait that the section `gait` chooses has the given key."""
    known = key_at(models.get(model).schema, ("gait", key))
    kinds = known.only if known else ()
    return not kinds or gait.get("kind") in kinds
