"""Colours with the same meaning in the browser, in figures and in exported meshes."""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.values.chamber_colours import LONG_CHAMBER as LONG_CHAMBER
from worm3d.values.chamber_colours import RAMP as RAMP
from worm3d.values.chamber_colours import RESTING_CHAMBER as RESTING_CHAMBER
from worm3d.values.chamber_colours import SHORT_CHAMBER as SHORT_CHAMBER
from worm3d.viewer.world import Colour

LINK: Colour = (0.27, 0.29, 0.34)
FACE: Colour = (0.36, 0.30, 0.34)
SKIN: Colour = (0.89, 0.58, 0.53)
FORCE_ARROW: Colour = (0.95, 0.55, 0.05)
ANCHOR: Colour = (0.05, 0.62, 0.30)
TRAIL: Colour = (0.50, 0.22, 0.66)
REFERENCE_PATH: Colour = (0.10, 0.12, 0.15)
HORIZON: Colour = (0.85, 0.10, 0.62)


def strain_limit(strain: FloatArray) -> float:
    """Return the strain for colours of full intensity, i.e. the largest strain, but at least 0.05."""
    return max(float(np.abs(strain).max(initial=0.0)), 0.05)


def strain_colour(strain: FloatArray, limit: float) -> FloatArray:
    """Return the colours of chambers, shape (..., 3). Shorter chambers are red, and longer chambers are blue."""
    share = np.clip(np.asarray(strain) / limit, -1.0, 1.0)[..., None]
    end = np.where(share < 0.0, np.array(SHORT_CHAMBER), np.array(LONG_CHAMBER))
    return np.asarray(np.array(RESTING_CHAMBER) + np.abs(share) * (end - np.array(RESTING_CHAMBER)))


def as_hex(colour: Colour) -> str:
    """Return a colour as a text "#rrggbb"."""
    return "#" + bytes(round(255 * part) for part in colour).hex()
