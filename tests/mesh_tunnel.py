"""Makes `scenes/mesh_tunnel.stl`, the air of a rough tunnel in rock that winds and rises; run it to write the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

RINGS, SIDES = 38, 24
LENGTH, RADIUS = 3.2, 0.125
"""[m]"""

FILE = Path(__file__).parents[1] / "scenes" / "mesh_tunnel.stl"


def tunnel() -> trimesh.Trimesh:
    """Return the closed surface, its faces looking out of the air into the rock."""
    x = np.linspace(0.0, LENGTH, RINGS + 1)
    bend = np.clip(x - 1.2, 0.0, None)
    centre = np.column_stack([x, 0.12 * bend**2 * (1.5 - 0.5 * bend), 0.06 * bend])
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    rough = 0.05 * np.sin(3.0 * angle + 9.0 * x[:, None]) + 0.04 * np.sin(2.0 * angle - 14.0 * x[:, None])
    radius = RADIUS * (1.0 + rough + 0.05 * np.sin(5.0 * x[:, None]))
    rings = np.zeros((RINGS + 1, SIDES, 3))
    rings[:, :, 1], rings[:, :, 2] = radius * np.sin(angle), -radius * np.cos(angle)
    vertices = np.vstack([(rings + centre[:, None]).reshape(-1, 3), centre[[0, -1]]])
    i, j = (index.ravel() for index in np.meshgrid(np.arange(RINGS), np.arange(SIDES), indexing="ij"))
    after = (j + 1) % SIDES
    a, b, c, d = i * SIDES + j, i * SIDES + after, (i + 1) * SIDES + after, (i + 1) * SIDES + j
    side, following, last = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES, RINGS * SIDES
    first_cap = np.column_stack([np.full(SIDES, len(vertices) - 2), following, side])
    last_cap = np.column_stack([np.full(SIDES, len(vertices) - 1), last + side, last + following])
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d]), first_cap, last_cap])
    solid = trimesh.Trimesh(vertices, faces, process=False)
    return solid if solid.volume > 0.0 else trimesh.Trimesh(vertices, faces[:, ::-1], process=False)


def content() -> bytes:
    """Return the file: a binary STL."""
    data: bytes = tunnel().export(file_type="stl")
    return data


if __name__ == "__main__":
    FILE.write_bytes(content())
