"""The shape of a curve, which is computed from its values and described in a sentence.

A curve is flat, rises, falls, has a peak or a dip, or has several extremes. Values have errors. Two values are called
level if their difference is at most the sum of their errors, and apart otherwise. A place is the index of a value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray

MAX_FLAT_CHANGE = 0.05
"""Largest range of a flat curve, relative to the largest magnitude of its values."""
RIPPLE = 0.05
"""Largest change against the trend that is ignored, as a fraction of the range of the curve. With 0.025, errors of the
time steps would be reported as extremes. With 0.1, the study `wavelength` would miss the dip at a wavelength of half a
body length."""
NEGLIGIBLE_LOSS = 0.05
"""A value counts as nearly the best up to this relative difference from the best value."""
AT_END, AT_GAP = "the range ends there", "the values end there"

Told = Callable[[int], str]
"""Function from a place to a text."""


def apart(first: Any, second: Any, off: Any, other_off: Any) -> NDArray[np.bool_]:
    """Return whether values differ by more than the sum of their errors `off` and `other_off`."""
    return np.asarray(np.abs(first - second) > off + other_off)


@dataclass(frozen=True)
class Shape:
    """Values of a curve and its extremes."""

    y: FloatArray
    """Values, shape (X,); NaN if a value is missing."""
    off: FloatArray
    """Errors of the values, shape (X,); 0 if an error is unknown."""
    turns: tuple[int, ...]
    """Places of the first value, of the extremes that are larger than `RIPPLE`, and of the last value. Empty if fewer
    than two values are known."""
    flat: bool
    """Whether the range is at most `MAX_FLAT_CHANGE`, or the largest and the smallest value are level."""

    @classmethod
    def of(cls, y: FloatArray, off: FloatArray | None = None) -> Shape:
        """Return the shape of a curve.

        Parameters
        ----------
        y : ndarray, shape (X,)
            Values; NaN if a value is missing.
        off : ndarray, shape (X,), optional
            Errors of the values; NaN if an error is unknown.
        """
        known = np.flatnonzero(np.isfinite(y))
        off = np.zeros(len(y)) if off is None else np.nan_to_num(off)
        if len(known) < 2:
            return cls(y, off, (), flat=False)
        span = float(np.ptp(y[known]))
        small = span <= MAX_FLAT_CHANGE * float(np.abs(y[known]).max())
        turns = _turns(y, off, known, RIPPLE * span)
        return cls(y, off, turns, flat=small or not _resolved(y, off))

    @property
    def kind(self) -> str:
        """`flat`, `rises`, `falls`, `peak`, `dip` or `several` (extremes); `none` for fewer than two known values."""
        if not self.turns or self.flat:
            return "flat" if self.turns else "none"
        rising = bool(self.y[self.turns[1]] > self.y[self.turns[0]])
        if len(self.turns) == 2:
            return "rises" if rising else "falls"
        return ("peak" if rising else "dip") if len(self.turns) == 3 else "several"

    def best(self, better: str) -> int:
        """Return the place of the best value: the smallest value if `better` is "less", otherwise the largest value."""
        return int(np.nanargmin(self.y) if better == "less" else np.nanargmax(self.y))

    def level(self, place: int) -> list[int]:
        """Return the places whose values are level with the value at `place`, including `place` itself."""
        alike = ~apart(self.y, self.y[place], self.off, self.off[place]) & np.isfinite(self.y)
        return [int(k) for k in np.flatnonzero(alike)]

    def edge(self, place: int) -> str:
        """Return `AT_END` for the first and the last place, `AT_GAP` if a value next to `place` is missing, else ""."""
        if len(self.y) > 1 and place in (0, len(self.y) - 1):
            return AT_END
        return AT_GAP if np.isnan(self.y[max(0, place - 1) : place + 2]).any() else ""

    def near(self, place: int) -> tuple[int, int]:
        """Return the first and the last place of the range around `place` in which all values are nearly the same.

        They differ from the value at `place` by at most `NEGLIGIBLE_LOSS` times this value.
        """
        alike = np.abs(self.y - self.y[place]) <= NEGLIGIBLE_LOSS * abs(float(self.y[place]))
        low = high = place
        while low > 0 and alike[low - 1]:
            low -= 1
        while high < len(alike) - 1 and alike[high + 1]:
            high += 1
        return low, high


def _resolved(y: FloatArray, off: FloatArray) -> bool:
    """Return whether the largest and the smallest value are apart."""
    most, least = int(np.nanargmax(y)), int(np.nanargmin(y))
    return bool(apart(y[most], y[least], off[most], off[least]))


def _turns(y: FloatArray, off: FloatArray, known: np.ndarray, tolerance: float) -> tuple[int, ...]:
    """Return the places of the first value, the extremes, and the last value.

    A change of direction counts as an extreme if it exceeds both the tolerance and the errors of the values. `known`
    has the places of the known values.
    """
    turns, extreme, way = [int(known[0])], int(known[0]), 0
    for place in map(int, known[1:]):
        ahead, least = float(y[place] - y[extreme]), max(tolerance, float(off[place] + off[extreme]))
        if way == 0 and abs(ahead) > least:
            way, extreme = (1 if ahead > 0.0 else -1), place
        elif way * ahead > 0.0:
            extreme = place
        elif way and -way * ahead > least:
            turns.append(extreme)
            way, extreme = -way, place
    return (*turns, int(known[-1]))


def sentence(shape: Shape, what: str, along: str, x: Told, told: Told, better: str = "") -> str:
    """Return a sentence that describes a curve, without the final full stop.

    Parameters
    ----------
    shape : Shape
    what, along : str
        Names of y and of x in the sentence.
    x, told : callable
        Functions from a place to the text of x there, and to the text of y there with its error.
    better : str
        "more" or "less", depending on which values of y are better; empty if neither.
    """
    y = shape.y
    at = [f"{told(k)} at {x(k)}" for k in shape.turns]
    best = shape.best(better) if better and shape.turns else -1
    end = f" ({edge})" if best >= 0 and (edge := shape.edge(best)) else ""
    at = [f"{text}{end if k == best else ''}" for k, text in zip(shape.turns, at, strict=True)]
    match shape.kind:
        case "none":
            for k in np.flatnonzero(np.isfinite(y)).tolist():
                return f"{what} is known at one value of {along} alone, {told(k)} at {x(k)}"
            return f"{what} is known nowhere"
        case "flat":
            low, high = told(shape.best("less")), told(shape.best("more"))
            return f"{what} hardly depends on {along}: {low} to {high}{_unresolved(shape)}"
        case "rises" | "falls" as way:
            return f"{what} {way} with {along}, from {at[0]} to {at[-1]}{factor(y, shape)}{_early(shape, x)}"
        case "peak" | "dip" as kind:
            first, _, last = at
            most = "greatest" if kind == "peak" else "least"
            near = _near(shape, shape.turns[1], x) if (kind == "peak") == (better != "less") else ""
            top = shape.turns[1]
            return f"{what} is {most} at {x(top)}: {told(top)}{near}, compared with {first} and {last}"
    where = f"; best at {_best(shape, x, better)}" if better else ""
    return f"{what} goes up and down with {along}: " + ", ".join(at) + where


def _unresolved(shape: Shape) -> str:
    differ = np.nanmax(shape.y) > np.nanmin(shape.y)
    return ", no further apart than their errors" if differ and not _resolved(shape.y, shape.off) else ""


def _best(shape: Shape, x: Told, better: str) -> str:
    """Return a text with the value of x at the best value of y, and at each value of y that is level with the best."""
    best = shape.best(better)
    level = [x(k) for k in shape.level(best) if k != best]
    return x(best) + (f", level with {', '.join(level)}" if level else "")


def factor(y: FloatArray, shape: Shape) -> str:
    """Return a text in brackets with the relative change or the ratio between the first and the last value."""
    first, last = float(y[shape.turns[0]]), float(y[shape.turns[-1]])
    if first * last <= 0.0 or first == last:
        return ""
    ratio = last / first
    if max(ratio, 1.0 / ratio) < 2.0:
        return f" ({ratio - 1.0:+.0%})"
    return f" ({ratio:.3g} times as much)" if ratio > 1.0 else f" (a factor of {1.0 / ratio:.3g} less)"


def _early(shape: Shape, x: Told) -> str:
    """Return a text with x where 90 % of a rise or fall is reached; empty if this is in the last third of the curve."""
    begin, end = shape.turns
    change = (shape.y[begin : end + 1] - shape.y[begin]) / (shape.y[end] - shape.y[begin])
    place = begin + int(np.nanargmax(change >= 0.9))
    early = place - begin <= 2.0 / 3.0 * (end - begin) and place > begin
    return f", nine tenths of the way at {x(place)}" if early else ""


def _near(shape: Shape, place: int, x: Told) -> str:
    low, high = shape.near(place)
    return f" (within {NEGLIGIBLE_LOSS:.0%} of it from {x(low)} to {x(high)})" if low < high else ""
