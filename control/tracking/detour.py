"""The way that a worm follows where obstacles are beside its path: which side of each it passes, and how far off.

The body counts as all that lies within its greatest half width w of a chord as long as the body, which has its middle
on the way and lies along it. A way is an offset e(s) to the left of the path at its arc lengths s. It keeps the middle
within the corridor, the body at least a margin away from every obstacle, and its curvature below a bound. Of all such
ways it is the one with the least cost

    int e^2 + B^4 e''^2 ds                                                                                     (P2)

so that an offset that nothing asks for dies away over the length B. The side on which each obstacle is passed follows
from that cost: on a grid of offsets e and slopes e', dynamic programming finds the best of all ways,

    V_k(e, e') = least of V_{k-1}(e - e' ds, e' - c ds) + (e^2 + B^4 c^2) ds  over curvatures c                (P3)

and from there Gauss-Newton steps make it smooth, in which what the body lacks of its margin counts as a further miss.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
import scipy

from control.tracking.curves import PARTS
from control.tracking.obstacles import Obstacle, nearest
from control.tracking.paths import Path, SplinePath, offset
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.values.read_only import read_only

STEP, CELL = 0.1, 0.01
"""Spacing of the grid along the path and beside it [body lengths]: slopes differ by 0.1, curvatures by 1 per length."""
STEEPEST = 8
"""Greatest slope of a way against its path, in cells for each step: 0.8. Steeper ones are not needed within 1 BL."""
SHARPEST = 2.2
"""Greatest curvature of a way [1/body length]: on circles of 0.45 BL the offset is 0.003 BL, corners have 0.012."""
BENDS = 0.8
"""Length B of (P2) [body lengths]: a detour of 0.3 BL bends by 0.6 per body length. With half of it detours bend four
times as much and are followed less exactly, with twice of it they are twice as long."""
MARGINS = (0.04, 0.025, 0.012)
"""Distances from obstacles beyond the half width of the body [body lengths], the first with which there is a way. The
last is what a worm is beside a curved way, and what its place is unsure by."""
SHARE_KEPT = 0.6
"""Share of a margin that a smooth way keeps everywhere: between the steps of the grid it may lack the rest."""
FARTHEST = 3.0
"""Greatest offset that is tried where the corridor is wider [body lengths]."""
BEYOND = 3.0
"""Way beyond the last obstacle at the end of which a path without end is followed itself again [body lengths]."""
ROOM = 0.2
"""Greatest room beside the body that is looked for [body lengths]; more of it counts as no bound."""
LACK = 0.01
"""What the body lacks of its margin that weighs as much as an offset of 1 BL in the smooth way [body lengths]."""
SPOTS = 21
"""Number of spots along the chord at which the distance of the body is taken: circles around them miss 0.003 of it."""
FOLDED = 0.3
"""Share of its own length to which a path may shrink at an offset to the inside of its bends."""
FIELD = 0.02
"""Spacing of the grid on which the distance from obstacles is taken [body lengths]; the way that is found is checked
against the distances themselves."""
ROUNDED = 1.2
"""Share of the greatest curvature that a smooth way may have between the steps of the grid."""
LEAST_CHANGE, ROUNDS = 1e-4, 40
"""Change of an offset that ends the smoothing [body lengths], and the largest number of its steps."""
NEAR = 0.3
"""What the body may have more than its margin to be looked at in a step of the smoothing [body lengths]."""
SHARES = (1.0, 0.5, 0.25, 0.125, 0.03)
"""Shares of a step of the smoothing that are tried one after the other."""
SHIFT = 1e-9
"""Shift of the diagonal of its equations, without which rounding could make them singular."""
SLOPES, TURNS = np.arange(-STEEPEST, STEEPEST + 1), np.arange(-4, 5)
"""Slopes of the grid [cells per step], and how much a slope may change from step to step."""
CHORD = np.linspace(-0.5, 0.5, SPOTS // 2 + 1)
"""Spots along the chord that the search looks at [body lengths]."""


class Body(NamedTuple):
    """What a way has to know of a worm."""

    length: float
    """Length at rest [m]."""
    half_width: float
    """Greatest half width of a segment, at the end of its stroke [m]."""

    @classmethod
    def of(cls, worm: Worm) -> Self:
        """Return that of a worm: b + sqrt(a^2 - l^2/4), l being the shortest length of a segment."""
        shortest = worm.l0 * (1.0 - worm.stroke[1])
        rise = np.sqrt(np.maximum(worm.link_length**2 - shortest**2 / 4.0, 0.0))
        return cls(worm.length, worm.chamber_offset + float(rise.max()))

    def clearance(self, obstacles: Sequence[Obstacle], places: FloatArray, azimuths: FloatArray) -> FloatArray:
        """Return the distances of bodies at places (..., 2) [m] from obstacles, (...) [m]; below 0 inside."""
        along = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1)
        spots = places[..., None, :] + self.length * np.linspace(-0.5, 0.5, SPOTS)[:, None] * along[..., None, :]
        return np.asarray(nearest(obstacles, spots).min(axis=-1) - self.half_width)


@dataclass(frozen=True, eq=False)
class Detour(SplinePath):
    """A path around obstacles; its points lie at equal distances along the path that was asked for."""

    asked: Path = field(kw_only=True)
    """Path that was asked for."""
    along: FloatArray = field(kw_only=True)
    """Arc lengths of that path beside the points [m], shape (P,)."""
    aside: FloatArray = field(kw_only=True)
    """Offsets of the points to the left of it [m], shape (P,)."""
    bounds: FloatArray = field(kw_only=True)
    """How far the middle may be to the left and to the right of the way, and the body, [m], shape (4, P)."""
    unknown: tuple[Obstacle, ...] = field(kw_only=True, default=())
    """Obstacles that the worm comes to know of when they are near."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("along", "aside", "bounds"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def bounds_at(self, s: FloatArray) -> FloatArray:
        """Return the bounds at arc lengths (K,) of the way [m], shape (4, K)."""
        period = self.length if self.closed else None
        return np.array([np.interp(s, self.lengths, each, period=period) for each in self.bounds])

    @cached_property
    def lengths(self) -> FloatArray:
        """Arc lengths of the points along the way [m], shape (P,)."""
        return np.asarray(self._nodes[1][::PARTS][: len(self.points)])


