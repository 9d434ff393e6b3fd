"""A smooth skin around the worm. It passes through apexes and end faces, and touches the same surfaces as the worm.

There is a cross-section at each joint and in the middle of each segment. Six points define a section, in the order of
the apexes: below, above and outward on the left, then the same on the right. With P = (below + above)/2,
U = (above - below)/2 and D = outward - P, each half of the outline of a section is

    P + cos(a) D + sin(a) U,   -pi/2 <= a <= pi/2

and straight lines join the halves. Along the worm, each point of the outline follows a uniform Catmull-Rom spline
through the sections. A vertex is therefore a weighted sum of the points of four sections, with the constant weights
`RING_WEIGHTS` and `CORNER_WEIGHTS`. A page receives the sections and the weights, and does not repeat the formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer import colours
from worm3d.viewer.frames import Frames
from worm3d.viewer.piece import Piece
from worm3d.viewer.shapes import Mesh, cap_faces, wall_faces

RINGS = 6
"""Number of rings of vertices from a section to the next section."""
RING_CORNERS = 28
"""Number of vertices of a ring, 14 in each half."""
PANEL_SIDES = [*(_HALF := [0, 2, 4, 6, 7, 9, 11, 13]), *(corner + RING_CORNERS // 2 for corner in _HALF)]
"""Indices of the vertices of a ring that a coarser skin uses. They include the vertices at apexes."""


def _along() -> FloatArray:
    """Return the weights of four sections for the rings from the second to before the third, shape (RINGS, 4)."""
    s = np.arange(RINGS) / RINGS
    cubic = [-(s**3) + 2 * s**2 - s, 3 * s**3 - 5 * s**2 + 2, -3 * s**3 + 4 * s**2 + s, s**3 - s**2]
    return np.stack(cubic, axis=1) / 2.0


def _around() -> FloatArray:
    """Return the weights of a section's six points for the vertices of the outline, and for its middle.

    The shape is (RING_CORNERS + 1, 6).
    """
    angle = np.pi * (np.arange(RING_CORNERS // 2) / (RING_CORNERS // 2 - 1) - 0.5)
    cos, sin = np.cos(angle), np.sin(angle)
    half = np.stack([0.5 - 0.5 * sin - 0.5 * cos, 0.5 + 0.5 * sin - 0.5 * cos, cos], axis=1)
    none = np.zeros_like(half)
    middle = [[0.25, 0.25, 0.0, 0.25, 0.25, 0.0]]
    return np.concatenate([np.hstack([half, none]), np.hstack([none, half[::-1]]), middle])


RING_WEIGHTS, CORNER_WEIGHTS = _along(), _around()
LEFT_COLOUR_SHARE = np.append(np.repeat([1.0, 0.0], RING_CORNERS // 2), 0.5)
"""Share of the left chamber's colour at each vertex of an outline, and in its middle."""


@dataclass(frozen=True, eq=False)
class Skin:
    """The skin at T instants, as S sections and their colours. The first and the last section are the worm's ends."""

    sections: FloatArray
    """Points of the sections, shape (T, S+2, 6, 3) [m]. There is an additional section beyond each end, which only sets
    the direction of the spline at the end."""
    tint: FloatArray
    """Colours of the left and the right side of the sections, shape (T, S+2, 2, 3)."""
    end_faces: bool
    """Whether the ends of the skin are end faces with contact points."""

    @classmethod
    def of(cls, frames: Frames, strain_limit: float) -> Skin:
        """Return the skin of a worm. Colours have their full intensity at the strain `strain_limit`."""
        tint = colours.strain_colour(frames.chamber_strain, strain_limit)
        ends = tint[:, :1], tint[:, -1:]
        # Darker joints set the segments apart.
        between = np.concatenate([ends[0], 0.425 * (tint[:, 1:] + tint[:, :-1]), ends[1]], axis=1)
        return cls(
            _extended(_alternating(_at_joints(frames), frames.apexes)),
            _extended(_alternating(between, tint)),
            frames.face_radius is not None,
        )

    @property
    def faces(self) -> NDArray[np.int64]:
        """Triangles as rows of the vertices, the same at all instants, shape (F, 3)."""
        rings = RINGS * (self.sections.shape[1] - 3) + 1
        return np.vstack([wall_faces(rings, RING_CORNERS), cap_faces(rings, RING_CORNERS)])

    def vertices(self, frame: int) -> FloatArray:
        """Return the vertices at an instant, shape (V, 3) [m].

        They are the rings from the tail to the head, and then the middles of both ends.
        """
        return _spline(np.einsum("ca,sax->scx", CORNER_WEIGHTS, self.sections[frame]))

    def paint(self, frame: int) -> FloatArray:
        """Return the colours of the vertices at an instant, shape (V, 3)."""
        left, right = self.tint[frame, :, 0], self.tint[frame, :, 1]
        outlines = LEFT_COLOUR_SHARE[:, None] * left[:, None] + (1.0 - LEFT_COLOUR_SHARE)[:, None] * right[:, None]
        return np.asarray(np.clip(_spline(outlines), 0.0, 1.0))

    def panels(self, frame: int) -> tuple[FloatArray, FloatArray]:
        """Return a coarser skin for a drawing, as P quadrilaterals.

        The corners, shape (P, 4, 3), are anticlockwise seen from outside. The colours have the shape (P, 3).
        """
        places, colour = (
            values[:-2].reshape(-1, RING_CORNERS, 3)[::3, PANEL_SIDES]
            for values in (self.vertices(frame), self.paint(frame))
        )
        ends = np.concatenate([_fan(places[0, ::-1]), _fan(places[-1])])
        paint = np.array(colours.FACE) if self.end_faces else colour[0].mean(axis=0)
        panels = _quads(colour).mean(axis=1)
        return np.concatenate([_quads(places), ends]), np.concatenate([panels, np.tile(paint, (len(ends), 1))])

    def piece(self, frame: int = 0) -> Piece:
        """Return the skin at an instant as a piece of the scene."""
        mesh = Mesh(self.vertices(frame), self.faces)
        return Piece(path="skin/skin", mesh=mesh, colour=colours.SKIN, paint=self.paint(frame))


