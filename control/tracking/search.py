"""Search for a way around obstacles, with a side and a distance for each obstacle.

The body is modelled as all points within its greatest half width w from a chord. The chord is as long as the body, has
its middle on the way and points along the way. A way is described by its offset e(s) to the left of the path, at the
arc length s of the path. An admissible way keeps the middle within the corridor, the body at least a margin away from
every obstacle, and the curvature below a bound. The best way has the lowest cost

    int e^2 + B^4 e''^2 ds                                                                                     (P2)

Because of this cost, an offset that no obstacle requires decays over the length B. The cost also decides whether each
obstacle is passed on the left or on the right. Let V_k(e, e') be the lowest cost up to point k of a grid over offsets e
and slopes e'. Dynamic programming minimises over the curvatures c:

    V_k(e, e') = least of V_{k-1}(e - e' ds, e' - c ds) + (e^2 + B^4 c^2) ds  over curvatures c                (P3)

From the best way on the grid, Ipopt, an interior-point method that comes with CasADi, finds the smooth way of lowest
cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy

from control.tracking.detour import Body, Detour, ahead
from control.tracking.obstacles import Obstacle, nearest
from control.tracking.paths import Path
from control.tracking.preview import TURNS_IN
from control.tracking.references import Reference
from worm3d.values.arrays import FloatArray, IntArray

GRID_STEP, GRID_CELL = 0.1, 0.01
"""Spacing of the grid along (`GRID_STEP`) and beside (`GRID_CELL`) the path [body lengths]. The slopes of ways on the
grid are multiples of 0.1, and their curvatures are multiples of 1 per body length."""
SHARPEST = 2.2
"""Greatest curvature of a way [1/body length]. On circles of 0.45 body lengths the worm has an offset of 0.003 body
lengths, at corners 0.012."""
BENDS = 0.8
"""Length B of (P2) [body lengths]. A detour of 0.3 body lengths then has a curvature of 0.6 per body length. With half
this length, detours have four times the curvature and the worm follows them less exactly. With twice this length,
detours are twice as long."""
MARGINS = (0.04, 0.025, 0.012)
"""Margins between the body and obstacles [body lengths], tried in this order until there is a way. The last margin
covers the error of following a curved way (0.005) and the error of the estimated position."""
SHARE_KEPT = 0.6
"""Share of the margin that a smooth way must keep everywhere. The rest may be lost between the points of the grid."""
FARTHEST = 3.0
"""Greatest offset that is searched if the corridor is wider [body lengths]. On a path without end, the search also ends
at this distance beyond the last obstacle, where the way returns to the path."""
FOLDED = 0.3
"""Smallest length of a way inside a bend, divided by the length of the path beside the way."""
ROUNDED = 1.2
"""Greatest accepted curvature of a smooth way between the points of the grid, divided by the greatest allowed
curvature."""
OBSTACLE_RANGE = 0.3
"""Distance from the body above which an obstacle sets no bound, and is ignored when a way is smoothed [body
lengths]."""
IPOPT_OPTIONS: dict[str, Any] = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 100}}
"""Options of Ipopt, which needs about 20 iterations."""
SLOPES, TURNS = np.arange(-8, 9), np.arange(-4, 5)
"""Slopes of the grid against the path [cells per step], up to 0.8, and possible changes of the slope between steps.
Offsets of up to 1 body length do not need steeper ways."""
CHORD = np.linspace(-0.5, 0.5, 11)
"""Distances are evaluated at these points of the chord [body lengths]."""


class NoWayError(ValueError):
    """There is no way past the given obstacle."""

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(f"no way leads past {obstacle!r}")
        self.obstacle = obstacle


class Search:
    """Search for one way. Offsets, steps and curvatures are in body lengths.

    Parameters
    ----------
    path : Path
    reference : Reference
        Reference that has the corridor and says whether the path ends.
    obstacles : tuple of Obstacle
    body : Body
    settled : ndarray, shape (K,)
        Offset of a point before the start of the way, followed by the fixed offsets of the first points [m].
    """

    def __init__(
        self, path: Path, reference: Reference, obstacles: tuple[Obstacle, ...], body: Body, settled: FloatArray
    ) -> None:
        self.path, self.obstacles, self.body = path, obstacles, body
        self.corridor, self.unit = reference.corridor / body.length, body.length
        outlines = [each.outline() for each in obstacles]
        length = path.length
        if not (reference.ends or path.closed):
            last = max((float(np.max(path.project(each))) for each in outlines), default=0.0)
            length = max(last, length if math.isfinite(length) else 0.0) + FARTHEST * self.unit
        steps = max(round(length / (GRID_STEP * self.unit)), len(settled) + 1)
        self.along = np.linspace(0.0, length, steps + 1)
        self.step = length / steps / self.unit
        around = TURNS_IN / 2.0 * self.unit
        self.curvature = np.asarray(path.heading(self.along + around) - path.heading(self.along - around)) / TURNS_IN
        self.sharpest = np.maximum(SHARPEST, np.abs(self.curvature))  # sharper corners of the path itself are allowed
        self.point, self.heading = path.point(self.along), path.heading(self.along)
        self.left = _across(self.heading)
        self.settled, self.first = settled / self.unit, len(settled) - 2
        self.end, self.end_change = 0.0, 0.0
        if path.closed:
            self.end, self.end_change = float(self.settled[1]), float(self.settled[1] - self.settled[0])
        here, reach = float(self.settled[-1]), self._reach(outlines)
        self.cells = here + GRID_CELL * np.arange(
            math.ceil((-reach - here) / GRID_CELL), math.floor((reach - here) / GRID_CELL) + 1
        )
        self.low = self.point.min(axis=0) - self.unit * (reach + 0.5 + GRID_STEP)

    def _reach(self, outlines: Sequence[FloatArray]) -> float:
        """Return the greatest offset that a way may need."""
        off = [np.linalg.norm(each[:, None] - self.point, axis=-1).min(axis=1) / self.unit for each in outlines]
        most = max((float(each.max()) for each in off if each.min() < FARTHEST), default=0.0)
        most = min(most + self.body.half_width / self.unit + MARGINS[0] + GRID_STEP, FARTHEST, self.corridor)
        return max(most, abs(float(self.settled[-1])) + GRID_CELL)

    def way(self) -> Detour:
        """Return the best way. NoWayError if there is none."""
        lost = self.first
        for margin in MARGINS:
            aside, reached = self._on_grid(margin)
            lost = max(lost, reached)
            smooth = None if aside is None else self._smoothed(aside, margin)
            if smooth is not None:
                way = self._made(smooth)
                if self._is_kept_by(way, SHARE_KEPT * margin):
                    return way
        raise NoWayError(min(self.obstacles, key=lambda each: float(each.distances(self.point[lost]))))

    def _bodies(self, k: IntArray | int, aside: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the positions and azimuths of bodies on ways with given offsets and slopes.

        `k` are the points of the path beside the bodies. The positions have the shape (..., 2) [m], the azimuths (...)
        [rad].
        """
        azimuth = self.heading[k] + np.arctan(slope / self._stretch(k, aside))
        return self.point[k] + self.unit * aside[..., None] * self.left[k], azimuth

    def _stretch(self, k: IntArray | int, aside: FloatArray) -> FloatArray:
        """Return the length of a way with given offsets, divided by the length of the path beside it."""
        return np.maximum(1.0 - self.curvature[k] * aside, FOLDED)

    @cached_property
    def _room(self) -> list[FloatArray]:
        """Distance of a body's chord from obstacles, for each point of the path.

        Each entry has the shape (E, M), for E offsets and M slopes.
        """
        found, slopes = [], np.asarray(SLOPES * GRID_CELL / self.step)
        free = self._field(self.point) > np.abs(self.cells).max() + 0.5 + self._need(MARGINS[0])
        for k in range(self.first, len(self.along)):
            aside = np.repeat(self.cells[:, None], len(slopes), axis=1)
            room = np.full(aside.shape, FARTHEST)
            if not free[k]:
                places, azimuth = self._bodies(k, aside, slopes)
                spots = places[..., None, :] + self.unit * CHORD[:, None] * ahead(azimuth)[..., None, :]
                room = self._field(spots).min(axis=-1)
            found.append(np.where(1.0 - self.curvature[k] * aside > FOLDED, room, -np.inf))
        return found

    @cached_property
    def _distance(self) -> FloatArray:
        """Distance from obstacles on a grid of places around the path. Its spacing is two cells."""
        spacing, high = 2.0 * GRID_CELL * self.unit, self.point.max(axis=0) + self.point.min(axis=0) - self.low
        axes = [np.arange(begin, end + spacing, spacing) for begin, end in zip(self.low, high, strict=True)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return np.minimum(nearest(self.obstacles, places) / self.unit, FARTHEST)

    def _field(self, places: FloatArray) -> FloatArray:
        """Return the distances of places from obstacles, interpolated linearly on the grid, shape (...).

        `places` has the shape (..., 2) [m].
        """
        at = np.moveaxis((places - self.low) / (2.0 * GRID_CELL * self.unit), -1, 0)
        return np.asarray(scipy.ndimage.map_coordinates(self._distance, at, order=1, mode="nearest"))

    def _on_grid(self, margin: float) -> tuple[FloatArray | None, int]:
        """Return the offsets of the best way on the grid, (P3), and the last point of the path that any way reaches.

        The offsets are None if there is no way.
        """
        needs, chosen = self._needs(margin, 2.0 * GRID_CELL), list[IntArray]()
        value = np.full(self._room[0].shape, np.inf)
        if self._begin_room < self._need(0.0):
            return None, self.first
        begin = self._row(float(self.settled[-1])), _column(float(self.settled[-1] - self.settled[-2]))
        value[begin] = 0.0
        for k, room in enumerate(self._room[1:], self.first + 1):
            value, turned = self._stepped(value, k - 1)
            value = np.where(room < needs[k], np.inf, value + self.step * self.cells[:, None] ** 2)
            chosen.append(turned)
            if not np.isfinite(value).any():
                return None, k
        goal = self._row(self.end), _column(self.end_change)
        return (self._traced(chosen, *goal) if np.isfinite(value[goal]) else None), len(self.along) - 1

    def _row(self, aside: float) -> int:
        return int(np.argmin(np.abs(self.cells - aside)))

    def _stepped(self, value: FloatArray, k: int) -> tuple[FloatArray, IntArray]:
        """Return the lowest costs (P3) one step after point `k`, for each offset and slope.

        The second result is the index in `TURNS` of the change of slope that leads there.
        """
        curvature = float(self.curvature[k])
        bend, stretch = TURNS * GRID_CELL / self.step**2, np.maximum(1.0 - curvature * self.cells, FOLDED)[:, None]
        sharp = np.abs(curvature / stretch + bend / stretch**2) > self.sharpest[k]
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
        """Return the offsets of the way that ends in the given row and column of the grid, shape (P,)."""
        rows = [row]
        for turned in reversed(chosen):
            turn = int(TURNS[turned[row, column]])
            row, column = row - int(SLOPES[column]), column - turn
            rows.append(row)
        return np.concatenate([self.settled[1:-1], self.cells[rows[::-1]]])

    def _smoothed(self, aside: FloatArray, margin: float) -> FloatArray | None:
        """Return the offsets of lowest cost (P2) near the given offsets, shape (P,).

        The settled offsets and the last offset are fixed. The result is None if no way near the given offsets keeps the
        body clear of obstacles.
        """
        k, h, free = np.arange(self.first, len(aside)), self.step, aside[self.first + 1 : -1]
        e = ca.SX.sym("e", len(free))
        padded = ca.vertcat(self.settled[-2:], e, self.end, self.end + self.end_change)
        own, slope = padded[1:-1], (padded[2:] - padded[:-2]) / (2.0 * h)
        bend = (padded[2:] - 2.0 * own + padded[:-2]) / h**2
        stretch = ca.fmax(1.0 - self.curvature[k] * own, FOLDED)
        turn = self.curvature[k] / stretch + bend / stretch**2
        azimuth = ca.SX(self.heading[k] + ca.atan(slope / stretch))
        room = self._rooms(k[1:-1], e, azimuth[1:-1])
        near = np.flatnonzero(np.asarray(ca.Function("near", [e], [room])(free)).ravel() < self._need(OBSTACLE_RANGE))
        cost = h * (ca.sumsqr(own) + BENDS**4 * ca.sumsqr(bend))
        programme = {"x": e, "f": cost, "g": ca.vertcat(turn, room[near.tolist()])}
        solver = ca.nlpsol("smooth", "ipopt", programme, IPOPT_OPTIONS)
        needs = np.tile(self._needs(margin, GRID_CELL / 2.0)[k[1:-1]], len(CHORD) * len(self.obstacles))
        least = np.append(-self.sharpest[k], needs[near])
        most = np.append(self.sharpest[k], np.full(len(near), np.inf))
        widest = max(self.corridor - GRID_CELL, 0.0)
        found = solver(x0=free, lbx=-widest, ubx=widest, lbg=least, ubg=most)
        if not solver.stats()["success"]:
            return None
        return np.concatenate([aside[: self.first + 1], np.asarray(found["x"]).ravel(), [self.end]])

    def _rooms(self, k: IntArray, aside: ca.SX, azimuth: ca.SX) -> ca.SX:
        """Return the distance of each point of the chords from each obstacle, as symbols.

        The bodies are at points `k`.
        """
        (x, y), (left_x, left_y), found = self.point[k].T, self.left[k].T, []
        for spot in CHORD:
            at_x = x + self.unit * (aside * left_x + spot * ca.cos(azimuth))
            at_y = y + self.unit * (aside * left_y + spot * ca.sin(azimuth))
            found += [each.formula(at_x.T, at_y.T).T / self.unit for each in self.obstacles]
        return ca.SX(ca.vertcat(*found))

    def _need(self, margin: float) -> float:
        """Return the distance of the chord from obstacles if the body keeps exactly the margin."""
        return self.body.half_width / self.unit + margin

    def _needs(self, margin: float, slack: float) -> FloatArray:
        """Return the required distance at each point of the path, shape (P,).

        Over the first body length, it is at most the initial distance, so that a worm that starts near an obstacle is
        allowed to stay as near.
        """
        needs = np.full(len(self.along), self._need(margin))
        near = slice(self.first, self.first + round(1.0 / self.step))
        needs[near] = min(self._need(margin), max(self._begin_room, self._need(slack)) - slack)
        return needs

    @cached_property
    def _begin_room(self) -> float:
        """Distance of the chord from obstacles at the start of the way."""
        aside, slope = self.settled[-1:], np.diff(self.settled[-2:]) / self.step
        places, azimuth = self._bodies(self.first, aside, slope)
        return self._need(float(self.body.clearance(self.obstacles, places, azimuth)[0]) / self.unit)

    def _made(self, e: FloatArray) -> Detour:
        kept = slice(-1) if self.path.closed else slice(None)
        aside, along = self.unit * e[kept], self.along[kept]
        points = self.point[kept] + aside[:, None] * self.left[kept]
        corridor = self.unit * self.corridor
        unbound = np.full((4, len(aside)), np.inf)
        way = Detour(points, self.path.closed, asked=self.path, along=along, aside=aside, bounds=unbound)
        room = [self._beside(way, side) for side in (1.0, -1.0)]
        return replace(way, bounds=np.array([corridor - aside, corridor + aside, *room]))

    def _beside(self, way: Detour, side: float) -> FloatArray:
        """Return how far a body on the way can move to one side before it touches an obstacle [m], shape (P,)."""
        azimuth = way.heading(way.lengths)
        moved = self.unit * GRID_CELL * np.arange(round(OBSTACLE_RANGE / GRID_CELL) + 1)
        places = way.points[:, None] + side * moved[:, None] * _across(azimuth)[:, None]
        touches = self.body.clearance(self.obstacles, places, np.repeat(azimuth[:, None], len(moved), axis=1)) < 0.0
        return np.where(touches.any(axis=1), moved[np.maximum(np.argmax(touches, axis=1) - 1, 0)], np.inf)

    def _is_kept_by(self, way: Detour, margin: float) -> bool:
        """Return whether a way keeps the margin, stays within the corridor, and is nowhere too sharp."""
        s = np.arange(float(way.lengths[self.first]), way.length, self.unit * GRID_CELL)
        clear = self.body.clearance(self.obstacles, way.point(s), way.heading(s)) / self.unit
        needs = np.interp(s, way.lengths, self._needs(margin, GRID_CELL)[: len(way.lengths)]) - self._need(0.0)
        aside = np.abs(way.aside[self.first :]).max()
        sharp, asked = (float(np.abs(path.curvature(s)).max()) * self.unit for path in (way, self.path))
        return bool(
            (clear >= needs).all()
            and aside <= (self.corridor + GRID_CELL) * self.unit
            and sharp <= ROUNDED * max(SHARPEST, asked)
        )


def _across(azimuth: FloatArray) -> FloatArray:
    return np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=-1)


def _column(change: float) -> int:
    """Return the column of the slope nearest to a change of the offset per step [body lengths]."""
    return int(np.argmin(np.abs(SLOPES * GRID_CELL - change)))
