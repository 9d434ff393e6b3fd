"""Heights of terrain on a regular grid, from a formula, from random numbers, or from an image."""

from __future__ import annotations

import warnings
from io import BytesIO
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from worm3d.values import arguments, regular_file
from worm3d.values.arrays import FloatArray

MOST_STONES = 100_000
"""Largest number of stones in rubble. They take a few seconds to compute."""

MOST_HEIGHTS = 4_000_000
"""Largest number of nodes of terrain. Each of its tables then needs 32 MB."""

LARGEST_FILE = 200_000_000
"""Size of the largest image file [byte]."""

FORMATS = ("PNG", "TIFF", "JPEG", "BMP", "PPM", "GIF")
"""Image formats that are read. For other formats, Pillow may start other programs or has no limit on the size."""


def require_few(along: float, across: float) -> None:
    """Raise ValueError if a grid with these numbers of nodes along its sides has more nodes than are allowed."""
    if not along * across <= MOST_HEIGHTS:
        raise ValueError(
            f"spacing: got {along:.3g} x {across:.3g} heights, at most {MOST_HEIGHTS:.0g} are allowed; take a wider "
            "spacing or a smaller piece of terrain"
        )


def nodes(length: float, width: float, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates x, shape (A,), and y, shape (B,), of a grid that covers a rectangle [m].

    x starts at 0, and y is centred at 0.

    Raises
    ------
    ValueError
        A size is not finite or not above 0, or there are too many nodes.
    """
    sizes = {"length": length, "width": width, "spacing": spacing}
    length, width, spacing = (arguments.number(name, value, "m", gt=0.0) for name, value in sizes.items())
    require_few(*(float(np.float64(side) / spacing) + 1.0 for side in (length, width)))
    along, across = (int(np.ceil(side / spacing - 1e-9)) for side in (length, width))
    return spacing * np.arange(along + 1.0), spacing * (np.arange(across + 1.0) - across / 2.0)


def sinusoid(x: FloatArray, y: FloatArray, amplitude: float, wavelength: float, azimuth: float = 0.0) -> FloatArray:
    """Return the heights of waves along an azimuth [rad], with a crest at the origin, shape (A, B) [m]."""
    along = x[:, None] * np.cos(azimuth) + y * np.sin(azimuth)
    return np.asarray(amplitude * np.cos(2.0 * np.pi * along / wavelength))


def steps(x: FloatArray, y: FloatArray, height: float, tread: float, ramp: float) -> FloatArray:
    """Return the heights of stairs that go up along x, shape (A, B) [m].

    Each tread is level except for its last part of length `ramp`, where it rises smoothly by `height` to the next.
    """
    stair, within = np.divmod(x, tread)
    t = np.clip((within - (tread - ramp)) / ramp, 0.0, 1.0)
    profile = height * (stair + t**3 * (10.0 - 15.0 * t + 6.0 * t**2))
    return np.repeat(profile[:, None], len(y), axis=1)


def rubble(x: FloatArray, y: FloatArray, height: float, size: float, seed: int) -> FloatArray:
    """Return the heights of smooth stones at random places, shape (A, B) [m].

    At a distance r from its centre, a stone of radius R has the height `height` (R/`size`) (1 - r^2/R^2)^2. R is random
    between 0.5 and 1 times `size`. Where stones overlap, the highest stone gives the height.
    """
    rng = np.random.default_rng(seed)
    area = (x[-1] - x[0] + 2.0 * size) * (y[-1] - y[0] + 2.0 * size)
    stones = area / size**2  # four in the square around a stone, so that stones overlap and leave little ground free
    if not stones <= MOST_STONES:
        raise ValueError(
            f"size: got {size!r} m, which makes {stones:.3g} stones, at most {MOST_STONES:.0g} are allowed; take "
            "larger stones or a smaller field"
        )
    count = max(1, round(stones))
    place = rng.uniform([x[0] - size, y[0] - size], [x[-1] + size, y[-1] + size], (count, 2))
    share = rng.uniform(0.5, 1.0, count)
    heights = np.zeros((len(x), len(y)))
    for (x_0, y_0), part in zip(place, share, strict=True):
        rows, columns = (_near(side, at, part * size) for side, at in ((x, x_0), (y, y_0)))
        square = ((x[rows, None] - x_0) ** 2 + (y[columns] - y_0) ** 2) / (part * size) ** 2
        block = np.ix_(rows, columns)
        heights[block] = np.maximum(heights[block], height * part * np.clip(1.0 - square, 0.0, None) ** 2)
    return heights


def _near(side: FloatArray, at: float, reach: float) -> NDArray[np.intp]:
    """Return the indices of the increasing coordinates `side` that lie within a distance `reach` of `at`."""
    first, last = np.searchsorted(side, (at - reach, at + reach))
    return np.asarray(first + np.flatnonzero(np.abs(side[first:last] - at) < reach))


def image(path: str | PathLike[str], low: float, high: float) -> FloatArray:
    """Return the heights of a greyscale image, shape (A, B) [m].

    Black has the height `low`, and white has the height `high`. In an image of more than 8 bits, the darkest and the
    lightest value take the place of black and white. As on a map, x increases to the right and y increases upwards.

    Raises
    ------
    ValueError
        The file is missing or is not an image, the image has only one colour, a height is not finite, or `low` is not
        below `high`.
    """
    from PIL import Image, UnidentifiedImageError

    low, high = (arguments.number(*given, "m") for given in (("low", low), ("high", high)))
    if not low < high:
        raise ValueError(
            f"low, high: got {low!r}, {high!r} m, must be finite heights of black and white, low below high"
        )
    name = Path(path).name
    content = regular_file.content(path, LARGEST_FILE, "heightfield image")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(BytesIO(content), formats=FORMATS) as picture:
                require_few(*picture.size)
                deep = picture.mode.startswith(("I", "F"))
                grey = np.asarray(picture if deep else picture.convert("L"), dtype=float)
    except Exception as error:  # readers raise many kinds of errors
        unknown = isinstance(error, UnidentifiedImageError)
        why = f"it is none of {', '.join(FORMATS)}" if unknown else arguments.shown(str(error))
        raise _no_picture(name, why) from None
    if not np.isfinite(grey).all():
        raise _no_picture(name, "it has values that are not finite")
    if grey.max() == grey.min():
        raise ValueError(f"heightfield image {name!r}: got one colour everywhere, must have darker and lighter places")
    share = (grey - grey.min()) / (grey.max() - grey.min()) if deep else grey / 255.0
    return low + (high - low) * share[::-1].T


def _no_picture(name: str, why: str) -> ValueError:
    return ValueError(
        f"heightfield image {name!r}: cannot be read as a picture ({why}); save it again as a greyscale PNG"
    )
