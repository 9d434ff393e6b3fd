"""Wavelength of a case in segments: whichever key of the gait says what the wave is, it is the same wave."""

from __future__ import annotations

import math
from typing import Any

import pytest

from scenes.sweep.case_file import CaseResult
from scenes.sweep.waves import segments_per_wave


def counted(model: str, gait: dict[str, Any], **worm: Any) -> float:
    return segments_per_wave(CaseResult("key", "scene", model, "done", "", 0, scene={"gait": gait, "worm": worm}))


@pytest.mark.parametrize("model", ["worm", "planar_linkage"])
@pytest.mark.parametrize("kind", ["travelling_wave", "steered"])
def test_a_wavelength_in_bodies_has_that_many_times_the_segments(model: str, kind: str) -> None:
    assert counted(model, {"kind": kind, "wavelength": 0.5}, segments=8, length_m=2.0) == 4.0
    assert counted(model, {"kind": kind, "wavelength": 2}, segments=6) == 12.0


def test_a_wavelength_in_metres_is_over_the_length_of_the_worm() -> None:
    gait = {"kind": "travelling_wave", "wavelength_m": 1.5}
    assert counted("planar_published", gait, segments=8, length_m=3.0) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("model", "gait", "worm"),
    [
        ("worm", {"kind": "travelling_wave"}, {"segments": 6}),
        ("worm", {"kind": "two_anchor", "wavelength": 1.0}, {"segments": 6}),
        ("worm", {"kind": "travelling_wave", "wavelength": 1.0}, {}),
        ("planar_published", {"kind": "two_anchor", "wavelength_m": 1.0}, {"segments": 6, "length_m": 1.0}),
    ],
)
def test_a_gait_that_takes_no_wavelength_has_none(model: str, gait: dict[str, Any], worm: dict[str, Any]) -> None:
    """Nor has a scene without gait and worm, as that of a case that has not run."""
    assert math.isnan(counted(model, gait, **worm))
    assert math.isnan(segments_per_wave(CaseResult("key", "scene", model, "not run", "", 0)))
