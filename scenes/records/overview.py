"""The overview, a picture of the worm and of its displacement that every run draws.

The overview is drawn with Pillow, since importing matplotlib would take longer than a run of ten seconds. `worm3d plot`
draws the other figures of a result.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.viewer import colours

Colour = tuple[int, int, int] | str

SCALE = 3
"""A picture is drawn larger by this factor and then reduced, which smooths the edges. Pillow itself does not."""

INK, GRID = "#333333", "#dddddd"

PICTURE_WIDTH, LEFT_MARGIN, RIGHT_MARGIN, TOP_MARGIN, BOTTOM_MARGIN, HEADER_HEIGHT = 720, 62, 16, 24, 36, 46
"""Width of the picture, margins around each panel, and height of the header [pixels]."""

PANEL_WIDTH = PICTURE_WIDTH - LEFT_MARGIN - RIGHT_MARGIN
CURVES_HIGH = 150
"""Height of a panel with curves [pixels]."""

SHORTER_COLOUR, REST_COLOUR, LONGER_COLOUR = (
    tuple(round(255 * part) for part in each)
    for each in (colours.SHORT_CHAMBER, colours.RESTING_CHAMBER, colours.LONG_CHAMBER)
)
START_COLOUR = "#a8a8a8"
INVALID = "white"
"""Colour of polygons whose shortening is not a number, because the run diverged."""

LINE_COLOURS = ("#1f6fb4", "#e08214", "#3a923a", "#8c2d83")


@dataclass(frozen=True)
class Side:
    """A view of the body."""

    title: str
    along: str
    """Label of the horizontal axis."""
    bodies: FloatArray
    """Corners of the K polygons of the body at the start and at the end of the run, shape (2, K, C, 2) [m]."""
    shortening: FloatArray
    """Shortening of each polygon at the end of the run, shape (K,), from -1 to 1, which sets its colour."""
    trail: FloatArray
    """Path of the centre of mass, shape (T, 2) [m]."""


def of_run(record: Record, sides: Sequence[Side], curves: Mapping[str, FloatArray]) -> Image.Image:
    """Return the overview of a run, with views of the body and below them a panel with curves over time.

    The curves are displacements, each of shape (T,) [m], by their label.
    """
    heights = [_height(side) for side in sides]
    canvas = headed(
        record, record.sentence, sum(heights) + CURVES_HIGH + (len(sides) + 1) * (TOP_MARGIN + BOTTOM_MARGIN)
    )
    top = HEADER_HEIGHT
    for side, height in zip(sides, heights, strict=True):
        _draw_side(canvas, side, top + TOP_MARGIN, height)
        top += TOP_MARGIN + height + BOTTOM_MARGIN
    _draw_curves(canvas, record["time"], curves, top + TOP_MARGIN)
    return canvas.image


def of_planar(record: Record, names: tuple[str, str, str], activation: FloatArray) -> Image.Image:
    """Return the overview of a run of a planar worm.

    Parameters
    ----------
    names : tuple of str
        Names of the variables with the joints, the top apexes and the bottom apexes.
    activation : ndarray, shape (N,)
        Activation of each segment at the end of the run.
    """
    joints, top, bottom = (record[name][[0, -1]] for name in names)
    bodies = np.stack([joints[:, :-1], top, joints[:, 1:], bottom], axis=2)
    com, most = record["com"], float(np.abs(activation).max()) or 1.0
    side = Side("height [m]", "along the ground [m]", bodies, activation / most, com)
    return of_run(record, [side], {"along the ground": com[:, 0] - com[0, 0]})


def headed(record: Record, sentence: str, height: int) -> Canvas:
    """Return a canvas with the title of a record and a sentence, and empty space below.

    `height` is the height of the space for panels [pixels].
    """
    canvas = Canvas(PICTURE_WIDTH, HEADER_HEIGHT + height)
    canvas.text(12, 16, record.title, size=15, width=PICTURE_WIDTH - 24)
    canvas.text(12, 36, sentence, width=PICTURE_WIDTH - 24)
    return canvas


def _window(side: Side) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner of the visible part of a view [m]."""
    places = side.bodies.reshape(2, -1, 2)
    with np.errstate(invalid="ignore"):
        length = float(np.ptp(places[0, :, 0]))
        far = not np.ptp(places[:, :, 0]) <= 4.0 * length  # if true, only the body at the end is visible
    shown = places[1:] if far else places
    x, y = (limits(shown[..., axis], 1.1 * length if axis == 0 else 0.2 * length, 0.08) for axis in (0, 1))
    return np.array([x[0], y[0]]), np.array([x[1], y[1]])


