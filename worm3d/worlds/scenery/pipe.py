"""What pipes look like: a wall in bands that one can see through, and its centre line for the camera inside."""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.pieces import rounded_up
from worm3d.viewer.world import PIPE, WorldMesh, banded_pipe
from worm3d.worlds.pipe import Pipe
from worm3d.worlds.scenery.base import MARGIN, TILE, Scenery, Window, scenery

ASKED = 300
"""Places of the worm, out of all, by which the stretch that is drawn is found."""

RINGS = 5
"""In a band."""

SIDES = 40
OPACITY = 0.3


@scenery.register
def _pipe(world: Pipe, window: Window) -> Scenery:
    some = window.points[:: max(len(window.points) // ASKED, 1)]
    along = world.along(some)
    margin = MARGIN * window.body_length
    begin, end = float(along.min()) - margin, float(along.max()) + margin
    begin = max(begin, 0.0) if world.start_wall else begin
    end = min(end, world.centreline.total) if world.end_wall else end
    band = rounded_up(TILE * window.body_length)
    count = RINGS * max(int(np.ceil((end - begin) / band)), 1) + 1
    # The bands stay where they are whatever the worm does.
    s = np.linspace(band * np.floor(begin / band) if not world.start_wall else begin, end, count)
    points, radius = world.centreline.at(s)[0], world.radius_at(s)
    walls = [(k, s[k]) for k, closed in ((0, world.start_wall), (-1, world.end_wall)) if closed]
    caps = tuple(_cap(world, points[k], place, float(radius[k])) for k, place in walls)
    return Scenery((*banded_pipe(points, radius, band=band, sides=SIDES, opacity=OPACITY), *caps), points)


def _cap(world: Pipe, middle: FloatArray, place: float, radius: float) -> WorldMesh:
    """Return the flat wall that closes the pipe at a place along it."""
    _, tangent = world.centreline.at(place)
    across = np.linalg.svd(tangent[None])[2][1:]
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    rim = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    corner = np.arange(SIDES)
    faces = np.stack([np.full(SIDES, SIDES), corner, (corner + 1) % SIDES], axis=1)
    return WorldMesh("end of the pipe", np.vstack([rim, middle]), faces, PIPE, OPACITY)
