"""Geometry for the cameras: the heading of the worm, the floor, and a position ahead of the worm inside a pipe."""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.frames import Frames
from worm3d.viewer.world import WorldMesh

FRONT = (0.9, 0.3)
"""Distances of the inside camera ahead of and above the head if there is no pipe, in body lengths."""


def azimuths(frames: Frames) -> FloatArray:
    """Return the heading in every frame, shape (T,) [rad].

    The heading is the azimuth of the line from tail to head. It is averaged over a period, because the worm sways with
    each wave. While this line is nearly vertical, the last heading is used.
    """
    chord = frames.joints[:, -1] - frames.joints[:, 0]
    level = np.linalg.norm(chord[:, :2], axis=1) > 0.05 * np.linalg.norm(chord, axis=1)
    first = float(np.arctan2(*frames.heading[1::-1]))
    angle = np.unwrap([first, *np.arctan2(chord[level, 1], chord[level, 0])])
    return frames.mean_over_period(angle[np.cumsum(level)])


def floor(world: tuple[WorldMesh, ...]) -> FloatArray | None:
    """Return the plane z = a + b x + c y that fits the opaque meshes best, as (a, b, c).

    The result is None if there are no opaque meshes. In directions where the meshes are too narrow to determine
    the tilt of the plane, the plane is level.
    """
    solid = [mesh.vertices for mesh in world if mesh.opacity == 1.0 and len(mesh.vertices)]
    if not solid:
        return None
    points = np.concatenate(solid)
    matrix = np.column_stack([np.ones(len(points)), points[:, :2]])
    return np.asarray(np.linalg.lstsq(matrix, points[:, 2], rcond=1e-9)[0])


def inside(frames: Frames) -> tuple[FloatArray, FloatArray]:
    """Return the position of the inside camera and the point that it looks at in every frame, each (T, 3) [m].

    If the head is near the centre line of a pipe, the camera is just above this line, ahead of the head. Otherwise it
    is ahead of the head in the head's direction, further away and higher.
    """
    heads, size = frames.joints[:, -1], frames.body_length
    pointing = heads - frames.joints[:, max(frames.segments - 2, 0)]
    pointing = pointing / np.linalg.norm(pointing, axis=1, keepdims=True)
    up = np.cross(pointing, frames.directors[:, -1])
    eyes = heads + size * (FRONT[0] * pointing + FRONT[1] * up)
    if frames.centreline is not None:
        for k, (head, direction) in enumerate(zip(heads, pointing, strict=True)):
            place = _ahead_on(frames.centreline, head, direction, 0.4 * size)
            if place is not None:
                eyes[k] = place + 0.03 * size * up[k]
    return eyes, heads


def _ahead_on(line: FloatArray, head: FloatArray, direction: FloatArray, reach: float) -> FloatArray | None:
    """Return the point on a line at a distance `reach` ahead of the head, or None if the head is far from the line."""
    edges = np.diff(line, axis=0)
    square = np.maximum(np.sum(edges**2, axis=1), 1e-300)
    share = np.clip(np.sum((head - line[:-1]) * edges, axis=1) / square, 0.0, 1.0)
    away = np.linalg.norm(line[:-1] + share[:, None] * edges - head, axis=1)
    k = int(away.argmin())
    if away[k] > 0.5 * reach:
        return None
    arc = np.concatenate([[0.0], np.cumsum(np.sqrt(square))])
    here = arc[k] + share[k] * np.sqrt(square[k])
    there = here + (reach if edges[k] @ direction >= 0.0 else -reach)
    place = np.array([np.interp(there, arc, x) for x in line.T])
    # Beyond an end, the line continues straight.
    beyond = there - float(np.clip(there, 0.0, arc[-1]))
    last = edges[-1] / np.sqrt(square[-1]) if beyond > 0.0 else edges[0] / np.sqrt(square[0])
    return np.asarray(place + beyond * last)