def _height(side: Side) -> int:
    low, high = _window(side)
    return round(min(190.0, PANEL_WIDTH * float((high[1] - low[1]) / (high[0] - low[0]))))


def _draw_side(canvas: Canvas, side: Side, top: int, height: int) -> None:
    """Draw a view with the same scale on both axes. If the view would be too high, the panel is made narrower."""
    low, high = _window(side)
    scale = min(PANEL_WIDTH / (high[0] - low[0]), height / (high[1] - low[1]))
    right = LEFT_MARGIN + scale * float(high[0] - low[0])
    panel = Panel(canvas, (LEFT_MARGIN, top, right, top + scale * float(high[1] - low[1])), low, high)
    panel.frame(side.title, side.along)
    panel.areas(side.bodies[0], [None] * len(side.shortening), START_COLOUR)
    panel.areas(side.bodies[1], [_shade(share) for share in side.shortening.tolist()])
    panel.line(side.trail, LINE_COLOURS[3])


def _shade(share: float) -> Colour:
    """Return the colour of a polygon, from blue (lengthened) over the skin colour (at rest) to red (shortened)."""
    if not math.isfinite(share):
        return INVALID
    far, size = (SHORTER_COLOUR, min(share, 1.0)) if share > 0.0 else (LONGER_COLOUR, min(-share, 1.0))
    red, green, blue = (round(rest + size * (end - rest)) for rest, end in zip(REST_COLOUR, far, strict=True))
    return red, green, blue


def _draw_curves(canvas: Canvas, time: FloatArray, curves: Mapping[str, FloatArray], top: int) -> None:
    x, y = limits(time, 1e-9, 0.0), limits(np.concatenate(list(curves.values())), 1e-3)
    box = (LEFT_MARGIN, top, PICTURE_WIDTH - RIGHT_MARGIN, top + CURVES_HIGH)
    panel = Panel(canvas, box, np.array([x[0], y[0]]), np.array([x[1], y[1]]))
    panel.frame("displacement of the centre of mass [m]", "time [s]")
    for number, (label, values) in enumerate(curves.items()):
        colour, row = LINE_COLOURS[number], top + 12 + 15 * number
        panel.line(np.column_stack([time, values]), colour)
        if len(curves) > 1:
            ends = [(SCALE * (LEFT_MARGIN + shift), SCALE * row) for shift in (10, 28)]
            canvas.draw.line(ends, fill=colour, width=2 * SCALE)
            canvas.text(LEFT_MARGIN + 34, row, label, size=10)


class Canvas:
    """A picture on a white background; `width` and `height` are in pixels."""

    def __init__(self, width: int, height: int) -> None:
        self._image = Image.new("RGB", (SCALE * width, SCALE * height), "white")
        self.draw = ImageDraw.Draw(self._image)

    def text(self, x: float, y: float, words: str, *, size: int = 11, anchor: str = "lm", width: float = 0.0) -> None:
        """Write a line of text.

        `anchor` is as in Pillow. If `width` [pixels] is given, the font is made small enough for the line to fit.
        """
        font = ImageFont.load_default(SCALE * size)
        while width and size > 1 and font.getlength(words) > SCALE * width:
            size -= 1
            font = ImageFont.load_default(SCALE * size)
        self.draw.text((SCALE * x, SCALE * y), words, fill=INK, font=font, anchor=anchor)

    @property
    def image(self) -> Image.Image:
        """The picture, reduced to its final size."""
        return self._image.reduce(SCALE)


