"""Figure of a worm, seen from the side and from above, drawn with Matplotlib (no browser is needed)."""

from __future__ import annotations

from dataclasses import dataclass
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
from worm3d.viewer.world import GROUND

DPI = 100
"""Resolution of a figure [pixels per inch]."""
LARGEST = 760
"""Maximum width of a view, and maximum sum of the heights of both views [pixels]."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A view without perspective, given by three orthogonal unit vectors of shape (3,).

    In the picture, `right` points to the right and `up` upwards; `near` points towards the viewer.
    """

    right: FloatArray
    up: FloatArray
    near: FloatArray

    @property
    def plane(self) -> FloatArray:
        """Matrix that maps a point to its picture coordinates, shape (2, 3)."""
        return np.array([self.right, self.up])

    def points(self, points: FloatArray) -> FloatArray:
        """Return the picture coordinates of points of shape (..., 3), shape (..., 2) [m]."""
        return np.asarray(points @ self.plane.T)

    def facing(self, corners: FloatArray) -> FloatArray:
        """Return the cosine of the angle between each polygon's normal and the direction to the viewer, shape (K,).

        The cosine is positive if the polygon faces the viewer. The corners, shape (K, C, 3), are in anticlockwise order
        seen from the side to which the normal points.
        """
        normal = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
        size = np.linalg.norm(normal, axis=1)
        return np.asarray(normal @ self.near / np.maximum(size, 1e-300))

    def seen(self, panels: FloatArray, paint: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the panels that face the viewer, and their colours.

        Parameters
        ----------
        panels : ndarray, shape (P, 4, 3)
            Corners of all panels.
        paint : ndarray, shape (P, 3)
            Colours of all panels.

        Returns
        -------
        corners : ndarray, shape (K, 4, 2)
            Picture coordinates of the K panels that face the viewer, the farthest panel first.
        colours : ndarray, shape (K, 3)
            Their colours, darker if a panel is seen at an angle.
        """
        facing, depth = self.facing(panels), panels.mean(axis=1) @ self.near
        front = np.flatnonzero(facing > 0.0)
        order = front[np.argsort(depth[front], kind="stable")]
        bright = 0.6 + 0.4 * facing[order, None]
        return self.points(panels[order]), bright * paint[order]

    def cut(self, vertices: FloatArray, faces: NDArray[np.int64], through: FloatArray) -> FloatArray:
        """Return the section of a mesh, as S straight lines in picture coordinates, shape (S, 2, 2) [m].

        The plane of the section is parallel to the picture and contains the point `through`.
        """
        height, after = (vertices - through) @ self.near, np.roll(faces, -1, axis=1)
        crossed = (height[faces] >= 0.0) != (height[after] >= 0.0)  # the plane crosses two edges of a face, or none
        a, b = faces[crossed], after[crossed]
        share = height[a] / (height[a] - height[b])
        places = vertices[a] + share[:, None] * (vertices[b] - vertices[a])
        return self.points(places).reshape(-1, 2, 2)


class Stage:
    """Side view and top view of a worm, which can be drawn at any instant.

    If the run fits into three body lengths along the heading (and one and a half across), the views show all of the
    run. Otherwise they show a part of this size that follows the worm. With `follows`, they always do. Both views have
    the same scale. `axes` contains the Matplotlib axes of the side view and of the top view.
    """

    def __init__(self, frames: Frames, *, follows: bool = False) -> None:
        self.scales = Scales.of(frames)
        self.show(frames)
        ahead, left, up = frames.axes
        low, high = frames.extent
        size = frames.body_length
        most = size * np.array([3.0, 1.5, 1.5])
        self._follows = (high - low > most) | follows
        self._span = np.where(self._follows, most, high - low) + 0.2 * size
        self._middle = 0.5 * (low + high)
        self._views = [Projection(ahead, up, -left), Projection(ahead, left, up)]
        self.figure, self.axes = self._frame()

    def show(self, frames: Frames) -> None:
        """Take other frames of the same worm. The views and the scales stay as they are."""
        self.frames, self._skin, self._speed = frames, Skin.of(frames, self.scales.strain), frames.speed
        self._window = np.subtract(*frames.speed_window[::-1])

    def _frame(self) -> tuple[Figure, tuple[Axes, Axes]]:
        """Return a figure with two views of the same scale, and the axes of both.

        The width and the height in pixels are even numbers, as MP4 requires.
        """
        long, wide, high = self._span
        scale = min(LARGEST / long, LARGEST / (wide + high))
        # The margins have room for labels, and for the title of a narrow picture.
        width, height = max(scale * long + 200.0, 560.0), scale * (wide + high) + 110.0
        size = (2 * round(width / 2) / DPI, 2 * round(height / 2) / DPI)
        figure = Figure(figsize=size, dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        side, top = figure.subplots(2, 1, sharex=True, height_ratios=(high, wide))
        self._label(side, top)
        limit = 100.0 * self.scales.strain
        mapped = ScalarMappable(Normalize(-limit, limit), LinearSegmentedColormap.from_list("strain", colours.RAMP))
        figure.colorbar(
            mapped, ax=(side, top), label="chamber strain [%]", anchor=(0.0, 1.0), panchor=False, shrink=0.5
        )
        return figure, (side, top)

    def _label(self, side: Axes, top: Axes) -> None:
        straight = abs(self.frames.heading[0] - 1.0) < 1e-6
        side.set_ylabel("z [m]")
        top.set_xlabel("x [m]" if straight else "along the initial heading [m]")
        top.set_ylabel("y [m]" if straight else "to its left [m]")
        for axes in (side, top):
            axes.locator_params(axis="y", nbins=4)
            axes.set_aspect("equal", adjustable="box", anchor="W")
        if any(mesh.opacity == 1.0 for mesh in self.frames.world):
            top.set_facecolor((*GROUND, 0.35))

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
        panels, paint = self._skin.panels(index)
        for axes, view in zip(self.axes, self._views, strict=True):
            for artist in (*axes.collections, *axes.lines):
                artist.remove()
            self._draw_world(axes, view, index)
            shapes, bright = view.seen(panels, paint)
            axes.add_collection(PolyCollection(list(shapes), facecolors=bright, edgecolors="face", lw=0.4, zorder=3))
            self._draw_marks(axes, view, index)
        self._title = self.axes[0].set_title(self._text(index), fontsize=9, loc="left")
        return self.figure

    @property
    def moving(self) -> list[Artist]:
        """Artists of the latest drawn frame, in drawing order."""
        found = [artist for axes in self.axes for artist in (*axes.collections, *axes.lines)]
        return [self._title, *sorted(found, key=lambda artist: artist.get_zorder())]

    @property
    def limits(self) -> list[tuple[float, float]]:
        """Limits of the axes. They change if the views follow the worm."""
        return [limits for axes in self.axes for limits in (axes.get_xlim(), axes.get_ylim())]

    def _draw_world(self, axes: Axes, view: Projection, index: int) -> None:
        """Draw the path, the trail, and the section of the world through the centre of mass."""
        frames, through = self.frames, self.frames.centre[index]
        cuts = [(mesh, view.cut(mesh.vertices, mesh.faces, through)) for mesh in frames.world]
        if view.up[2] > 0.0:
            # The side view is filled below an opaque mesh, which is ground. A transparent mesh is a wall.
            bottom = axes.get_ylim()[0]
            areas = [_down(line, bottom) for mesh, cut in cuts if mesh.opacity == 1.0 for line in cut]
            axes.add_collection(PolyCollection(areas, facecolors=[GROUND], lw=0.0, antialiaseds=False))
        lines = [line for _, cut in cuts for line in cut]
        axes.add_collection(LineCollection(lines, colors="0.45", lw=1.5))
        if frames.path is not None:
            axes.plot(*view.points(frames.path).T, color=colours.REFERENCE_PATH, lw=1.2, ls="--")
        if frames.way is not None:
            axes.plot(*view.points(frames.way[: index + 1]).T, color=colours.TRAIL, lw=1.2)

    def _draw_marks(self, axes: Axes, view: Projection, index: int) -> None:
        """Draw the contact forces, the contact points that stick, and the horizon of the controller."""
        frames, size = self.frames, self.frames.body_length
        places = frames.contacts[index]
        if frames.contact_force is not None:
            force = arrow_length(size) / self.scales.force * frames.contact_force[index].reshape(-1, 3)
            x, y, along, up = (*view.points(places.reshape(-1, 3)).T, *view.points(force).T)
            style: dict[str, Any] = {"color": colours.FORCE_ARROW, "width": 0.009 * size, "minlength": 0.0, "zorder": 4}
            axes.quiver(x, y, along, up, angles="xy", units="xy", scale_units="xy", scale=1.0, **style)
        if frames.anchored is not None:
            sticking = view.points(places[frames.anchored[index]])
            axes.plot(*sticking.T, "o", color=colours.ANCHOR, ms=4.0, zorder=5)
        if frames.horizon is not None:
            axes.plot(*view.points(frames.horizon[index]).T, ".", color=colours.HORIZON, ms=5.0, zorder=5)

    def _text(self, index: int) -> str:
        text = f"t = {self.frames.time[index]:.2f} s"
        if self._speed is not None:
            text += f"   mean speed {self._speed[index]:.3g} m/s over {self._window[index]:.3g} s"
        if self.frames.contact_force is not None:
            text += f"   an arrow of {arrow_length(self.frames.body_length):.3g} m is {self.scales.force:.3g} N"
        return text


def _down(line: FloatArray, bottom: float) -> FloatArray:
    """Return the corners of the area between a line and the bottom of the picture, shape (4, 2)."""
    (x, _), (other_x, _) = line
    return np.array([*line, [other_x, bottom], [x, bottom]])


def figure(frames: Frames, index: int = 0) -> tuple[Figure, tuple[Axes, Axes]]:
    """Return a figure of the frame `index`, and the Matplotlib axes of the side view and of the top view."""
    stage = Stage(frames)
    return stage.draw(index), stage.axes
