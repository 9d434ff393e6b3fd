"""The worm, the contact forces and the paths as pieces of a scene. Sizes are proportional to the body length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer import colours, piece, shapes
from worm3d.viewer.body import Bars, Body
from worm3d.viewer.frames import Frames
from worm3d.viewer.piece import HIDDEN, Group, Piece
from worm3d.viewer.shapes import Mesh, tube
from worm3d.viewer.world import GROUND, Colour, WorldMesh

LAYERS: dict[str, tuple[str, Colour]] = {
    "skin": ("skin", colours.SKIN),
    "faces": ("end faces", colours.FACE),
    "chambers": ("chambers", colours.RESTING_CHAMBER),
    "links": ("links", colours.LINK),
    "forces": ("contact forces", colours.FORCE_ARROW),
    "anchors": ("anchored", colours.ANCHOR),
    "trail": ("trail (centre of mass)", colours.TRAIL),
    "path": ("path to keep to", colours.REFERENCE_PATH),
    "horizon": ("horizon", colours.HORIZON),
    "world": ("world", GROUND),
}
"""Displayed name and colour of each layer, by the name of the layer in the paths of pieces."""

ON_TOP = ("forces", "anchors", "horizon")
"""Layers whose pieces are visible through everything else."""

ARROW = 0.2
"""Approximate length of the arrow for the force `Scales.force`, in body lengths. The exact length is 1, 2 or 5 times a
power of ten [m]."""
TRAIL_SIDES = 6
"""Number of corners of the cross-section of the trail."""


@dataclass(frozen=True)
class Scales:
    """Scales of colours and force arrows."""

    strain: float = 0.45
    """Strain of a chamber whose colour has full intensity."""
    force: float = 0.2
    """Force that is drawn as an arrow of the length `arrow_length` [N]."""

    @classmethod
    def of(cls, frames: Frames) -> Scales:
        """Return scales for all frames. The strain is the largest strain, and the force exceeds 98 % of the forces."""
        return cls(colours.strain_limit(frames.chamber_strain), _round_force(frames.contact_force))


def _round_force(force: FloatArray | None) -> float:
    size = np.zeros(0) if force is None else np.linalg.norm(force, axis=-1).ravel()
    size = size[size > 0.0]
    if not size.size:
        return 1.0
    return rounded_up(float(np.quantile(size, 0.98)))


def arrow_length(body_length: float) -> float:
    """Return the length of the arrow for the force `Scales.force` [m]."""
    return rounded_up(0.9 * ARROW * body_length)


def rounded_up(value: float) -> float:
    """Return the smallest number that is 1, 2 or 5 times a power of ten and not below a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= 0.999 * value))


def worm(frames: Frames, scales: Scales) -> list[Piece]:
    """Return the pieces of the worm: links if there are any, chambers and end faces."""
    return [each for of in _worm(frames, scales) for each in of.pieces()]


def contact(frames: Frames, scales: Scales) -> list[Piece]:
    """Return contact forces as arrows, and sticking contact points as dots."""
    return [each for of in _contact(frames, scales) for each in of.pieces()]


def moving(frames: Frames, scales: Scales) -> list[Group]:
    """Return the pieces of `worm` and `contact` in groups, which take less time to make."""
    return [*_worm(frames, scales), *_contact(frames, scales)]


def group(layer: str, meshes: Mapping[str, Mesh], **poses: FloatArray) -> Group:
    """Return the pieces of a layer with the look of the layer, as `Group` describes."""
    return Group(layer=layer, meshes=meshes, colour=LAYERS[layer][1], on_top=layer in ON_TOP, poses=poses)


def _worm(frames: Frames, scales: Scales) -> Iterator[Group]:
    body, linked = Body.of(frames), frames.chamber_length is None
    if linked:
        yield _links(body.links(frames), 0.055 * float(body.height[0].mean()))
    # With 0.71 times the half-diagonals of a rhombus, the ellipsoid touches the links.
    yield _chambers(body, frames.chamber_strain, scales, 0.74 if linked else 1.0)
    if frames.face_radius is not None:
        yield _faces(frames.face_radius, frames.joints, body)


def _links(bars: Bars, thick: float) -> Group:
    middle, turn = 0.5 * (bars.start + bars.end), piece.y_onto(bars.end - bars.start, bars.normal)
    meshes = {
        name: shapes.capsule(length, 1.6 * thick if name.endswith("joint") else thick)
        for name, length in zip(bars.names, bars.length.tolist(), strict=True)
    }
    return group("links", meshes, position=middle, turn=turn)


