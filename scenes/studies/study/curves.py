"""Shape of a curve, found from its values and put into a sentence: rising, falling, a peak, a dip, flat, or several.

Values have errors. The difference of two values counts as zero if it is at most the sum of their errors: `apart`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray

MAX_FLAT_CHANGE = 0.05
"""Largest relative change, over the largest magnitude, of a curve that hardly depends on x."""
RIPPLE = 0.05
"""Change against the trend, over the whole change, that is ignored: half as much would report the noise of time steps,
twice as much would miss the dip at half a wavelength."""
NEGLIGIBLE_LOSS = 0.05
"""Loss relative to the best value that hardly matters."""
AT_END, AT_GAP = "the range ends there", "the values end there"

Told = Callable[[int], str]
"""Text for a place."""


def apart(first: Any, second: Any, off: Any, other_off: Any) -> NDArray[np.bool_]:
    """Return whether values differ by more than the sum of their errors."""
    return np.asarray(np.abs(first - second) > off + other_off)


@dataclass(frozen=True)
class Shape:
    """Turning points of a curve, including the first and the last value."""

    y: FloatArray
    """Values, NaN where there is no value."""
    off: FloatArray
    """Errors of the values; 0 where the error is unknown."""
    turns: tuple[int, ...]
    """Places of the ends and of the extremes between them, without ripples; empty for fewer than two known values."""
    flat: bool

    @classmethod
    def of(cls, y: FloatArray, off: FloatArray | None = None) -> Shape:
        """Return the shape of a curve with values, shape (X,), NaN where there is no value, and errors, shape (X,)."""
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
        """`none`, `flat`, `rises`, `falls`, `peak`, `dip`, or `several` extremes."""
        if not self.turns or self.flat:
            return "flat" if self.turns else "none"
        rising = bool(self.y[self.turns[1]] > self.y[self.turns[0]])
        if len(self.turns) == 2:
            return "rises" if rising else "falls"
        return ("peak" if rising else "dip") if len(self.turns) == 3 else "several"

    def best(self, better: str) -> int:
        """Return the place of the best value; the largest value if neither `more` nor `less` is better."""
        return int(np.nanargmin(self.y) if better == "less" else np.nanargmax(self.y))

    def level(self, place: int) -> list[int]:
        """Return the places whose values are not apart from the value at a given place, including this place."""
        alike = ~apart(self.y, self.y[place], self.off, self.off[place]) & np.isfinite(self.y)
        return [int(k) for k in np.flatnonzero(alike)]

    def edge(self, place: int) -> str:
        """Return how the curve ends beside a place; empty where there are values on both sides."""
        if len(self.y) > 1 and place in (0, len(self.y) - 1):
            return AT_END
        return AT_GAP if np.isnan(self.y[max(0, place - 1) : place + 2]).any() else ""

    def near(self, place: int) -> tuple[int, int]:
        """Return the first and the last place of the range around a place with nearly the same value."""
        alike = np.abs(self.y - self.y[place]) <= NEGLIGIBLE_LOSS * abs(float(self.y[place]))
        low = high = place
        while low > 0 and alike[low - 1]:
            low -= 1
        while high < len(alike) - 1 and alike[high + 1]:
            high += 1
        return low, high


def _resolved(y: FloatArray, off: FloatArray) -> bool:
    """Return whether the largest and the least value are apart."""
    most, least = int(np.nanargmax(y)), int(np.nanargmin(y))
    return bool(apart(y[most], y[least], off[most], off[least]))


def _turns(y: FloatArray, off: FloatArray, known: np.ndarray, tolerance: float) -> tuple[int, ...]:
    """Return the places of the ends and of the extremes that exceed both a tolerance and their errors."""
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
    """Return a sentence on a curve, without the final stop.

    Parameters
    ----------
    shape : Shape
    what, along : str
        Words for the values and for x.
    x, told : callable
        Text of the value of x at a place, and of the value of y there, with its error.
    better : str
        `more` or `less`; empty if neither.
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
            return f"{what} is {most} at {x(top)}: {told(top)}{near}, beside {first} and {last}"
    where = f"; best at {_best(shape, x, better)}" if better else ""
    return f"{what} goes up and down with {along}: " + ", ".join(at) + where


def _unresolved(shape: Shape) -> str:
    differ = np.nanmax(shape.y) > np.nanmin(shape.y)
    return ", no further apart than their errors" if differ and not _resolved(shape.y, shape.off) else ""


def _best(shape: Shape, x: Told, better: str) -> str:
    """Return the place of the best value, and the places whose values are level with the best value."""
    best = shape.best(better)
    level = [x(k) for k in shape.level(best) if k != best]
    return x(best) + (f", level with {', '.join(level)}" if level else "")


def factor(y: FloatArray, shape: Shape) -> str:
    """Return the change of a value from the first to the last place, in brackets."""
    first, last = float(y[shape.turns[0]]), float(y[shape.turns[-1]])
    if first * last <= 0.0 or first == last:
        return ""
    ratio = last / first
    if max(ratio, 1.0 / ratio) < 2.0:
        return f" ({ratio - 1.0:+.0%})"
    return f" ({ratio:.3g} times as much)" if ratio > 1.0 else f" (a factor of {1.0 / ratio:.3g} less)"


def _early(shape: Shape, x: Told) -> str:
    """Return the place where most of a rise or fall is reached, if this place is in the first two thirds."""
    begin, end = shape.turns
    change = (shape.y[begin : end + 1] - shape.y[begin]) / (shape.y[end] - shape.y[begin])
    place = begin + int(np.nanargmax(change >= 0.9))
    early = place - begin <= 2.0 / 3.0 * (end - begin) and place > begin
    return f", nine tenths of the way at {x(place)}" if early else ""


def _near(shape: Shape, place: int, x: Told) -> str:
    low, high = shape.near(place)
    return f" (within {NEGLIGIBLE_LOSS:.0%} of it from {x(low)} to {x(high)})" if low < high else ""
