"""Small pictures by Pillow alone: lines, areas and words in panels with axes.

For what every run draws: importing matplotlib takes longer than a run of ten seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from worm3d.values.arrays import FloatArray

Colour = tuple[int, int, int] | str

SCALE = 3
"""Pictures are drawn so many times larger and averaged: Pillow's edges are not smooth."""

TICKS = 6
"""Numbers along an axis, at most."""

INK, GRID = "#333333", "#dddddd"


class Canvas:
    """A white picture of a width and a height in pixels."""

    def __init__(self, width: int, height: int) -> None:
        self._image = Image.new("RGB", (SCALE * width, SCALE * height), "white")
        self.draw = ImageDraw.Draw(self._image)

    def text(self, x: float, y: float, words: str, *, size: int = 11, anchor: str = "lm", width: float = 0.0) -> None:
        """Write a line of text; `anchor` is Pillow's, and with a width [pixels] a longer line gets a smaller size."""
        font = ImageFont.load_default(SCALE * size)
        while width and size > 1 and font.getlength(words) > SCALE * width:
            size -= 1
            font = ImageFont.load_default(SCALE * size)
        self.draw.text((SCALE * x, SCALE * y), words, fill=INK, font=font, anchor=anchor)

    @property
    def image(self) -> Image.Image:
        """The picture as it is now."""
        return self._image.reduce(SCALE)


@dataclass(frozen=True)
class Panel:
    """A rectangle of a canvas with axes of its own.

    Attributes
    ----------
    canvas : Canvas
    box : tuple of float
        Left, top, right and bottom [pixels].
    low, high : ndarray, shape (2,)
        What is at the lower left and at the upper right corner.
    """

    canvas: Canvas
    box: tuple[float, float, float, float]
    low: FloatArray
    high: FloatArray

    def frame(self, title: str, xlabel: str = "") -> None:
        """Draw border, grid and numbers, the title above, and what lies along x below."""
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
        """Draw a line through points, shape (P, 2); it is broken where they are not finite or lie outside."""
        places = np.asarray(points, dtype=float)
        seen = self._inside(places)
        for run in np.split(np.arange(len(places)), np.flatnonzero(~seen)):
            inside = run[seen[run]]
            if len(inside) > 1:
                self._segment(places[inside], colour, width)

    def areas(self, corners: ArrayLike, fills: Iterable[Colour | None], edge: Colour = INK) -> None:
        """Draw polygons, shape (K, C, 2), one after the other; those with a corner outside are left out."""
        polygons = np.asarray(corners, dtype=float)
        for polygon, fill in zip(polygons, fills, strict=True):
            if self._inside(polygon).all():
                self.canvas.draw.polygon(self._pixels(polygon), fill=fill, outline=edge, width=SCALE - 1)

    def dots(self, points: ArrayLike, colour: Colour, radius: float = 3.0) -> None:
        """Draw a dot at each point, shape (P, 2), that is finite and inside."""
        places = np.asarray(points, dtype=float)
        for x, y in self._pixels(places[self._inside(places)]):
            self.canvas.draw.circle((x, y), SCALE * radius, fill=colour)

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
    """Return a range that all finite values are in, with a margin, at least so wide."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    more = max(margin * (high - low), 0.5 * (least - high + low))
    return low - more, high + more


def ticks(low: float, high: float, most: int = TICKS) -> list[tuple[float, str]]:
    """Return round numbers between two, at most so many, each with its digits."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * nice for nice in (1.0, 2.0, 5.0, 10.0) if power * nice >= rough * (1.0 - 1e-9))
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    numbers = step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(float(number), f"{number + 0.0:.{decimals}f}") for number in numbers]