def _chambers(body: Body, strain: FloatArray, scales: Scales, size: float) -> Group:
    """Return an ellipsoid for each chamber, with its axis y along the segment, x to the left and z down.

    The semi-axes are `size` times the half-height and half of the length of the chamber.
    """
    count, segments = strain.shape[:2]
    meshes = dict.fromkeys((f"{i:02d}-{side}" for i in range(segments) for side in "LR"), shapes.ball())
    half = size * np.stack([body.height, 0.5 * body.length, body.height], axis=-1)
    return group(
        "chambers",
        meshes,
        position=body.centre.reshape(count, -1, 3),
        turn=np.repeat(np.stack([body.d, body.t, -body.u], axis=-1), 2, axis=1),
        scale=half.reshape(count, -1, 3),
        tint=colours.strain_colour(strain, scales.strain).reshape(count, -1, 3),
    )


def _faces(radii: FloatArray, joints: FloatArray, body: Body) -> Group:
    """Return the end faces of the worm as discs."""
    discs = (shapes.disc(radius, 0.05 * radius) for radius in radii.tolist())
    outwards = body.t[:, [0, -1]] * [[-1.0], [1.0]]
    return group(
        "faces",
        dict(zip(("tail", "head"), discs, strict=True)),
        position=joints[:, [0, -1]],
        turn=piece.y_onto(outwards, body.d[:, [0, -1]]),
    )


def _contact(frames: Frames, scales: Scales) -> Iterator[Group]:
    places = frames.contacts.reshape(len(frames), -1, 3)
    if frames.contact_force is not None:
        force = frames.contact_force.reshape(places.shape)
        yield _arrows(places, force, arrow_length(frames.body_length) / scales.force, frames.body_length)
    if frames.anchored is not None:
        sticks = frames.anchored.reshape(places.shape[:2])
        scale = np.where(sticks, 0.014 * frames.body_length, HIDDEN)[..., None] * np.ones(3)
        yield _marks("anchors", shapes.ball(rings=5, sides=8), sticks, position=places, scale=scale)


def _arrows(places: FloatArray, force: FloatArray, metres_per_newton: float, body_length: float) -> Group:
    size = np.linalg.norm(force, axis=2)
    length = np.minimum(metres_per_newton * size, 2.0 * ARROW * body_length)
    seen = length > 1e-3 * body_length
    direction = np.where(seen[..., None], force, [0.0, 0.0, 1.0])
    turn = piece.y_onto(direction, piece.any_normal(direction))
    wide = np.minimum(length, 0.12 * body_length)
    scale = np.where(seen[..., None], np.stack([wide, length, wide], axis=2), HIDDEN)
    return _marks("forces", shapes.arrow(), seen, position=places, turn=turn, scale=scale)


def _marks(layer: str, mesh: Mesh, seen: NDArray[np.bool_], **poses: FloatArray) -> Group:
    """Return marks with the same mesh. Marks that are never visible are left out.

    `seen` says whether each mark is visible in each frame, shape (T, P). If there is only one frame, all marks are
    included.
    """
    shown = np.flatnonzero(seen.any(axis=0) | (len(seen) == 1)).tolist()
    meshes = dict.fromkeys((f"{k:03d}" for k in shown), mesh)
    return group(layer, meshes, **{name: array[:, shown] for name, array in poses.items()})


def way(frames: Frames) -> list[Piece]:
    """Return the trail of the centre of mass, the reference path, and the points of the controller's horizon."""
    pieces = []
    size = frames.body_length
    if frames.way is not None:
        points = frames.way[trail_rings(frames.way, size)[0]]
        if len(points) > 1:
            mesh = tube(points, 0.004 * size, sides=TRAIL_SIDES, capped=False)
            pieces.append(Piece(path="trail/com", mesh=mesh, colour=colours.TRAIL))
    if frames.path is not None:
        pieces.append(Piece(path="path/reference", mesh=tube(frames.path, 0.005 * size), colour=colours.REFERENCE_PATH))
    if frames.horizon is not None:
        ball = shapes.ball(rings=5, sides=8)
        mesh = Mesh(0.009 * size * ball.vertices, ball.faces)
        everywhere = np.ones(frames.horizon.shape[:2], dtype=bool)
        pieces += _marks("horizon", mesh, everywhere, position=frames.horizon).pieces()
    return pieces


def trail_rings(com: FloatArray, body_length: float) -> tuple[list[int], list[int]]:
    """Return the frames whose centres of mass are points of the trail, and the number of points passed in each frame.

    Frames with little motion are left out, because a worm at rest would put many rings at the same place.
    """
    kept, passed = [0], []
    for k, place in enumerate(com):
        if float(np.linalg.norm(place - com[kept[-1]])) > 0.005 * body_length:
            kept.append(k)
        passed.append(len(kept))
    return kept, passed


def world(meshes: tuple[WorldMesh, ...]) -> list[Piece]:
    """Return the meshes of the world as pieces."""
    return [
        Piece(
            path=f"world/{k:02d}-{mesh.name.replace('/', '-') or 'mesh'}",
            mesh=Mesh(mesh.vertices, mesh.faces),
            colour=mesh.colour,
            opacity=mesh.opacity,
        )
        for k, mesh in enumerate(meshes)
    ]
