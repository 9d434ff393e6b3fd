"""The overview picture of a run of the 3D worm: a side view and a top view, with x along the initial heading."""

from __future__ import annotations

import math

import numpy as np
from PIL.Image import Image

from scenes.models.worm.view import scene_of
from scenes.records import overview
from scenes.records.record import Record
from worm3d.physics.segment_law_names import SEGMENT_LAWS
from worm3d.values.arrays import FloatArray

APEX_ROWS = ((0, 3), (1, 4), (2, 5))
"""Numbers of the lower, the upper and the outward apexes of a segment, each for the left and the right chamber."""
ELLIPSE_CORNERS = 32
"""Number of corners of the polygon that is drawn for an ellipse."""


def draw(record: Record) -> Image:
    """Draw the overview of a record."""
    com = in_its_frame(record, record["com"])
    joints, points = (in_its_frame(record, record[name][[0, -1]]) for name in ("joints", "points"))
    given = record["contraction"][-1]
    below, above, outward = ([points[:, :, row] for row in rows] for rows in APEX_ROWS)
    tail, head = joints[:, :-1], joints[:, 1:]
    most = float(np.abs(record["contraction"]).max()) or 1.0
    left, right = (outlines(record, tail, above[k], head, below[k]) for k in (0, 1))
    flat = outlines(record, tail, outward[0], head, outward[1])
    views = (
        overview.Side(
            "from its right: height [m]",
            "along the initial heading [m]",
            np.concatenate([left, right], axis=1)[..., [0, 2]],
            np.concatenate([given[:, 0], given[:, 1]]) / most,
            com[:, [0, 2]],
        ),
        overview.Side(
            "from above: to the left [m]",
            "along the initial heading [m]",
            flat[..., :2],
            given.mean(axis=1) / most,
            com[:, :2],
        ),
    )
    moved = com - com[0]
    return overview.of_run(record, views, {"along the initial heading": moved[:, 0], "to its left": moved[:, 1]})


def outlines(record: Record, tail: FloatArray, top: FloatArray, head: FloatArray, bottom: FloatArray) -> FloatArray:
    """Return the outlines of segments in a view, shape (..., C, 3) [m]: rhombi, or ellipses for segments without links.

    The arguments are the corners of the rhombi, or the ends of the axes of the ellipses, each of shape (..., 3) [m].
    """
    section = getattr(scene_of(record), "segment", None)
    if section is None or SEGMENT_LAWS[section.kind].has_links:
        return np.stack([tail, top, head, bottom], axis=-2)
    angle = np.linspace(0.0, 2.0 * np.pi, ELLIPSE_CORNERS, endpoint=False)[:, None]
    middle, along, across = (each[..., None, :] / 2.0 for each in (top + bottom, head - tail, top - bottom))
    found: FloatArray = middle + np.cos(angle) * along + np.sin(angle) * across
    return found


def in_its_frame(record: Record, places: FloatArray, *, back: bool = False) -> FloatArray:
    """Return points, shape (..., 3) [m], in the axes of the initial heading: forward, left, up.

    If `back` is true, return points given in these axes in the axes x, y, z.
    """
    azimuth = float(record["heading"][0])
    azimuth = 0.0 if math.isnan(azimuth) else azimuth  # a vertical body has no azimuth
    azimuth = -azimuth if back else azimuth
    c, s = math.cos(azimuth), math.sin(azimuth)
    turned: FloatArray = places @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turned
