"""Descriptions of segments in TOML: the shipped barrel, profiles, and messages for mistakes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d.fem.description import Barrel, Cylinder, Points, Profile, parse
from worm3d.fem.material import Yeoh

BARREL = (Path(__file__).parents[3] / "scenes" / "data" / "barrel.toml").read_text(encoding="utf-8")


def test_shipped_barrel() -> None:
    segment = parse(BARREL)
    assert isinstance(segment.rubber, Yeoh)
    assert segment.rest_length == pytest.approx(1.0 / 6.0)
    assert segment.load.values == (0.0, 4500.0)
    inner, outer = (segment.wall(np.zeros(1), np.full(1, depth)) for depth in (-1.0, 1.0))
    assert_allclose(outer - inner, [[segment.thickness_m], [0.0]], atol=1e-15)
    assert 0.02 < segment.plate_radius < 0.02 + segment.thickness_m / 2.0


@pytest.mark.parametrize(
    "profile",
    [
        Barrel(length_m=0.1, plate_radius_m=0.02, middle_radius_m=0.05),
        Barrel(length_m=0.1, plate_radius_m=0.05, middle_radius_m=0.03),
        Barrel(length_m=0.1, plate_radius_m=0.02, middle_radius_m=0.02),
        Cylinder(length_m=0.1, radius_m=0.02),
        Points(z_m=(0.0, 0.02, 0.05), radius_m=(0.05, 0.04, 0.02)),
    ],
)
def test_tangents_are_unit_vectors_along_the_profile(profile: Profile) -> None:
    s, h = np.linspace(0.1, 0.9, 9), 1e-4
    tangents = profile.meridian(s)[1]
    slope = (profile.meridian(s + h)[0] - profile.meridian(s - h)[0]) / (2.0 * h)
    assert_allclose(tangents, slope / np.hypot(*slope), atol=2e-4)
    assert_allclose(np.hypot(*slope), np.hypot(*slope)[0], rtol=1e-3)  # s is the length of the arc
    ends = profile.meridian(np.array([0.0, 1.0]))[0]
    assert_allclose(ends[1], [0.0, 0.05], atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "barrel"', 'kind = "ball"', "profile.kind: got 'ball', must be one of 'barrel', 'cylinder', 'points'"),
        ("thickness_m = 0.0015", "thickness_m = -1.0", "wall.thickness_m: got -1.0 m, must be finite and in (0, 0.02)"),
        ("thickness_m", "thicknes_m", "wall.thicknes_m: unknown key; did you mean 'thickness_m'?"),
        ("c1_Pa = 30e3", "", "rubber.c1_Pa: missing; add it to the section [rubber]"),
        ("[0.0, 4500.0]", "[4500.0, 0.0]", "load.pressure_Pa: got [4500, 0], must be two ascending numbers"),
        ("pressure_Pa", "pressure_kPa", "load.pressure_kPa: unknown key; did you mean 'pressure_Pa'?"),
        ("pressure_Pa = [0.0, 4500.0]", "", "load: got no input, must have one of pressure_Pa and cable_N"),
        ("middle_radius_m = 0.05", "middle_radius_m = 0.5", "profile.middle_radius_m: got 0.5 m, must differ from"),
        ("per_m = 200.0", 'per_m = "many"', "fibres.per_m: got 'many' 1/m, must be finite and above 0"),
        ("[wall]", "[wall", "broken TOML"),
    ],
)
def test_mistakes_get_a_sentence(old: str, new: str, message: str) -> None:
    assert old in BARREL
    with pytest.raises(ValueError, match=re.escape(message)):
        parse(BARREL.replace(old, new, 1))
