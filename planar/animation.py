"""Animations of the planar worm as a chain of linkages. GIF is always available, MP4 only if ffmpeg is installed."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import cast

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from worm3d.values.arrays import FloatArray
from worm3d.values.chamber_colours import RAMP

CONTRACTED_RED = LinearSegmentedColormap.from_list("contraction", RAMP[::-1])


class Movie:
    """An animation of a planar worm.

    Parameters
    ----------
    time : ndarray, shape (T,)
        Evenly spaced instants [s].
    main, top, bottom : ndarray, shape (T, n + 1, 2), (T, n, 2), (T, n, 2)
        Corners of the rhombi [m]: the joints, including both ends of the worm, the upper apexes and the lower apexes.
    activation : ndarray, shape (T, n)
        Activation of each segment, which sets the colour: skin-coloured at 0, red at 1, blue at -1.
    ground : float, optional
        Height of the ground [m]. If left out, no ground is drawn.
    """

    def __init__(
        self,
        time: FloatArray,
        main: FloatArray,
        top: FloatArray,
        bottom: FloatArray,
        activation: FloatArray,
        ground: float | None = None,
    ) -> None:
        self.time = time
        # Corners of each rhombus in order: tail, top, head, bottom; shape (T, n, 4, 2).
        self.corners = np.stack([main[:, :-1], top, main[:, 1:], bottom], axis=2)
        self.activation = activation
        self._draw_stage(ground)

    def _draw_stage(self, ground: float | None) -> None:
        low, high = self._view(ground)
        left, bottom, above, wide = 70, 45, 25, 710
        height = 2 * round((bottom + wide * (high[1] - low[1]) / (high[0] - low[0]) + above) / 2)  # even, for MP4
        width = left + wide + 20
        self.figure = Figure(figsize=(width / 100, height / 100), dpi=100)
        FigureCanvasAgg(self.figure)
        box = (left / width, bottom / height, wide / width, (height - bottom - above) / height)
        self._axes = axes = self.figure.add_axes(box)
        axes.set(aspect="equal", xlabel="along the ground [m]", ylabel="height [m]")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.locator_params(axis="y", nbins=4)
        if ground is not None:
            axes.axhspan(low[1], ground, color="0.8", lw=0)
        self._bodies = PolyCollection(
            self.corners[0], cmap=CONTRACTED_RED, clim=(-1.2, 1.2), edgecolors="0.15", lw=1.5, joinstyle="round"
        )
        self._springs = LineCollection(self.corners[0][:, ::2], colors="0.45", lw=1.0, ls="--")
        self._joints = axes.plot([], [], "o", color="0.1", ms=4)[0]
        axes.add_collection(self._bodies)
        axes.add_collection(self._springs)
        self._title = axes.set_title("", fontsize=9, loc="left")

    def _view(self, ground: float | None) -> tuple[FloatArray, FloatArray]:
        """Return the lower left and the upper right corner of the first view [m].

        The view is at most three body lengths wide. If the worm crawls further, the view moves with it (`_follow`). The
        height is at most 0.6 of the width, even if corners of the rhombi are far away in a diverging run.
        """
        low, high = self.corners.min(axis=(0, 1, 2)), self.corners.max(axis=(0, 1, 2))
        if ground is not None:
            low[1] = min(low[1], ground)
        first = self.corners[0]
        body = float(np.ptp(first[..., 0]))
        low[0] = max(low[0], first[..., 0].min() - body)
        high[0] = min(high[0], low[0] + 3.0 * body)
        middle, reach = float(first[..., 1].mean()), 0.3 * (high[0] - low[0])
        low[1], high[1] = max(low[1], middle - reach), min(high[1], middle + reach)
        margin = 0.04 * (high[0] - low[0])
        return low - margin, high + margin

    def _follow(self, corners: FloatArray) -> None:
        """Move the view along the ground when the worm would leave the view."""
        left, right = self._axes.get_xlim()
        tail, head = float(corners[..., 0].min()), float(corners[..., 0].max())
        if tail < left or head > right:
            middle, half = 0.5 * (tail + head), 0.5 * (right - left)
            self._axes.set_xlim(middle - half, middle + half)

    def draw(self, frame: int) -> Figure:
        """Draw the worm at the instant number `frame` and return the figure."""
        corners = self.corners[frame]
        self._follow(corners)
        self._bodies.set_verts(list(corners))
        self._bodies.set_array(self.activation[frame])
        self._springs.set_segments(list(corners[:, ::2]))
        joints = np.vstack([corners[:, 0], corners[-1:, 2]])
        self._joints.set_data(joints[:, 0], joints[:, 1])
        self._title.set_text(f"t = {self.time[frame]:5.2f} s   colour: activation (red contracts, blue lengthens)")
        return self.figure

    def save(self, path: Path, fps: int = 20) -> None:
        """Write the movie, which plays in real time, to a `.gif` file (with Pillow) or an `.mp4` file (with ffmpeg).

        Raises
        ------
        ValueError
            The file name does not end in .gif or .mp4.
        FileNotFoundError
            The file name ends in .mp4, but ffmpeg is not installed.
        """
        suffix = path.suffix.lower()
        # The delay between two frames of a GIF is a whole number of hundredths of a second.
        interval = max(round(100 / fps), 2) / 100 if suffix == ".gif" else 1 / fps
        writer = _writer(path, suffix, interval)
        with mpl.rc_context({"animation.frame_format": "rgba"}), writer.saving(self.figure, str(path), dpi=100):
            for frame in self._frames(interval):
                self.draw(frame)
                writer.grab_frame()

    def _frames(self, interval: float) -> list[int]:
        if len(self.time) < 2:
            return [0]
        instants = np.arange(self.time[0], self.time[-1] + 0.5 * interval, interval)
        return [int(np.abs(self.time - t).argmin()) for t in instants]


def _writer(path: Path, suffix: str, interval: float) -> AbstractMovieWriter:
    if suffix == ".gif":
        # PillowWriter rounds the delay down to whole milliseconds. The factor makes the delay slightly longer, so that
        # a rounding error does not remove a millisecond.
        return PillowWriter(fps=cast(int, (1.0 - 1e-9) / interval))
    if suffix != ".mp4":
        raise ValueError(f"animation file: got {path.name!r}, the ending must be .gif or .mp4")
    if shutil.which("ffmpeg") is None:
        raise FileNotFoundError(
            "MP4 needs the program ffmpeg, which was not found: install it, or take a name that ends in .gif"
        )
    return FFMpegWriter(fps=cast(int, 1.0 / interval))
