"""The overview picture of a run of the load frame: the force over the length of cable taken in."""

from __future__ import annotations

import numpy as np
from PIL.Image import Image

from scenes.records.overview import (
    BOTTOM_MARGIN,
    HEADER_HEIGHT,
    LEFT_MARGIN,
    LINE_COLOURS,
    PICTURE_WIDTH,
    RIGHT_MARGIN,
    TOP_MARGIN,
    Panel,
    headed,
    limits,
)
from scenes.records.record import Record


def draw(record: Record, high: int = 320) -> Image:
    """Draw the overview of a record; `high` is the height of the panel [pixels]."""
    share = record.summary["work_lost_share"]
    lost = f": {share:.1%} of the work is lost" if isinstance(share, float) else ""
    canvas = headed(record, record.sentence + lost, TOP_MARGIN + high + BOTTOM_MARGIN)
    cable, force = 1e3 * record["cable"], record["force"]
    x, y = limits(cable, 1e-6), limits(force, 1e-9)
    box = (LEFT_MARGIN, HEADER_HEIGHT + TOP_MARGIN, PICTURE_WIDTH - RIGHT_MARGIN, HEADER_HEIGHT + TOP_MARGIN + high)
    panel = Panel(canvas, box, np.array([x[0], y[0]]), np.array([x[1], y[1]]))
    panel.frame("force in the cable [N]", "cable taken in [mm]")
    panel.line(np.column_stack([cable, force]), LINE_COLOURS[0])
    return canvas.image
