"""Drawing of four worlds in section: signed distance of a point and normal of the surface, from the program."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import ANCHOR, DRAWN_GROUND, FORCE, LINK, PALE, arrow, drawing, label, letter, sketch
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba

import scenes
from worm3d import Centreline, Heightfield, Mesh, Pipe, Plane
from worm3d.values.arrays import FloatArray
from worm3d.worlds import World

DRAWN_SIZE = 0.5
"""Width of the part of a world that is drawn [m]."""
LEVELS = 0.025
"""Distance between two lines of equal distance [m]."""


def main(folder: Path) -> None:
    """Write drawings/worlds.svg."""
    field, mesh = (
        _hills(),
        Mesh(Path(scenes.__file__).parent / "mesh_tunnel.stl", units="m", solid="outside", cell=0.015),
    )
    line = Centreline.through([(-0.5, 0.0, -0.12), (0.0, 0.0, 0.0), (0.5, 0.0, -0.12)])
    places: list[tuple[str, World, FloatArray, FloatArray]] = [
        ("plane with a slope", Plane(slope=0.2), np.array([0.0, 0.0, 0.05]), np.array([0.04, 0.0, 0.13])),
        ("pipe with a bend", Pipe(line, radius=0.12), np.zeros(3), np.array([0.06, 0.0, -0.06])),
        ("heightfield", field, np.array([1.0, 0.6, 0.05]), np.array([1.08, 0.6, 0.12])),
        ("mesh of a tunnel", mesh, np.array([0.6, 0.0, 0.0]), np.array([0.64, 0.0, -0.05])),
    ]
    with drawing(folder, "worlds", 5.4) as figure:
        panels = figure.subplots(2, 2)
        figure.subplots_adjust(left=0.01, right=0.99, top=0.95, bottom=0.01, wspace=0.04, hspace=0.14)
        for axes, name, place in zip(panels.flat, "ABCD", places, strict=True):
            _world(axes, *place)
            letter(axes, name)


def _hills() -> Heightfield:
    x, y = np.meshgrid(np.arange(41) * 0.05, np.arange(25) * 0.05, indexing="ij")
    return Heightfield(0.045 * np.sin(14.0 * x) + 0.012 * np.cos(31.0 * x + 5.0 * y), 0.05)


def _world(axes: Axes, title: str, world: World, middle: FloatArray, point: FloatArray) -> None:
    """Draw a vertical section along x: the solid, lines of equal distance, and the distance of a point."""
    sketch(
        axes, title, (middle[0] - DRAWN_SIZE / 2.0, middle[0] + DRAWN_SIZE / 2.0), (middle[2] - 0.16, middle[2] + 0.16)
    )
    x, z = np.linspace(*axes.get_xlim(), 240), np.linspace(*axes.get_ylim(), 160)
    at = np.stack(np.broadcast_arrays(x[None, :], point[1], z[:, None]), axis=-1)
    distance = world.distance(at)
    axes.contourf(x, z, distance, levels=[-9.0, 0.0], colors=[DRAWN_GROUND])
    levels = LEVELS * np.arange(1.0, 5.0)
    axes.contour(x, z, distance, levels=levels, colors=[to_rgba(PALE, 0.55)], linewidths=0.9)
    axes.contour(x, z, distance, levels=[0.0], colors=[LINK], linewidths=2.0)
    _point(axes, world, point)


def _point(axes: Axes, world: World, point: FloatArray) -> None:
    """Draw the distance of a point from its foot on the surface, and the normal there."""
    g, n = float(world.distance(point)), world.normal(point, DRAWN_SIZE)
    foot = point - g * n
    ends = np.array([foot, point])[:, [0, 2]]
    axes.plot(*ends.T, color=FORCE, lw=2.0, zorder=5)
    axes.plot(*ends[1], "o", color=FORCE, ms=6, zorder=8)
    arrow(axes, ends[0], ends[0] + 0.045 * n[[0, 2]], ANCHOR, 2.6)
    side = np.array([n[2], -n[0]])
    label(axes, ends[1] + 0.022 * n[[0, 2]], "$X$", color=FORCE, fontsize=12)
    label(axes, ends.mean(axis=0) + 0.018 * side + 0.012 * n[[0, 2]], "$g$", color=FORCE, fontsize=12)
    label(axes, ends[0] + 0.035 * n[[0, 2]] - 0.02 * side, "$n$", color=ANCHOR, fontsize=12)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