def _at_joints(frames: Frames) -> FloatArray:
    """Return the sections at the joints, shape (T, N+1, 6, 3) [m]. They are thinner than the segments."""
    joints = frames.joints
    middles = 0.5 * (joints[:, 1:] + joints[:, :-1])
    across = (frames.apexes - middles[:, :, None]).reshape(*frames.directors.shape[:2], 2, 3, 3)
    centre = 0.5 * (across[:, :, :, :1] + across[:, :, :, 1:2])
    # At a joint the worm is thinner, and its chambers are closer together. Only the joint itself has a contact point.
    thin = (0.68 * (across - centre) + 0.9 * centre).reshape(frames.apexes.shape)
    between = np.concatenate([thin[:, :1], 0.5 * (thin[:, 1:] + thin[:, :-1]), thin[:, -1:]], axis=1)
    if frames.face_radius is not None:
        between[:, [0, -1]] = frames.face_radius[:, None, None] * _discs(frames)
    return np.asarray(joints[:, :, None] + between)


def _discs(frames: Frames) -> FloatArray:
    """Return the six points of sections that are discs of radius 1 at both ends of the worm, shape (T, 2, 6, 3)."""
    d = frames.directors[:, [0, -1]]
    along = np.diff(frames.joints, axis=1)[:, [0, -1]]
    u = np.cross(along, d)
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    return np.stack([-u, u, d, -u, u, -d], axis=2)


def _alternating(at_joints: FloatArray, at_middles: FloatArray) -> FloatArray:
    """Return N+1 and N values along the second axis, in alternating order along the worm."""
    result = np.empty((len(at_joints), at_joints.shape[1] + at_middles.shape[1], *at_joints.shape[2:]))
    result[:, 0::2], result[:, 1::2] = at_joints, at_middles
    return result


def _extended(values: FloatArray) -> FloatArray:
    """Return values with an additional, linearly extrapolated value at each end of the second axis."""
    first, last = 2.0 * values[:, :1] - values[:, 1:2], 2.0 * values[:, -1:] - values[:, -2:-1]
    return np.concatenate([first, values, last], axis=1)


def _fan(ring: FloatArray) -> FloatArray:
    """Return quadrilaterals that fill a ring of C corners, shape (C/2, 4, 3).

    Each quadrilateral has the middle of the ring and three successive corners.
    """
    middle = np.broadcast_to(ring.mean(axis=0), (len(ring) // 2, 3))
    return np.stack([middle, ring[0::2], ring[1::2], np.roll(ring, -2, axis=0)[0::2]], axis=1)


def _quads(rings: FloatArray) -> FloatArray:
    """Return the quadrilaterals between successive rings of shape (R, C, 3). The result has the shape (K, 4, 3)."""
    after = np.roll(rings, -1, axis=1)
    return np.stack([rings[:-1], after[:-1], after[1:], rings[1:]], axis=2).reshape(-1, 4, 3)


def _spline(outlines: FloatArray) -> FloatArray:
    """Return the vertices of the skin, shape (V, 3), from the outlines of the sections.

    The outlines, with their middles, have the shape (S+2, RING_CORNERS + 1, 3). The middles of the ends are the last
    two vertices.
    """
    count = len(outlines) - 3
    windows = np.stack([outlines[k : k + count] for k in range(4)])
    inside = np.einsum("rk,kscx->srcx", RING_WEIGHTS, windows[:, :, :RING_CORNERS]).reshape(-1, 3)
    return np.concatenate([inside, outlines[-2, :RING_CORNERS], outlines[[1, -2], RING_CORNERS]])
