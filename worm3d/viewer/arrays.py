"""Checking arrays: shape, finiteness, and that nobody changes them afterwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray

Shape = tuple[int | str, ...]


def frozen(name: str, value: ArrayLike, shape: Shape, sizes: dict[str, int]) -> FloatArray:
    """Return a read-only copy of `value` as floats.

    Parameters
    ----------
    name : str
        As the user knows it.
    shape : tuple of int or str
        What is allowed; a letter stands for its size in `sizes`, where a new letter is entered; "N+1" is N and one.
    sizes : dict
        Sizes known so far.

    Raises
    ------
    ValueError
        Not numbers, another shape, or a value that is not finite.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: got {type(value).__name__}, must be numbers of shape {written(shape)}") from error
    check_shape(name, array.shape, shape, sizes)
    if not np.isfinite(array).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(
            f"{name}: got {array[first]} at index {first}, must be finite: show only the frames before a run diverged"
        )
    array.setflags(write=False)
    return array


def check_shape(name: str, got: tuple[int, ...], shape: Shape, sizes: dict[str, int]) -> None:
    """Raise ValueError unless `got` is `shape`; enter sizes of new letters into `sizes`."""
    fits = len(got) == len(shape)
    for size, want in zip(got, shape, strict=False):
        if isinstance(want, str) and not want.endswith("+1"):
            want = sizes.setdefault(want, size)
        elif isinstance(want, str):
            want = sizes[want.removesuffix("+1")] + 1
        fits = fits and size == want
    if not fits:
        known = ", ".join(f"{key} = {sizes[key]}" for key in sizes if any(key in str(want) for want in shape))
        raise ValueError(f"{name}: got shape {got}, must be {written(shape)}" + (f" with {known}" if known else ""))


def written(shape: Shape) -> str:
    """Return a shape as it stands in documentation, e.g. "(T, N+1, 3)"."""
    return "(" + ", ".join(str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
