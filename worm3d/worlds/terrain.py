"""Heights of terrain on a regular grid: made by formula or by chance, or read from an image."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STONES = 4.0
"""Stones of rubble on the area of the square about one of them: they overlap, and little ground shows between."""


def nodes(length: float, width: float, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return x from 0 and y about 0 of a grid that covers a rectangle, shapes (A,), (B,) [m].

    Raises
    ------
    ValueError
        A size that is not finite and above 0.
    """
    for name, value in (("length", length), ("width", width), ("spacing", spacing)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: got {value!r} m, must be finite and above 0")
    along, across = (int(np.ceil(side / spacing - 1e-9)) for side in (length, width))
    return spacing * np.arange(along + 1.0), spacing * (np.arange(across + 1.0) - across / 2.0)


def sinusoid(x: FloatArray, y: FloatArray, amplitude: float, wavelength: float, azimuth: float = 0.0) -> FloatArray:
    """Return waves of which the crests lie across an azimuth, with a crest at the origin, shape (A, B) [m]."""
    along = x[:, None] * np.cos(azimuth) + y * np.sin(azimuth)
    heights: FloatArray = amplitude * np.cos(2.0 * np.pi * along / wavelength)
    return heights


def steps(x: FloatArray, y: FloatArray, height: float, tread: float, ramp: float) -> FloatArray:
    """Return stairs up along x, each step a smooth rise over `ramp` at the end of its tread, shape (A, B) [m]."""
    stair, within = np.divmod(x, tread)
    t = np.clip((within - (tread - ramp)) / ramp, 0.0, 1.0)
    profile = height * (stair + t**3 * (10.0 - 15.0 * t + 6.0 * t**2))
    return np.repeat(profile[:, None], len(y), axis=1)


def rubble(x: FloatArray, y: FloatArray, height: float, size: float, seed: int) -> FloatArray:
    """Return smooth stones thrown at random, the highest one counting at each place, shape (A, B) [m].

    A stone of radius R rises by height (1 - r^2/R^2)^2 times its share; R is 0.5 to 1 of `size`, the share R/size.
    """
    rng = np.random.default_rng(seed)
    area = (x[-1] - x[0] + 2.0 * size) * (y[-1] - y[0] + 2.0 * size)
    count = max(1, round(STONES * area / (4.0 * size**2)))
    place = rng.uniform([x[0] - size, y[0] - size], [x[-1] + size, y[-1] + size], (count, 2))
    share = rng.uniform(0.5, 1.0, count)
    heights = np.zeros((len(x), len(y)))
    for (x_0, y_0), part in zip(place, share, strict=True):
        rows, columns = (np.flatnonzero(np.abs(side - at) < part * size) for side, at in ((x, x_0), (y, y_0)))
        square = ((x[rows, None] - x_0) ** 2 + (y[columns] - y_0) ** 2) / (part * size) ** 2
        block = np.ix_(rows, columns)
        heights[block] = np.maximum(heights[block], height * part * np.clip(1.0 - square, 0.0, None) ** 2)
    return heights


def image(path: str | PathLike[str], low: float, high: float) -> FloatArray:
    """Return the heights of a greyscale image, black `low` and white `high`, shape (A, B) [m].

    The left edge of the picture is x = 0, its upper edge the largest y, as on a map.

    Raises
    ------
    ValueError
        A file that is missing or no picture, a picture of one colour, or a range that is not finite and rising.
    """
    from PIL import Image, UnidentifiedImageError

    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ValueError(
            f"low, high: got {low!r}, {high!r} m, must be finite heights of black and white, low below high"
        )
    name = Path(path).name
    try:
        with Image.open(path) as picture:
            deep = picture.mode.startswith(("I", "F"))
            grey = np.asarray(picture if deep else picture.convert("L"), dtype=float)
    except FileNotFoundError:
        raise ValueError(f"heightfield image {name!r}: there is no such file; give the path of a PNG") from None
    except (OSError, UnidentifiedImageError, SyntaxError, ValueError) as error:
        raise ValueError(
            f"heightfield image {name!r}: cannot be read as a picture ({error}); save it again as a greyscale PNG"
        ) from None
    if grey.max() == grey.min():
        raise ValueError(f"heightfield image {name!r}: got one colour everywhere, must have darker and lighter places")
    share = (grey - grey.min()) / (grey.max() - grey.min()) if deep else grey / 255.0
    return low + (high - low) * share[::-1].T