class NoWayError(ValueError):
    """There is no way past an obstacle."""

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(f"no way leads past {obstacle!r}")
        self.obstacle = obstacle


class _Begin(NamedTuple):
    """Where a way begins."""

    aside: FloatArray
    """Offsets of its first points, which are settled [m], shape (K,)."""
    change: float
    """Change of the offset from the last but one to the last of them [m]."""


def led(reference: Reference, body: Body) -> Reference:
    """Return a reference whose path leads around those of its obstacles that are known from the start.

    Raises
    ------
    ValueError
        They leave no way.
    """
    path = reference.path
    if path is None or not reference.obstacles or isinstance(path, Detour):
        return reference
    known = tuple(each for each in reference.obstacles if not math.isfinite(each.sight))
    unknown = tuple(each for each in reference.obstacles if math.isfinite(each.sight))
    try:
        return _led(reference, path, known, unknown, body, _Begin(np.zeros(1), 0.0))
    except NoWayError as error:
        room = f"within the corridor ({reference.corridor:g} m)" if math.isfinite(reference.corridor) else "beside it"
        wide = 2.0 * (body.half_width + MARGINS[-1] * body.length)
        raise ValueError(
            f"obstacles[{reference.obstacles.index(error.obstacle)}]: got one past which no way leads, must leave one "
            f"{room}, {wide:.3g} m wide for this body, and room where the path begins and ends: move it, make it "
            "smaller, or widen the corridor"
        ) from error


def led_on(reference: Reference, body: Body, seen: Sequence[Obstacle], s: float) -> Reference:
    """Return a led reference that leads around obstacles that have come into sight, too, from arc length `s` [m] on.

    Raises
    ------
    NoWayError
        There is no way from there.
    """
    way = reference.path
    assert isinstance(way, Detour)
    lap = max(s, 0.0) % way.length if way.closed else s  # just before its begin nothing is settled
    here = int(np.clip(np.searchsorted(way.lengths, lap, side="right"), 2, len(way.aside) - 1))
    begin = _Begin(way.aside[:here], float(way.aside[here - 1] - way.aside[here - 2]))
    unknown = tuple(each for each in way.unknown if each not in seen)
    return _led(reference, way.asked, (*reference.obstacles, *seen), unknown, body, begin)


