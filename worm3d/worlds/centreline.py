"""Centre lines of pipes.

A centre line is a chain of straight pieces and circular arcs without kinks, and continues straight beyond both ends.

A smooth curve through points is computed as a cubic spline, which is then replaced by pairs of arcs. Such a biarc
joins two points p_1 and p_2 with the tangents t_1 and t_2 by two arcs that meet without a kink (Bolton, "Biarc curves",
1975; in space Sharrock, "Biarcs in three dimensions", 1987). The tangents at the two ends of an arc intersect at its
corner. The corners are p_1 + d t_1 and p_2 - d t_2, with the same distance d from the ends. With v = p_2 - p_1, the
condition that the corners are 2 d apart is

    2 (1 - t_1.t_2) d^2 + 2 v.(t_1 + t_2) d - v.v = 0,

and the arcs meet half-way between the corners.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly, read_only
from worm3d.values.spelling import Spelled, spelled

Side = Literal["left", "right", "up", "down"]

LONGEST_ARC = np.pi / 2.0
"""Largest angle of an arc that is not divided [rad]. The nearest point of an arc is searched between the normal planes
at its ends, which works only for short arcs."""

SAMPLED = 0.05
"""Distance between the samples of the line that test a value of `Centreline.reach`, as a fraction of the reach."""

LARGEST_TURN = 200.0 * np.pi
"""Largest angle of a bend, a hundred full turns [rad]."""

MOST_PIECES = 100_000
"""Largest number of pieces of a centre line, enough for a spline through 12,000 points. It is also the largest number
of samples that test a value of `Centreline.reach`. The reach of a line that needs more samples is unknown, and is set
to 0."""

ROUNDING = 1e-9
"""Lengths [m], angles [rad] and differences of unit vectors up to this size are treated as rounding errors."""


@dataclass(frozen=True)
class Straight(Spelled):
    """A straight piece of a pipe, with its length [m]."""

    length: float

    def __post_init__(self) -> None:
        arguments.number("length", self.length, "m", gt=0.0)


@dataclass(frozen=True)
class Bend(Spelled):
    """A circular arc.

    Attributes
    ----------
    angle : float
        Angle of the turn [rad].
    radius : float
        Radius of the centre line [m].
    towards : str
        "left", "right", "up" or "down", as seen when looking along the pipe.
    """

    angle: float
    radius: float
    towards: Side = "left"

    def __post_init__(self) -> None:
        arguments.number("angle", self.angle, "rad", gt=0.0, le=LARGEST_TURN)
        arguments.number("radius", self.radius, "m", gt=0.0)
        arguments.choice("towards", self.towards, get_args(Side))


@dataclass(frozen=True, eq=False)
class Centreline(ReadOnly):
    """A centre line as a chain of pieces of constant curvature; frozen, with read-only arrays.

    The constructors are `of` (straight pieces and bends) and `through` (points). Distances along the line are measured
    from its start.

    Attributes
    ----------
    start, tangent, normal : ndarray, shape (M, 3)
        Start of each piece [m], unit tangent there, and unit vector towards the centre of the arc. For a straight
        piece, `normal` is any unit vector normal to the tangent.
    curvature : ndarray, shape (M,)
        Curvature of each piece [1/m], 0 for a straight piece.
    length : ndarray, shape (M,)
        Length of each piece [m].

    Raises
    ------
    ValueError
        An array has the wrong shape, a piece has no length, or two neighbouring pieces have a gap or a kink between
        them.
    """

    start: FloatArray
    tangent: FloatArray
    normal: FloatArray
    curvature: FloatArray
    length: FloatArray

    def __post_init__(self) -> None:
        length = arguments.array("length", self.length, ("M",), gt=0.0)
        shape = (len(length), 3)
        arrays = {name: arguments.array(name, getattr(self, name), shape) for name in ("start", "tangent", "normal")}
        curvature = arguments.array("curvature", self.curvature, shape[:1], ge=0.0)
        vars(self).update(**arrays, curvature=curvature, length=length)
        if len(length) > MOST_PIECES:
            raise ValueError(f"length: got {len(length)} pieces, must be at most {MOST_PIECES}; take longer ones")
        self._require_smooth()

    def _require_smooth(self) -> None:
        ends, tangents = self._run(np.arange(len(self.length)), self.length)
        gap = np.linalg.norm(ends[:-1] - self.start[1:], axis=1)
        kink = np.linalg.norm(tangents[:-1] - self.tangent[1:], axis=1)
        if len(gap) and max(gap.max(), kink.max()) > ROUNDING:
            k = int(np.argmax(np.maximum(gap, kink)))
            raise ValueError(f"centreline: pieces {k} and {k + 1} do not meet without a kink; put a bend between them")

    @classmethod
    @spelled
    def of(
        cls,
        pieces: Sequence[Straight | Bend],
        start: ArrayLike = (0.0, 0.0, 0.0),
        heading: float = 0.0,
        tilt: float = 0.0,
    ) -> Centreline:
        """Return the centre line that consists of the given straight pieces and bends.

        Parameters
        ----------
        pieces : sequence of Straight and Bend
        start : array_like, shape (3,)
            Start of the line [m].
        heading : float
            Azimuth of the first piece [rad].
        tilt : float
            Angle of the first piece with the horizontal [rad]. With pi/2 the piece goes straight up.
        """
        at = arguments.array("start", start, (3,))
        heading, tilt = (arguments.number(*given, "rad") for given in (("heading", heading), ("tilt", tilt)))
        _require_pieces(pieces)
        level = np.array([-np.sin(heading), np.cos(heading), 0.0])
        ahead = np.cos(tilt) * np.array([np.cos(heading), np.sin(heading), 0.0]) + [0.0, 0.0, np.sin(tilt)]
        rows: list[tuple[FloatArray, FloatArray, FloatArray, float, float]] = []
        frame = np.array([ahead, level, np.cross(ahead, level)])
        for piece in pieces:
            count = 1 if isinstance(piece, Straight) else int(np.ceil(piece.angle / LONGEST_ARC - ROUNDING))
            for _ in range(count):
                at, frame = _append(rows, piece, count, at, frame)
        return cls(*map(np.array, zip(*rows, strict=True)))

    @classmethod
    @spelled
    def through(cls, points: ArrayLike, spans: int = 4) -> Centreline:
        """Return a smooth centre line through points, as a cubic spline replaced by pairs of arcs (biarcs).

        The line passes through the points. Between two points, the positions and tangents of line and spline also agree
        at `spans` - 1 further places. Distances from the line are exact distances from the arcs. Two points give a
        straight line.

        Parameters
        ----------
        points : array_like, shape (P, 3)
            At least two points [m]. A point must not coincide with the next point.
        spans : int
            Number of pairs of arcs between two points.

        Raises
        ------
        ValueError
            There are fewer than two points or too many, neighbouring points coincide, or the line bends too sharply.
        """
        given = arguments.array("points", points, ("P", 3), least=2)
        arguments.whole("spans", spans, le=100)
        if 2 * spans * (len(given) - 1) > MOST_PIECES:
            most = MOST_PIECES // (2 * spans) + 1
            raise ValueError(f"points: got {len(given)}, must be at most {most} with spans = {spans}; take fewer")
        if not (np.linalg.norm(np.diff(given, axis=0), axis=1) > 0.0).all():
            raise ValueError("points: two that follow each other coincide; leave one of them out")
        return cls(*_biarcs(*_samples(given, spans)))

    @cached_property
    def ends(self) -> FloatArray:
        """Distances of the ends of the pieces from the start, along the line, shape (M,) [m]."""
        return np.asarray(read_only(np.cumsum(self.length)))

    @property
    def total(self) -> float:
        """Length of the line [m]."""
        return float(self.ends[-1])

    @property
    def straight(self) -> bool:
        """Whether the line has no bend."""
        return not bool(self.curvature.any())

    @cached_property
    def reach(self) -> float:
        """Distance from the line within which each point has a unique nearest place on the line [m].

        A reach r is valid (Federer 1959, Curvature measures) under two conditions. No bend has a radius smaller than r,
        and places that are pi r or more apart along the line are 2 r or more apart in space. The reach is 0 for a line
        that crosses itself, and for a line that would need too many samples (`MOST_PIECES`).
        """
        least = max(SAMPLED * float(self.length.min()), self.total / (SAMPLED * MOST_PIECES))
        longest = min(self.total, 1.0 / float(self.curvature.max())) if self.curvature.any() else self.total
        reach = (1.0 - SAMPLED) * longest
        while reach > least and not self._is_apart(reach):
            reach *= 0.8
        return reach if reach > least else 0.0

    def _is_apart(self, reach: float) -> bool:
        """Return whether places at least pi `reach` apart along the line are at least 2 `reach` apart in space."""
        import scipy  # slow to import, and rarely needed

        beyond = float(np.linalg.norm(np.ptp(self.start, axis=0))) + self.total / len(self.length) + 4.0 * reach
        count = int(np.ceil((self.total + 2.0 * beyond) / (SAMPLED * reach))) + 1
        along, step = np.linspace(-beyond, self.total + beyond, count, retstep=True)
        places, near = self.at(along)[0], 2.0 * reach + 1.001 * float(step)
        tree, beside = scipy.spatial.KDTree(places), range(1, math.ceil(np.pi * reach / float(step) - 1.0))
        # Pairs are counted instead of listed, because the pairs of a line that often returns to itself may fill the
        # memory.
        of_neighbours = sum(int((np.linalg.norm(places[k:] - places[:-k], axis=1) <= near).sum()) for k in beside)
        return int(tree.count_neighbors(tree, near)) == count + 2 * of_neighbours

    def at(self, along: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return points [m] and unit tangents at distances `along` [m] from the start.

        If `along` has the shape (...), both results have the shape (..., 3).
        """
        s = np.asarray(along, dtype=float)
        begins = self.ends - self.length
        k = np.clip(np.searchsorted(begins, s, side="right") - 1, 0, len(begins) - 1)
        inside = np.clip(s, 0.0, self.total)
        points, tangents = self._run(k, inside - begins[k])
        return points + (s - inside)[..., None] * tangents, tangents

    def _run(self, k: NDArray[np.int64], way: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points and tangents at distances `way` from the starts of the pieces k."""
        kappa = self.curvature[k]
        turn = kappa * way
        bent = kappa > 0.0
        safe = np.where(bent, kappa, 1.0)
        ahead = np.where(bent, np.sin(turn) / safe, way)[..., None]
        aside = np.where(bent, (1.0 - np.cos(turn)) / safe, 0.0)[..., None]
        tangents = np.cos(turn)[..., None] * self.tangent[k] + np.sin(turn)[..., None] * self.normal[k]
        return self.start[k] + ahead * self.tangent[k] + aside * self.normal[k], tangents


def _append(
    rows: list[tuple[FloatArray, FloatArray, FloatArray, float, float]],
    piece: Straight | Bend,
    count: int,
    at: FloatArray,
    frame: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Append a straight piece, or one of the `count` equal parts of a bend, to the rows of a `Centreline`.

    `at` and `frame` are the point and the axes (ahead, left, up) at the start. Return point and axes at the end.
    """
    t, left, up = frame
    if isinstance(piece, Straight):
        rows.append((at, t, left, 0.0, piece.length))
        return at + piece.length * t, frame
    n = {"left": left, "right": -left, "up": up, "down": -up}[piece.towards]
    turn = piece.angle / count
    rows.append((at, t, n, 1.0 / piece.radius, turn * piece.radius))
    end = at + piece.radius * (np.sin(turn) * t + (1.0 - np.cos(turn)) * n)
    axis = np.cross(t, n)
    return end, np.array(
        [v * np.cos(turn) + np.cross(axis, v) * np.sin(turn) + axis * (axis @ v) * (1 - np.cos(turn)) for v in frame]
    )


def _require_pieces(pieces: Any) -> None:
    arguments.instance("pieces", pieces, list | tuple, "a list of Straight and Bend")
    if not pieces:
        raise ValueError("pieces: got none, must be at least one Straight or Bend")
    if len(pieces) > MOST_PIECES:
        raise ValueError(f"pieces: got {len(pieces)}, must be at most {MOST_PIECES}; take longer ones")
    for k, piece in enumerate(pieces):
        arguments.instance(f"pieces[{k}]", piece, Straight | Bend, "a worm3d.Straight or a worm3d.Bend")


def _samples(points: FloatArray, spans: int) -> tuple[FloatArray, FloatArray]:
    """Return places and unit tangents of the spline through points of shape (P, 3).

    Each stretch between two points is divided into `spans` parts. Both results have the shape (S, 3).
    """
    import scipy  # slow to import, and rarely needed

    chord = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    spline = scipy.interpolate.CubicSpline(chord, points, bc_type="natural" if len(points) > 2 else "not-a-knot")
    at = np.concatenate([np.linspace(a, b, spans, endpoint=False) for a, b in pairwise(chord)])
    at = np.append(at, chord[-1])
    slope = spline(at, 1)
    return spline(at), slope / np.linalg.norm(slope, axis=1)[:, None]


def _biarcs(places: FloatArray, tangents: FloatArray) -> tuple[FloatArray, ...]:
    """Return start, tangent, normal, curvature and length of the arcs through places with the given unit tangents.

    Places and tangents have the shape (S, 3).
    """
    rows = []
    for (p, q), (t, u) in zip(pairwise(places), pairwise(tangents), strict=True):
        meet, across = _joint(p, q, t, u)
        rows += [_arc(p, t, meet), _arc(meet, across, q)]
    turn = max(row[3] * row[4] for row in rows)
    if turn > LONGEST_ARC:
        raise ValueError(
            f"points: the line through them turns by {turn:.3g} rad at once; put the points closer together"
        )
    return tuple(map(np.array, zip(*rows, strict=True)))


def _joint(p: FloatArray, q: FloatArray, t: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the point where the two arcs of a biarc from p to q meet, and their common tangent there.

    t and u are the unit tangents at p and q.
    """
    v = q - p
    a, b, c = 2.0 * (1.0 - float(t @ u)), 2.0 * float(v @ (t + u)), -float(v @ v)
    d = -2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c))  # the positive root, also for a -> 0
    corners = p + d * t, q - d * u
    across = corners[1] - corners[0]
    return (corners[0] + corners[1]) / 2.0, across / float(np.linalg.norm(across))


def _arc(p: FloatArray, t: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float, float]:
    """Return start, tangent, normal, curvature and length of the arc from p, with the tangent t there, to q."""
    v = q - p
    ahead = float(v @ t)
    aside = v - ahead * t
    side = float(np.linalg.norm(aside))
    half = float(np.arctan2(side, ahead))  # half the angle of the turn
    if half < ROUNDING:
        return p, t, _any_normal(t), 0.0, ahead
    chord = float(np.linalg.norm(v))
    return p, t, aside / side, 2.0 * np.sin(half) / chord, chord * half / np.sin(half)


def _any_normal(t: FloatArray) -> FloatArray:
    normal = np.cross(t, np.eye(3)[int(np.argmin(np.abs(t)))])
    return normal / float(np.linalg.norm(normal))
