"""Shape of a curve, found from its values and told in a sentence: rising, falling, a peak, a dip, flat, or several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from worm3d.values.arrays import FloatArray

FLAT = 0.05
"""Change of a curve, over its largest magnitude, up to which it hardly depends on x."""
RIPPLE = 0.05
"""Change against the trend, over the whole change, that is none: half as much would name the noise of steps in time,
twice as much would pass over the dip at half a wavelength."""
NEAR = 0.05
"""Loss against the best value that hardly matters."""
MOST = 0.9
"""Share of a change after which the rest matters little."""
EARLY = 2.0 / 3.0
"""Share of the places up to which `MOST` of a change is worth telling."""

Told = Callable[[float], str]


@dataclass(frozen=True)
class Shape:
    """Turning points of a curve, first and last value included."""

    y: FloatArray
    """Values, NaN where there is none."""
    turns: tuple[int, ...]
    """Places of the ends and of the extremes between them, ripples left out; fewer than two known values: none."""
    flat: bool

    @classmethod
    def of(cls, y: FloatArray) -> Shape:
        """Return the shape of a curve of values (X,), NaN where there is none."""
        known = np.flatnonzero(np.isfinite(y))
        if len(known) < 2:
            return cls(y, (), flat=False)
        span = float(np.ptp(y[known]))
        return cls(y, _turns(y, known, RIPPLE * span), flat=span <= FLAT * float(np.abs(y[known]).max()))

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
        """Return the place of the best value, the largest one if neither `more` nor `less` is better."""
        return int(np.nanargmin(self.y) if better == "less" else np.nanargmax(self.y))

    def near(self, place: int) -> tuple[int, int]:
        """Return the first and the last place about one from which on its value is hardly lost."""
        alike = np.abs(self.y - self.y[place]) <= NEAR * abs(float(self.y[place]))
        low = high = place
        while low > 0 and alike[low - 1]:
            low -= 1
        while high < len(alike) - 1 and alike[high + 1]:
            high += 1
        return low, high


def _turns(y: FloatArray, known: np.ndarray, tolerance: float) -> tuple[int, ...]:
    """Return the places of the ends and of the extremes of a curve that stand out by more than a tolerance."""
    turns, extreme, way = [int(known[0])], int(known[0]), 0
    for place in map(int, known[1:]):
        ahead = float(y[place] - y[extreme])
        if way == 0 and abs(ahead) > tolerance:
            way, extreme = (1 if ahead > 0.0 else -1), place
        elif way * ahead > 0.0:
            extreme = place
        elif way and -way * ahead > tolerance:
            turns.append(extreme)
            way, extreme = -way, place
    return (*turns, int(known[-1]))


def sentence(y: FloatArray, what: str, along: str, x: Callable[[int], str], told: Told, better: str = "") -> str:
    """Return a sentence on a curve, without its final stop.

    Parameters
    ----------
    y : ndarray, shape (X,)
        Values, NaN where there is none.
    what, along : str
        Words for the values and for x.
    x : callable
        Text of the value of x at a place.
    told : callable
        Text of a value of y.
    better : str
        `more` or `less`; empty if neither.
    """
    shape = Shape.of(y)
    low, high = (told(float(end(y))) if np.isfinite(y).any() else "" for end in (np.nanmin, np.nanmax))
    at = [f"{told(float(y[k]))} at {x(k)}" for k in shape.turns]
    match shape.kind:
        case "none":
            return f"{what} is known at one value of {along} alone, {low} at {x(int(np.nanargmax(y)))}" if low else (
                f"{what} is known nowhere"
            )  # fmt: skip
        case "flat":
            return f"{what} hardly depends on {along}: {low} to {high}"
        case "rises" | "falls" as way:
            return f"{what} {way} with {along}, from {at[0]} to {at[-1]}{factor(y, shape)}{_early(shape, x)}"
        case "peak" | "dip" as kind:
            first, middle, last = at
            most = "greatest" if kind == "peak" else "least"
            near = _near(shape, shape.turns[1], x) if (kind == "peak") == (better != "less") else ""
            return (
                f"{what} is {most} at {x(shape.turns[1])}: {middle.split(' at ')[0]}{near}, beside {first} and {last}"
            )
    best = f"; best at {x(shape.best(better))}" if better else ""
    return f"{what} goes up and down with {along}: " + ", ".join(at) + best


def factor(y: FloatArray, shape: Shape) -> str:
    """Return by how much a value changes from the first to the last place, in brackets."""
    first, last = float(y[shape.turns[0]]), float(y[shape.turns[-1]])
    if first * last <= 0.0 or first == last:
        return ""
    ratio = last / first
    if max(ratio, 1.0 / ratio) < 2.0:
        return f" ({ratio - 1.0:+.0%})"
    return f" ({ratio:.3g} times as much)" if ratio > 1.0 else f" (a factor of {1.0 / ratio:.3g} less)"


def _early(shape: Shape, x: Callable[[int], str]) -> str:
    """Return where most of a rise or fall is reached, if that is early."""
    begin, end = shape.turns
    change = (shape.y[begin : end + 1] - shape.y[begin]) / (shape.y[end] - shape.y[begin])
    place = begin + int(np.nanargmax(change >= MOST))
    early = place - begin <= EARLY * (end - begin) and place > begin
    return f", nine tenths of the way at {x(place)}" if early else ""


def _near(shape: Shape, place: int, x: Callable[[int], str]) -> str:
    low, high = shape.near(place)
    return f" (within {NEAR:.0%} of it from {x(low)} to {x(high)})" if low < high else ""