def led_from(reference: Reference, body: Body, place: FloatArray, azimuth: float) -> Reference:
    """Return a led reference whose way begins where the worm is, at a place (2,) [m] with an azimuth [rad].

    Raises
    ------
    NoWayError
        There is no way from there.
    """
    way = reference.path
    assert isinstance(way, Detour)
    s, spacing = float(way.asked.project(place)), float(way.along[1])
    here = int(np.clip(np.searchsorted(way.along, s, side="right"), 1, len(way.aside) - 1))
    steepest = STEEPEST * CELL / STEP
    turned = math.remainder(azimuth - float(way.asked.heading(s)), math.tau)
    slope = min(max(math.tan(min(max(turned, -1.0), 1.0)), -steepest), steepest)
    behind = np.maximum(way.along[:here] - s, -body.length)
    begin = _Begin(float(offset(way.asked, place, s)) + slope * behind, slope * spacing)
    return _led(reference, way.asked, reference.obstacles, way.unknown, body, begin)


def _led(
    reference: Reference,
    path: Path,
    known: tuple[Obstacle, ...],
    unknown: tuple[Obstacle, ...],
    body: Body,
    begin: _Begin,
) -> Reference:
    way = _Search(path, reference, known, body, begin).way()
    return replace(reference, path=replace(way, unknown=unknown), obstacles=known)


