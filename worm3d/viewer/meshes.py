"""The worm and its world at an instant as trimesh meshes, and as a GLB file for other programs."""

from __future__ import annotations

from typing import cast

import numpy as np
import trimesh
from trimesh.visual.color import ColorVisuals
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from worm3d.viewer import pieces
from worm3d.viewer.frames import Frames
from worm3d.viewer.piece import HIDDEN, Piece
from worm3d.viewer.pieces import Scales
from worm3d.viewer.skin import Skin

# glTF has y up.
_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def scene(frames: Frames, index: int = 0) -> trimesh.Scene:
    """Return the worm and its surroundings in frame `index`, with a name for each piece, and z up [m].

    The skin, with the name "skin/skin", covers chambers and links. Hide the skin to see them.
    """
    shown, scales = frames.take([index]), Scales.of(frames)
    skin = Skin.of(shown, scales.strain).piece()
    still = [skin, *pieces.worm(shown, scales), *pieces.contact(shown, scales), *pieces.world(frames.world)]
    until = frames.take(range(index % len(frames) + 1))
    result = trimesh.Scene()
    for piece, frame in [*((piece, 0) for piece in still), *((piece, -1) for piece in pieces.way(until))]:
        if piece.scale is None or float(piece.scale[frame].max()) > HIDDEN:
            where = piece.matrix(frame)
            result.add_geometry(_coloured(piece), node_name=piece.path, geom_name=piece.path, transform=where)
    return result


def glb(frames: Frames, index: int) -> bytes:
    """Return the scene of frame `index` as a binary glTF file, with y up as the format requires."""
    shown = scene(frames, index)
    shown.apply_transform(_Y_UP)  # type: ignore[no-untyped-call]
    return cast(bytes, shown.export(file_type="glb"))  # type: ignore[no-untyped-call]


def _coloured(piece: Piece) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(piece.mesh.vertices, piece.mesh.faces, process=False)
    if piece.paint is not None:
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.round(255.0 * piece.paint).astype(np.uint8))
        return mesh
    material = PBRMaterial(  # type: ignore[no-untyped-call]
        baseColorFactor=[*piece.colour_at(0), piece.opacity],
        alphaMode="BLEND" if piece.opacity < 1.0 else "OPAQUE",
        metallicFactor=0.0,
        roughnessFactor=0.8,
        doubleSided=True,
    )
    mesh.visual = TextureVisuals(material=material)  # type: ignore[no-untyped-call]
    return mesh
