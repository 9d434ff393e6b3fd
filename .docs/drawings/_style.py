"""Shared look of the drawings: sizes, colours, labels, and the geometry of a segment from the program's formulas."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from worm3d import Worm
from worm3d.physics import elements
from worm3d.values.arrays import FloatArray
from worm3d.viewer import colours
from worm3d.viewer.world import GROUND as GROUND_COLOUR
from worm3d.viewer.world import PIPE as PIPE_COLOUR

SHORT, REST, LONG, LINK, FACE, FORCE, ANCHOR, TRAIL, INK = map(
    colours.as_hex,
    (
        *(colours.SHORT_CHAMBER, colours.RESTING_CHAMBER, colours.LONG_CHAMBER, colours.LINK, colours.FACE),
        *(colours.FORCE_ARROW, colours.ANCHOR, colours.TRAIL, colours.REFERENCE_PATH),
    ),
)
DRAWN_GROUND, DRAWN_PIPE = colours.as_hex(GROUND_COLOUR), colours.as_hex(PIPE_COLOUR)
PALE = "#9aa0ab"
"""Colour of helper lines."""

WIDTH = 7.3
"""Width of a drawing [inches]: 700 pixels in a browser."""

LOOK = {
    "font.size": 10.0,
    "font.family": "DejaVu Sans",
    "mathtext.fontset": "cm",
    "axes.titlesize": 10.0,
    "axes.labelsize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": LINK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": LINK,
    "ytick.color": LINK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.8,
    "figure.facecolor": "white",
    "svg.fonttype": "path",
}
"""Settings of Matplotlib."""


@contextmanager
def drawing(folder: Path, name: str, height: float) -> Iterator[Figure]:
    """Give an empty figure of the given height [inches], and write `folder`/drawings/`name`.svg at the end."""
    path = folder / "drawings" / f"{name}.svg"
    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context({**LOOK, "svg.hashsalt": name}):
        figure = Figure(figsize=(WIDTH, height))
        FigureCanvasSVG(figure)
        yield figure
        figure.savefig(path, metadata={"Date": None})


def sketch(axes: Axes, title: str, x: tuple[float, float], y: tuple[float, float]) -> Axes:
    """Turn axes into a sketch with equal scales, without ticks, that shows at least x and y. Return the axes."""
    place = axes.get_position()
    ratio = place.width * WIDTH / (place.height * axes.figure.get_figheight())
    width = max(x[1] - x[0], ratio * (y[1] - y[0]))
    (x0, x1), (y0, y1) = (
        (sum(of) - size) / 2.0 + np.array([0.0, size]) for of, size in ((x, width), (y, width / ratio))
    )
    axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal")
    axes.axis("off")
    axes.set_title(title, loc="left")
    return axes


def letter(axes: Axes, name: str) -> None:
    """Write the letter of a panel in front of the title."""
    axes.set_title(f"{name}   {axes.get_title('left')}", loc="left")


def label(axes: Axes, at: Any, text: str, **more: Any) -> None:
    """Write a text centred at a point, on a white ground that hides lines below."""
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.85}
    axes.text(*at, text, **{"ha": "center", "va": "center", "bbox": box, "zorder": 9, **more})


def arrow(axes: Axes, tail: Any, head: Any, colour: str = INK, width: float = 1.8) -> None:
    """Draw an arrow from point to point, each of shape (2,)."""
    look = {"arrowstyle": "-|>,head_width=0.22,head_length=0.5", "color": colour, "lw": width}
    axes.annotate("", head, tail, arrowprops={**look, "shrinkA": 0, "shrinkB": 0}, zorder=7)


def dimension(axes: Axes, a: Any, b: Any, text: str, colour: str = INK, shift: Any = (0.0, 0.0)) -> None:
    """Draw a line with arrow heads at both ends and a text at its middle, moved by `shift`."""
    look = {"arrowstyle": "<|-|>,head_width=0.15,head_length=0.35", "color": colour, "lw": 1.0}
    axes.annotate("", b, a, arrowprops={**look, "shrinkA": 0, "shrinkB": 0}, zorder=6)
    label(axes, (np.asarray(a) + np.asarray(b)) / 2.0 + np.asarray(shift), text, color=colour)


@dataclass(frozen=True)
class Segment:
    """A segment in a given pose: `ends` (2, 3), `length`, frame t, d, u (3,), `chambers` (2,), `apexes` (6, 3) [m]."""

    ends: FloatArray
    length: float
    t: FloatArray
    d: FloatArray
    u: FloatArray
    chambers: FloatArray
    apexes: FloatArray

    @property
    def middle(self) -> FloatArray:
        """Midpoint of the segment, shape (3,) [m]."""
        return np.asarray(self.ends.mean(axis=0))

    def rhombus(self, worm: Worm, side: int) -> FloatArray:
        """Return the corners of a chamber's rhombus (0: left, 1: right), from the tail over the top, shape (4, 3)."""
        centre = self.middle + elements.SIDE_SIGNS[side] * worm.chamber_offset * self.d
        half = self.chambers[side] / 2.0 * self.t
        below, above = self.apexes[3 * side], self.apexes[3 * side + 1]
        return np.array([centre - half, above, centre + half, below])


def segment(worm: Worm, tail: Any, head: Any, *, roll: float = 0.0, bend: float = 0.0) -> Segment:
    """Return the segment between two joints [m] with roll and chamber bend [rad], by (E1) to (E3)."""
    values = _segment()(tail, head, roll, bend, worm.link_length[0], worm.chamber_offset)
    length, t, d, u, chambers, apexes = (np.array(each).T.squeeze() for each in values)
    return Segment(np.array([tail, head], dtype=float), float(length), t, d, u, chambers, apexes)


@cache
def _segment() -> ca.Function:
    """Return the formulas of a segment as a function. Rolls are measured from a director with no vertical part."""
    tail, head, roll, bend = ca.SX.sym("p", 3), ca.SX.sym("q", 3), ca.SX.sym("g"), ca.SX.sym("th")
    link, offset = ca.SX.sym("a"), ca.SX.sym("b")
    forward, left = ca.DM([1.0, 0.0, 0.0]), ca.DM([0.0, 1.0, 0.0])
    f = elements.frame(head - tail, roll, ca.SX(forward), ca.SX(left))
    chambers = elements.chamber_lengths(f.length, bend, offset)
    heights = [elements.half_height(link, chamber) for chamber in chambers]
    points = elements.apexes((tail + head) / 2.0, f, [(h, offset + h) for h in heights], offset)
    given = [tail, head, roll, bend, link, offset]
    return ca.Function("segment", given, [f.length, f.t, f.d, f.u, ca.vertcat(*chambers), ca.horzcat(*points)])


def colour_of(strain: float, limit: float = 0.25) -> str:
    """Return the colour of a chamber with a given strain, as in the viewer."""
    red, green, blue = colours.strain_colour(np.array(strain), limit)
    return colours.as_hex((float(red), float(green), float(blue)))
