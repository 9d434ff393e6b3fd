"""The worm from the side and from above as a figure, without any browser."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer import colours
from worm3d.viewer.frames import Frames
from worm3d.viewer.pieces import Scales, arrow_length
from worm3d.viewer.skin import Skin
from worm3d.viewer.world import GROUND, WorldMesh

DPI = 100
"""Resolution of a figure [pixel/inch]."""
_LEFT, _RIGHT, _ABOVE, _BETWEEN, _BELOW = 80, 116, 30, 26, 50
"""Margins around the two views [pixel]."""
_BAR = 260
"""Largest length of the colour bar [pixel]."""
_WIDE, _HIGH = 760, 760
"""Largest size of the views together [pixel]."""
_TITLE = 560
"""Smallest width of the figure, so that the title fits [pixel]."""
DULLEST = 0.6
"""Brightness of a surface seen edge-on, relative to a surface that faces the viewer."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A view without perspective: unit vectors (3,) to the right and upwards in the picture, and towards the viewer."""

    right: FloatArray
    up: FloatArray
    near: FloatArray

    @property
    def plane(self) -> FloatArray:
        """Rows that give picture coordinates, shape (2, 3)."""
        return np.array([self.right, self.up])

    def points(self, points: FloatArray) -> FloatArray:
        """Return picture coordinates, shape (..., 2) [m]."""
        return np.asarray(points @ self.plane.T)

    def facing(self, corners: FloatArray) -> FloatArray:
        """Return how much polygons face the viewer: the cosine of the angle to their normals, shape (K,).

        The corners of the polygons, shape (K, C, 3), are anticlockwise seen from the side that the normals point to.
        """
        normal, _ = _unit(np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1))
        return np.asarray(normal @ self.near)

    def arrows(self, start: FloatArray, vector: FloatArray, wide: float) -> FloatArray:
        """Return the outlines of arrows from places (A, 3), with heads of width `wide`, shape (A, 7, 2) [m]."""
        a, v = self.points(start), self.points(vector)
        along, size = _unit(v)
        head = np.minimum(1.6 * wide, 0.5 * size)
        half = 0.5 * np.minimum(wide, size)
        across, neck, tip = _turned(along), a + v - head * along, a + v
        thin, broad = 0.35 * half * across, half * across
        return np.stack([a - thin, neck - thin, neck - broad, tip, neck + broad, neck + thin, a + thin], axis=1)

    def cut(self, vertices: FloatArray, faces: NDArray[np.int64], through: FloatArray) -> FloatArray:
        """Return the section of a mesh with the plane of the picture through a point, as lines, shape (S, 2, 2) [m]."""
        height = (vertices - through) @ self.near
        above = height[faces] >= 0.0
        crossed = above.any(axis=1) & ~above.all(axis=1)
        corners, above, height = vertices[faces[crossed]], above[crossed], height[faces[crossed]]
        # The corner that is alone on one side of the plane.
        alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        rows = np.arange(len(alone))
        ends = []
        for step in (1, 2):
            other = (alone + step) % 3
            a, b = height[rows, alone], height[rows, other]
            share = (a / (a - b))[:, None]
            ends.append(self.points(corners[rows, alone] * (1.0 - share) + corners[rows, other] * share))
        return np.stack(ends, axis=1)