class _Search:
    """The search for a way; its offsets, steps and curvatures are in body lengths."""

    def __init__(
        self, path: Path, reference: Reference, obstacles: tuple[Obstacle, ...], body: Body, begin: _Begin
    ) -> None:
        self.path, self.obstacles, self.body = path, obstacles, body
        self.corridor, self.unit = reference.corridor / body.length, body.length
        outlines = [each.outline() for each in obstacles]
        length = path.length
        if not (reference.ends or path.closed):
            last = max((float(np.max(path.project(each))) for each in outlines), default=0.0)
            length = max(last, length if math.isfinite(length) else 0.0) + BEYOND * self.unit
        steps = max(round(length / (STEP * self.unit)), len(begin.aside) + 2)
        self.along = np.linspace(0.0, length, steps + 1)
        self.step = length / steps / self.unit
        self.curvature = np.asarray(path.curvature(self.along)) * self.unit
        self.point, self.heading = path.point(self.along), path.heading(self.along)
        self.left = _across(self.heading)
        self.settled, self.change = begin.aside / self.unit, begin.change / self.unit
        self.first = len(self.settled) - 1
        self.end, self.end_change = (float(self.settled[0]), self.change) if path.closed else (0.0, 0.0)
        if path.closed and self.first > 0:
            self.end_change = float(self.settled[1] - self.settled[0])
        here, reach = float(self.settled[-1]), self._reach(outlines)
        self.cells = here + CELL * np.arange(math.ceil((-reach - here) / CELL), math.floor((reach - here) / CELL) + 1)
        self.field = _Field(obstacles, self.point, self.unit * (reach + 0.5 + STEP), self.unit)

    def _reach(self, outlines: Sequence[FloatArray]) -> float:
        """Return the greatest offset that a way may need."""
        off = [np.linalg.norm(each[:, None] - self.point, axis=-1).min(axis=1) / self.unit for each in outlines]
        most = max((float(each.max()) for each in off if each.min() < FARTHEST), default=0.0)
        most = min(most + self.body.half_width / self.unit + MARGINS[0] + STEP, FARTHEST, self.corridor)
        return max(most, abs(float(self.settled[-1])) + CELL)

    def way(self) -> Detour:
        """Return the way; NoWayError if there is none."""
        lost = self.first
        for margin in MARGINS:
            aside, reached = self._on_grid(margin)
            lost = max(lost, reached)
            if aside is not None:
                way = self._made(self._smoothed(aside, margin))
                if self._is_kept_by(way, SHARE_KEPT * margin):
                    return way
        raise NoWayError(min(self.obstacles, key=lambda each: float(each.distances(self.point[lost]))))

    def _bodies(self, k: IntArray | int, aside: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (..., 2) [m] and azimuths (...) of bodies on ways at offsets and slopes beside points `k`."""
        azimuth = self.heading[k] + np.arctan(slope / self._stretch(k, aside))
        return self.point[k] + self.unit * aside[..., None] * self.left[k], azimuth

    def _stretch(self, k: IntArray | int, aside: FloatArray) -> FloatArray:
        """Return the length of a way at offsets (...) over that of the path beside it."""
        return np.maximum(1.0 - self.curvature[k] * aside, FOLDED)

    @cached_property
    def _room(self) -> list[FloatArray]:
        """Distance of the chords of bodies from obstacles, by offset and slope, each of shape (E, M)."""
        found, slopes = [], np.asarray(SLOPES * CELL / self.step)
        for k in range(self.first, len(self.along)):
            aside = np.repeat(self.cells[:, None], len(slopes), axis=1)
            places, azimuth = self._bodies(k, aside, slopes)
            spots = places[..., None, :] + self.unit * CHORD[:, None] * _ahead(azimuth)[..., None, :]
            room = self.field(spots).min(axis=-1)
            found.append(np.where(1.0 - self.curvature[k] * aside > FOLDED, room, -np.inf))
        return found

    def _on_grid(self, margin: float) -> tuple[FloatArray | None, int]:
        """Return the offsets of the best way, (P3), if there is one, and up to which point of the path one leads."""
        need, chosen = self.body.half_width / self.unit + margin, list[IntArray]()
        value = np.full(self._room[0].shape, np.inf)
        begin = self._row(float(self.settled[-1])), _column(self.change)
        if self._room[0][begin] < need - margin:
            return None, self.first
        value[begin] = 0.0
        for k, room in enumerate(self._room[1:], self.first + 1):
            value, turned = self._stepped(value, float(self.curvature[k - 1]))
            value = np.where(room < need, np.inf, value + self.step * self.cells[:, None] ** 2)
            chosen.append(turned)
            if not np.isfinite(value).any():
                return None, k
        goal = self._row(self.end), _column(self.end_change)
        return (self._traced(chosen, *goal) if np.isfinite(value[goal]) else None), len(self.along) - 1

    def _row(self, aside: float) -> int:
        return int(np.argmin(np.abs(self.cells - aside)))

    def _stepped(self, value: FloatArray, curvature: float) -> tuple[FloatArray, IntArray]:
        """Return the least costs (P3) after a step, by offset and slope, and which of `TURNS` led there."""
        bend, stretch = TURNS * CELL / self.step**2, np.maximum(1.0 - curvature * self.cells, FOLDED)[:, None]
        sharp = np.abs(curvature / stretch + bend / stretch**2) > SHARPEST
        cost = np.where(sharp, np.inf, self.step * BENDS**4 * bend**2)
        most, rows = len(TURNS) // 2, len(self.cells)
        padded = np.pad(value, ((0, 0), (most, most)), constant_values=np.inf)
        before = np.lib.stride_tricks.sliding_window_view(padded, len(TURNS), axis=1)[:, :, ::-1]
        total = before + cost[:, None]
        turned = np.argmin(total, axis=2)
        least = np.take_along_axis(total, turned[:, :, None], axis=2)[:, :, 0]
        moved, how = np.full_like(value, np.inf), np.zeros_like(turned)
        for column, slope in enumerate(SLOPES.tolist()):
            to, of = slice(max(slope, 0), rows + min(slope, 0)), slice(max(-slope, 0), rows - max(slope, 0))
            moved[to, column], how[to, column] = least[of, column], turned[of, column]
        return moved, how

    def _traced(self, chosen: Sequence[IntArray], row: int, column: int) -> FloatArray:
        """Return the offsets of all points of the way that ends in a row and a column, shape (P,)."""
        rows = [row]
        for turned in reversed(chosen):
            turn = int(TURNS[turned[row, column]])
            row, column = row - int(SLOPES[column]), column - turn
            rows.append(row)
        return np.concatenate([self.settled[:-1], self.cells[rows[::-1]]])

    def _smoothed(self, aside: FloatArray, margin: float) -> FloatArray:
        """Return offsets (P,) near those given that have the least cost (P2), all but the settled ones and the last."""
        e, free, need = aside.copy(), slice(self.first + 1, -1), self.body.half_width / self.unit + margin
        e[-1] = self.end
        misses, slopes, limits = self._misses(e, need)
        for _ in range(ROUNDS):
            change, cost = _step(misses, slopes[:, free], limits), _cost(misses, limits)
            for share in SHARES:
                trial = e.copy()
                trial[free] += share * change
                misses, slopes, limits = self._misses(trial, need)
                if _cost(misses, limits) < cost:
                    break
            else:
                return e
            e = trial
            if np.abs(share * change).max() < LEAST_CHANGE:
                break
        return e

    def _misses(self, e: FloatArray, need: float) -> tuple[FloatArray, scipy.sparse.csr_array, int]:
        """Return misses (R,) whose squares sum up to (P2), their derivatives to offsets (P,), and how many are limits.

        The limits are the last ones, and count only where they are above 0.
        """
        n, k, h = len(e), np.arange(self.first, len(e)), self.step
        padded = np.concatenate([[e[self.first] - self.change], e[k], [e[-1] + self.end_change]])
        slope, bend = (padded[2:] - padded[:-2]) / (2.0 * h), np.diff(padded, 2) / h**2
        own, after, before = (scipy.sparse.eye_array(n, k=shift, format="csr")[k] for shift in (0, 1, -1))
        to_slope, to_bend = (after - before) / (2.0 * h), (after + before - 2.0 * own) / h**2
        stretch = self._stretch(k, e[k])
        turn = self.curvature[k] / stretch + bend / stretch**2
        sharper, bends = (
            LACK * np.sign(turn),
            self.curvature[k] * (self.curvature[k] + 2.0 * bend / stretch) / stretch**2,
        )
        rows, derivatives = [e[k], BENDS**2 * bend], [own, BENDS**2 * to_bend]
        lacks = [
            (np.abs(e[k]) - self.corridor + CELL, _times(np.sign(e[k]), own)),
            (LACK * (np.abs(turn) - SHARPEST), _times(sharper / stretch**2, to_bend) + _times(sharper * bends, own)),
        ]
        places, azimuth = self._bodies(k, e[k], slope)
        to_turn, inwards = np.array([stretch, slope * self.curvature[k]]) / (stretch**2 + slope**2)
        for spot in CHORD:
            distance, gradient = self.field.linear(places + self.unit * spot * _ahead(azimuth))
            turned = spot * (gradient * _across(azimuth)).sum(axis=1)
            aside = (gradient * self.left[k]).sum(axis=1) + turned * inwards
            lacks.append((need - distance, -_times(aside, own) - _times(turned * to_turn, to_slope)))
        for lack, to in lacks:
            near = lack > -NEAR
            rows.append(lack[near] / LACK)
            derivatives.append(to[near] / LACK)
        weight, limits = np.sqrt(h), sum(map(len, rows[2:]))
        return weight * np.concatenate(rows), weight * scipy.sparse.vstack(derivatives, format="csr"), limits

    def _made(self, e: FloatArray) -> Detour:
        kept = slice(-1) if self.path.closed else slice(None)
        aside, along = self.unit * e[kept], self.along[kept]
        points = self.point[kept] + aside[:, None] * self.left[kept]
        corridor = self.unit * self.corridor
        unbound = np.full((4, len(aside)), np.inf)
        way = Detour(points, self.path.closed, asked=self.path, along=along, aside=aside, bounds=unbound)
        room = [self._rooms(way, side) for side in (1.0, -1.0)]
        return replace(way, bounds=np.array([corridor - aside, corridor + aside, *room]))

    def _rooms(self, way: Detour, side: float) -> FloatArray:
        """Return how far bodies on a way can be moved to a side before they touch something [m], shape (P,)."""
        azimuth = way.heading(way.lengths)
        moved = self.unit * CELL * np.arange(round(ROOM / CELL) + 1)
        places = way.points[:, None] + side * moved[:, None] * _across(azimuth)[:, None]
        touches = self.body.clearance(self.obstacles, places, np.repeat(azimuth[:, None], len(moved), axis=1)) < 0.0
        return np.where(touches.any(axis=1), moved[np.maximum(np.argmax(touches, axis=1) - 1, 0)], np.inf)

    def _is_kept_by(self, way: Detour, margin: float) -> bool:
        """Return whether the body keeps a margin along a way, which stays in the corridor and is not too sharp."""
        begin = float(way.lengths[self.first])
        s = np.arange(begin, way.length, self.unit * CELL)
        clear = self.body.clearance(self.obstacles, way.point(s), way.heading(s))
        aside = np.abs(way.aside[self.first :]).max()
        clear = clear[s > begin + STEP * self.unit]  # where it begins it may be nearer
        sharp = np.abs(way.curvature(s)).max() * self.unit
        return bool(
            clear.min(initial=np.inf) >= margin * self.unit
            and aside <= (self.corridor + CELL) * self.unit
            and sharp <= ROUNDED * max(SHARPEST, float(np.abs(self.curvature).max()))
        )


class _Field:
    """Distance from obstacles around a path [body lengths], taken at places of a grid; linear between them."""

    def __init__(self, obstacles: Sequence[Obstacle], points: FloatArray, around: float, unit: float) -> None:
        self.low, self.unit, self.spacing = points.min(axis=0) - around, unit, FIELD * unit
        axes = [low + self.spacing * np.arange(size / self.spacing + 2.0) for low, size in self._sides(points, around)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self.values = np.minimum(nearest(obstacles, places) / unit, FARTHEST)

    def _sides(self, points: FloatArray, around: float) -> list[tuple[float, float]]:
        return list(zip(self.low.tolist(), (np.ptp(points, axis=0) + 2.0 * around).tolist(), strict=True))

    def __call__(self, places: FloatArray) -> FloatArray:
        """Return the distances of places (..., 2) [m]."""
        return self.linear(places)[0]

    def linear(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances of places (..., 2) [m], and their gradients (..., 2)."""
        at = np.clip((places - self.low) / self.spacing, 0.0, np.array(self.values.shape) - 1.001)
        (i, j), (x, y) = np.moveaxis(at.astype(int), -1, 0), np.moveaxis(at % 1.0, -1, 0)
        a, b, c, d = self.values[i, j], self.values[i + 1, j], self.values[i, j + 1], self.values[i + 1, j + 1]
        distance = (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d)
        rises = [(1 - y) * (b - a) + y * (d - c), (1 - x) * (c - a) + x * (d - b)]
        return distance, np.stack(rises, axis=-1) / FIELD


def _cost(misses: FloatArray, limits: int) -> float:
    """Return the sum of the squares of misses, of which the last `limits` count only above 0."""
    counted = np.concatenate([misses[: len(misses) - limits], np.maximum(misses[len(misses) - limits :], 0.0)])
    return float(counted @ counted)


def _step(misses: FloatArray, slopes: scipy.sparse.csr_array, limits: int) -> FloatArray:
    """Return the change (P,) after which the squares of linear misses, and of limits above 0, have the least sum."""
    change, rows, counts = np.zeros(slopes.shape[1]), np.arange(len(misses)), np.zeros(len(misses), dtype=bool)
    for _ in range(ROUNDS):
        before, counts = counts, (rows < len(misses) - limits) | (misses + slopes @ change > 0.0)
        if (counts == before).all():
            break
        of = slopes[counts]
        hessian = (of.T @ of).toarray() + SHIFT * np.eye(len(change))
        change = -np.linalg.solve(hessian, of.T @ misses[counts])
    return change


def _ahead(azimuth: FloatArray) -> FloatArray:
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


def _across(azimuth: FloatArray) -> FloatArray:
    return np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=-1)


def _column(change: float) -> int:
    """Return the column of the slope nearest to a change of the offset in a step [body lengths]."""
    return int(np.argmin(np.abs(SLOPES * CELL - change)))


def _times(factors: FloatArray, rows: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    return scipy.sparse.csr_array(scipy.sparse.diags_array(factors) @ rows)