@dataclass(frozen=True)
class Panel:
    """A rectangle of a canvas with its own axes."""

    canvas: Canvas
    box: tuple[float, float, float, float]
    """Left, top, right and bottom [pixels]."""
    low: FloatArray
    """Coordinates of the lower left corner in the units of the axes, shape (2,)."""
    high: FloatArray
    """Coordinates of the upper right corner in the units of the axes, shape (2,)."""

    def frame(self, title: str, xlabel: str = "") -> None:
        """Draw the border, the grid, the numbers of the axes, the title and the label of the horizontal axis."""
        left, top, right, bottom = self.box
        for x, number in ticks(self.low[0], self.high[0]):
            self._segment([[x, self.low[1]], [x, self.high[1]]], GRID, 1.0)
            self.canvas.text(self._pixel(x, 0), bottom + 9, number, size=10, anchor="mm")
        for y, number in ticks(self.low[1], self.high[1], 4):
            self._segment([[self.low[0], y], [self.high[0], y]], GRID, 1.0)
            self.canvas.text(left - 5, self._pixel(y, 1), number, size=10, anchor="rm")
        self.canvas.draw.rectangle([SCALE * side for side in self.box], outline=INK, width=SCALE)
        self.canvas.text(left, top - 9, title)
        self.canvas.text(right, bottom + 24, xlabel, anchor="rm")

    def line(self, points: ArrayLike, colour: Colour, width: float = 1.5) -> None:
        """Draw a line through points, shape (P, 2). It is interrupted at points that are not finite or are outside."""
        places = np.asarray(points, dtype=float)
        seen = self._inside(places)
        for run in np.split(np.arange(len(places)), np.flatnonzero(~seen)):
            inside = run[seen[run]]
            if len(inside) > 1:
                self._segment(places[inside], colour, width)

    def areas(self, corners: ArrayLike, fills: Iterable[Colour | None], edge: Colour = INK) -> None:
        """Draw polygons with the given corners, shape (K, C, 2). Polygons with a corner outside are left out."""
        polygons = np.asarray(corners, dtype=float)
        for polygon, fill in zip(polygons, fills, strict=True):
            if self._inside(polygon).all():
                self.canvas.draw.polygon(self._pixels(polygon), fill=fill, outline=edge, width=SCALE - 1)

    def _inside(self, places: FloatArray) -> NDArray[np.bool_]:
        inside: NDArray[np.bool_] = np.all((places >= self.low) & (places <= self.high), axis=1)
        return inside

    def _segment(self, places: ArrayLike, colour: Colour, width: float) -> None:
        self.canvas.draw.line(self._pixels(np.asarray(places)), fill=colour, width=round(SCALE * width), joint="curve")

    def _pixels(self, places: FloatArray) -> list[tuple[float, float]]:
        return [(SCALE * self._pixel(x, 0), SCALE * self._pixel(y, 1)) for x, y in places.tolist()]

    def _pixel(self, value: float, axis: int) -> float:
        share = (value - self.low[axis]) / (self.high[axis] - self.low[axis])
        begin, end = (self.box[0], self.box[2]) if axis == 0 else (self.box[3], self.box[1])
        return float(begin + share * (end - begin))


def limits(values: ArrayLike, least: float, margin: float = 0.06) -> tuple[float, float]:
    """Return the limits of an axis that contains all finite values.

    The range is enlarged by the fraction `margin` on both sides, and to at least the width `least`.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    more = max(margin * (high - low), 0.5 * (least - high + low))
    return low - more, high + more


def ticks(low: float, high: float, most: int = 6) -> list[tuple[float, str]]:
    """Return about `most` round numbers between two limits, each as a number and as text."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * nice for nice in (1.0, 2.0, 5.0, 10.0) if power * nice >= rough * (1.0 - 1e-9))
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    numbers = step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(float(number), f"{number + 0.0:.{decimals}f}") for number in numbers]