def _unit(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors and lengths, shape (..., 1); a zero vector has no direction."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(size, 1e-300)), size


def _turned(vectors: FloatArray) -> FloatArray:
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


class Stage:
    """Side and top view of a worm, ready to be drawn at any instant.

    The views show the whole run, or follow the worm with three body lengths (one and a half across); both views have
    the same scale. `axes` are the axes of the side view and of the top view.
    """

    def __init__(self, frames: Frames) -> None:
        self.frames = frames
        self.scales = Scales.of(frames)
        self._skin = Skin.of(frames, self.scales.strain)
        self._panels = 0, *self._skin.panels(0)
        self._speed = frames.speed
        self._window = np.subtract(*frames.speed_window[::-1])
        ahead, left, up = frames.axes
        low, high = frames.extent
        size = frames.body_length
        most = size * np.array([3.0, 1.5, 1.5])
        self._span = np.minimum(high - low, most) + 0.2 * size
        self._middle, self._follows = 0.5 * (low + high), high - low > most
        self._views = [Projection(ahead, up, -left), Projection(ahead, left, up)]
        self.figure, self.axes = self._frame()
        self._pictures = [_View(self, view, axes) for view, axes in zip(self._views, self.axes, strict=True)]
        self._title = self.axes[0].set_title("", fontsize=9, loc="left")

    def _frame(self) -> tuple[Figure, tuple[Axes, Axes]]:
        """Return a figure whose views have the same scale, with an even size for MP4."""
        long, wide, high = self._span
        scale = min(_WIDE / long, _HIGH / (wide + high))
        width = 2 * round(max(scale * long + _LEFT + _RIGHT, _TITLE) / 2)
        height = 2 * round((scale * (wide + high) + _ABOVE + _BETWEEN + _BELOW) / 2)
        figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
        FigureCanvasAgg(figure)
        top = figure.add_axes((_LEFT / width, _BELOW / height, scale * long / width, scale * wide / height))
        bottom = (_BELOW + scale * wide + _BETWEEN) / height
        side = figure.add_axes((_LEFT / width, bottom, scale * long / width, scale * high / height))
        self._label(side, top)
        tall, left = min(_BAR, height - _BELOW - _ABOVE), _LEFT + scale * long + 22
        bar = figure.add_axes((left / width, 1.0 - (_ABOVE + tall) / height, 12 / width, tall / height))
        limit = self.scales.strain
        ramp = LinearSegmentedColormap.from_list(
            "strain", [colours.SHORT_CHAMBER, colours.RESTING_CHAMBER, colours.LONG_CHAMBER]
        )
        mapped = ScalarMappable(Normalize(-100.0 * limit, 100.0 * limit), ramp)
        figure.colorbar(mapped, cax=bar).set_label("chamber strain [%]", fontsize=9)
        return figure, (side, top)

    def _label(self, side: Axes, top: Axes) -> None:
        straight = abs(self.frames.heading[0] - 1.0) < 1e-6
        side.set_ylabel("z [m]")
        side.tick_params(labelbottom=False)
        top.set_xlabel("x [m]" if straight else "along the first heading [m]")
        top.set_ylabel("y [m]" if straight else "to its left [m]")
        for axes in (side, top):
            axes.locator_params(axis="y", nbins=4)

    def draw(self, index: int) -> Figure:
        """Draw the frame `index` and return the figure."""
        if not -len(self.frames) <= index < len(self.frames):
            raise IndexError(f"frame: got {index}, must be in [0, {len(self.frames) - 1}]")
        index %= len(self.frames)
        step = 0.5 * self.frames.body_length  # in between the axes do not move
        here = step * np.round(self.frames.axes @ self.frames.centre[index] / step)
        middle = np.where(self._follows, here, self._middle)
        low, high = middle - 0.5 * self._span, middle + 0.5 * self._span
        for axes, row in zip(self.axes, (2, 1), strict=True):
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[row], high[row])
        for picture in self._pictures:
            picture.draw(index)
        self._title.set_text(self._text(index))
        return self.figure

    @property
    def view(self) -> tuple[float, ...]:
        """Limits of the axes; the limits change if the views follow the worm."""
        return tuple(limit for axes in self.axes for limit in (*axes.get_xlim(), *axes.get_ylim()))

    @property
    def artists(self) -> list[Artist]:
        """Artists that differ between frames, in drawing order."""
        return [self._title, *(artist for picture in self._pictures for artist in picture.artists)]

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Temporarily leave the artists that differ between frames out of the figure."""
        for artist in self.artists:
            artist.set_animated(True)
        try:
            yield
        finally:
            for artist in self.artists:
                artist.set_animated(False)

    def _text(self, index: int) -> str:
        text = f"t = {self.frames.time[index]:.2f} s"
        if self._speed is not None:
            text += f"   mean speed {self._speed[index]:.3g} m/s over {self._window[index]:.3g} s"
        if self.frames.contact_force is not None:
            text += f"   an arrow of {arrow_length(self.frames.body_length):.3g} m is {self.scales.force:.3g} N"
        return text

    def outlines(self, view: Projection, index: int) -> tuple[FloatArray, FloatArray]:
        """Return parts of the skin that face the viewer, the farthest first, (K, 4, 2), and their colours, (K, 3)."""
        if self._panels[0] != index:
            self._panels = index, *self._skin.panels(index)
        _, panels, paint = self._panels
        facing, depth = view.facing(panels), panels.mean(axis=1) @ view.near
        seen = np.flatnonzero(facing > 0.0)
        order = seen[np.argsort(depth[seen], kind="stable")]
        bright = DULLEST + (1.0 - DULLEST) * facing[order, None]
        return view.points(panels[order]), bright * paint[order]


class _View:
    """One of the two views, with the artists."""

    def __init__(self, stage: Stage, view: Projection, axes: Axes) -> None:
        self._stage, self._view, self._axes = stage, view, axes
        frames = stage.frames
        axes.set_aspect("equal", adjustable="box")
        # A transparent mesh is a wall; an opaque mesh is ground, and the side view is filled below the ground.
        self._grounds = [mesh for mesh in frames.world if mesh.opacity == 1.0]
        self._ground = PolyCollection([], facecolors=[GROUND], lw=0.0, antialiaseds=False)
        if self._grounds and view.up[2] == 0.0:
            axes.set_facecolor((*GROUND, 0.35))
        self._world = LineCollection([], colors="0.45", lw=1.5)
        if frames.path is not None:
            axes.plot(
                *view.points(frames.path).T, color=colours.REFERENCE_PATH, lw=1.2, ls="--", scalex=False, scaley=False
            )
        self._trail = axes.plot([], [], color=colours.TRAIL, lw=1.2)[0]
        self._worm: Any = PolyCollection([], lw=0.4, edgecolors="face")  # takes arrays, although the type hints do not
        self._forces = PolyCollection([], facecolors=[colours.FORCE_ARROW], lw=0.0)
        for collection in (self._ground, self._world, self._worm, self._forces):
            axes.add_collection(collection, autolim=False)
        self._anchors = axes.plot([], [], "o", color=colours.ANCHOR, ms=4.0)[0]
        self._horizon = axes.plot([], [], ".", color=colours.HORIZON, ms=5.0)[0]
        self.artists: list[Artist] = [
            self._ground,
            self._world,
            self._trail,
            self._worm,
            self._forces,
            self._anchors,
            self._horizon,
        ]
        for above, artist in enumerate(self.artists):
            artist.set_zorder(2.0 + 0.1 * above)

    def draw(self, index: int) -> None:
        frames, view = self._stage.frames, self._view
        shapes, paint = self._stage.outlines(view, index)
        self._worm.set_verts(shapes)
        self._worm.set_facecolor(paint)
        self._world.set_segments(self._cuts(frames.world, index))
        if view.up[2] > 0.0:
            self._ground.set_verts([_down(line, self._axes.get_ylim()[0]) for line in self._cuts(self._grounds, index)])
        if frames.way is not None:
            self._trail.set_data(*view.points(frames.way[: index + 1]).T)
        if frames.horizon is not None:
            self._horizon.set_data(*view.points(frames.horizon[index]).T)
        if frames.anchored is not None:
            self._anchors.set_data(*view.points(frames.contacts[index][frames.anchored[index]]).T)
        if frames.contact_force is not None:
            self._draw_forces(frames.contacts[index].reshape(-1, 3), frames.contact_force[index].reshape(-1, 3))

    def _cuts(self, meshes: Iterable[WorldMesh], index: int) -> list[FloatArray]:
        """Return sections of meshes with the picture's plane through the centre of mass, as lines of shape (2, 2)."""
        through = self._stage.frames.centre[index]
        return [line for mesh in meshes for line in self._view.cut(mesh.vertices, mesh.faces, through)]

    def _draw_forces(self, places: FloatArray, force: FloatArray) -> None:
        size = self._stage.frames.body_length
        vector = arrow_length(size) / self._stage.scales.force * force
        seen = np.linalg.norm(vector, axis=1) > 1e-3 * size
        self._forces.set_verts(list(self._view.arrows(places[seen], vector[seen], 0.025 * size)))


def _down(line: FloatArray, bottom: float) -> FloatArray:
    """Return the area between a line and the bottom of the picture, shape (4, 2)."""
    (x, _), (other_x, _) = line
    return np.array([*line, [other_x, bottom], [x, bottom]])


def figure(frames: Frames, index: int = 0) -> tuple[Figure, tuple[Axes, Axes]]:
    """Return a figure of frame `index`, and the axes of the side view and of the top view."""
    stage = Stage(frames)
    return stage.draw(index), stage.axes


def write_png(frames: Frames, path: str | Path, index: int = 0) -> tuple[Figure, tuple[Axes, Axes]]:
    """Write frame `index` as a PNG file and return the figure and its axes.

    Raises
    ------
    ValueError
        The file name does not end in .png.
    IndexError
        No such frame.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"picture file: got {Path(path).name!r}, the ending must be .png")
    drawn, axes = figure(frames, index)
    drawn.savefig(path, dpi=1.5 * DPI)
    return drawn, axes
