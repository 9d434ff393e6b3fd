"""A smooth skin around the chambers, as a mesh with a shape for each of some instants."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.viewer import colours
from worm3d.viewer.arrays import FloatArray
from worm3d.viewer.body import Body
from worm3d.viewer.frames import Frames, instants
from worm3d.viewer.piece import Skin
from worm3d.viewer.tube import Mesh, cap_faces, wall_faces

RINGS = 5
"""Rings a segment."""
SIDES = 18
WAIST = 0.62
"""Thickness at the joints over that of the chambers beside it."""


def skin(frames: Frames, fps: float = 10.0, opacity: float = 0.5) -> Skin:
    """Return the skin with shapes at `fps` instants a second, between which it moves on straight lines.

    It passes through the outward apexes and a little outside those below and above, and is closed at both ends.
    """
    shown = frames.take(instants(frames.time, fps)) if len(frames) > 1 else frames
    vertices = _vertices(_rings(Body.of(shown), shown.joints))
    count = RINGS * frames.segments + 1
    faces = np.vstack([wall_faces(count, SIDES), cap_faces(count, SIDES)])
    normals = _normals(vertices, faces)
    return Skin(
        path="skin/skin",
        mesh=Mesh(vertices[0], faces),
        colour=colours.SKIN,
        opacity=opacity,
        shapes=vertices,
        normals=normals,
        shape_time=shown.time,
    )


def _rings(body: Body, joints: FloatArray) -> FloatArray:
    """Return cross-sections, shape (M, rings, SIDES, 3): ellipses across the centre line [m]."""
    share = np.arange(RINGS) / RINGS
    along = joints[:, :-1, None] + share[:, None] * np.diff(joints, axis=1)[:, :, None]
    along = np.concatenate([along.reshape(len(joints), -1, 3), joints[:, -1:]], axis=1)
    height = body.height.mean(axis=2)
    offset = 0.5 * np.linalg.norm(body.centre[:, :, 0] - body.centre[:, :, 1], axis=2)
    tall = _swelling(1.06 * height, share)
    wide = tall + _swelling(offset, share, waist=0.85)
    d, u = _carried(body.d, share), _carried(body.u, share)
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    return np.asarray(
        along[:, :, None]
        + (np.cos(angle) * wide[..., None])[..., None] * d[:, :, None]
        + (np.sin(angle) * tall[..., None])[..., None] * u[:, :, None]
    )


def _swelling(size: FloatArray, share: FloatArray, waist: float = WAIST) -> FloatArray:
    """Return a size along the body, shape (M, rings): `size` in the middle of segments, thinner at the joints."""
    at_joints = waist * 0.5 * (np.pad(size, ((0, 0), (1, 0)), "edge") + np.pad(size, ((0, 0), (0, 1)), "edge"))
    bump = np.sin(np.pi * share)
    straight = at_joints[:, :-1, None] * (1.0 - share) + at_joints[:, 1:, None] * share
    inside = straight + bump * (size[:, :, None] - straight)
    return np.concatenate([inside.reshape(len(size), -1), at_joints[:, -1:]], axis=1)


def _carried(director: FloatArray, share: FloatArray) -> FloatArray:
    """Return a director along the body, shape (M, rings, 3): between the joints' averages on a straight line."""
    edge = ((0, 0), (1, 0), (0, 0)), ((0, 0), (0, 1), (0, 0))
    at_joints = np.pad(director, edge[0], "edge") + np.pad(director, edge[1], "edge")
    inside = at_joints[:, :-1, None] * (1.0 - share)[:, None] + at_joints[:, 1:, None] * share[:, None]
    rings = np.concatenate([inside.reshape(len(director), -1, 3), at_joints[:, -1:]], axis=1)
    return np.asarray(rings / np.linalg.norm(rings, axis=2, keepdims=True))


def _vertices(rings: FloatArray) -> FloatArray:
    """Return all vertices, shape (M, V, 3), with the middles of the two caps pushed out a little at the end."""
    first, last = rings[:, :1].mean(axis=2), rings[:, -1:].mean(axis=2)
    second, before = rings[:, 1:2].mean(axis=2), rings[:, -2:-1].mean(axis=2)
    caps = [first + 0.8 * (first - second), last + 0.8 * (last - before)]
    return np.concatenate([rings.reshape(len(rings), -1, 3), *caps], axis=1)


def _normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Return unit normals at the vertices, weighted by the area of the faces around, shape (M, V, 3)."""
    corners = vertices[:, faces]
    of_faces = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    total = np.zeros_like(vertices)
    by_vertex = total.swapaxes(0, 1)
    for k in range(3):
        np.add.at(by_vertex, faces[:, k], of_faces.swapaxes(0, 1))
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=2, keepdims=True), 1e-300))
