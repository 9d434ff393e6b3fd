"""The inside of a straight or bent pipe, and the placement of a worm in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.worlds import kernels, pipe_table
from worm3d.worlds.base import World
from worm3d.worlds.centreline import ROUNDING, Centreline
from worm3d.worlds.kernels import Formula, WorldKernel
from worm3d.worlds.pipe_formula import Bends, piece, pipe, place
from worm3d.worlds.plane import Patch, patches_of
from worm3d.worlds.profile import Profile

Form = tuple[Bends, int, bool, bool]
"""Form of the wall: whether each of its pieces is an arc, number of patches, and whether walls close start and end."""

MOST_GIVEN = 8
"""Largest number of pieces of a centre line for which one formula compares all pieces. If there are more pieces, the
nearest piece is looked up in a table."""

STEEP = np.deg2rad(60.0)
"""If the pipe is steeper than this under a worm, the worm is placed on the centre line instead of the bottom [rad]."""

UP = np.array([0.0, 0.0, 1.0])
"""Unit vector along +z."""


@dataclass(frozen=True, eq=False)
class Pipe(World, ReadOnly):
    """The inside of a pipe. Gravity acts along -z.

    The radius may change only on straight pieces. The distance from the wall is exact in bends and where the radius
    changes. There is one exception: for a point in a bend that is nearer to a change of radius than to the wall beside
    it, the distance is measured along the pipe instead of in space. Such a point does not touch the wall. Where parts
    of a pipe intersect, there is no wall between them, because the distance is measured from the nearest place of the
    centre line.

    Attributes
    ----------
    centreline : Centreline or array_like, shape (P, 3)
        Centre line, or points for `Centreline.through` [m]. The line continues straight beyond both ends.
    radius : float or Profile
        Inner radius [m], less than the radius of any bend of the centre line.
    patches : tuple of Patch
        Stretches of the pipe with another friction. `Patch.along` gives the limits along the centre line. Where
        stretches overlap, the last patch applies.
    start_wall, end_wall : bool
        Whether a flat wall closes the pipe at the start and at the end of the centre line. The piece with a wall must
        be straight and at least as long as the diameter of the pipe.

    Raises
    ------
    ValueError
        The radius is not above 0, is too large for a bend, or changes in a bend. A patch has limits `across`, or a wall
        is not on a straight piece of sufficient length.
    """

    centreline: Centreline
    radius: float | Profile
    patches: tuple[Patch, ...]
    start_wall: bool
    end_wall: bool

    def __init__(
        self,
        centreline: Centreline | ArrayLike,
        radius: float | Profile,
        patches: Sequence[Patch] = (),
        start_wall: bool = False,
        end_wall: bool = False,
    ) -> None:
        line = centreline if isinstance(centreline, Centreline) else Centreline.through(centreline)
        wide = radius if isinstance(radius, Profile) else arguments.number("radius", radius, "m", gt=0.0)
        walls = {"start_wall": start_wall, "end_wall": end_wall}
        vars(self).update({name: arguments.flag(name, wall) for name, wall in walls.items()})
        vars(self).update(centreline=line, radius=wide, patches=patches_of(patches))
        if any(np.isfinite(patch.across).any() for patch in self.patches):
            raise ValueError("patches: got an `across`; in a pipe a patch goes all the way round, give `along` only")
        self._require_room_in_bends()
        self._require_straight_ends()

    def _require_room_in_bends(self) -> None:
        line, begins = self.centreline, self.centreline.ends - self.centreline.length
        widest = np.maximum(self.radius_at(begins), self.radius_at(line.ends))
        narrow = line.curvature * widest >= 1.0
        if narrow.any():
            k = int(np.argmax(narrow))
            raise ValueError(
                f"radius: got {widest[k]:g} m in a bend of {1.0 / line.curvature[k]:g} m at {begins[k]:g} m along the "
                "pipe, must be below the bend's radius"
            )
        for low, high in self.profile.changes:
            within = (line.curvature > 0.0) & (low < line.ends - ROUNDING) & (high > begins + ROUNDING)
            if within.any():
                k = int(np.argmax(within))
                raise ValueError(
                    f"radius: changes from {low:g} to {high:g} m along the pipe, where it bends ({begins[k]:g} to "
                    f"{line.ends[k]:g} m); move the change to a straight piece"
                )

    def _require_straight_ends(self) -> None:
        line = self.centreline
        for name, k, s in (("start_wall", 0, 0.0), ("end_wall", -1, line.total)):
            wide = 2.0 * self.radius_at(s)
            if getattr(self, name) and (line.curvature[k] > 0.0 or line.length[k] < wide):
                raise ValueError(
                    f"{name}: the pipe must be straight there for at least its diameter, {wide:g} m; add a Straight"
                )

    @cached_property
    def profile(self) -> Profile:
        """Radius along the centre line."""
        return self.radius if isinstance(self.radius, Profile) else Profile([0.0], [self.radius])

    @property
    def uneven(self) -> bool:
        """Whether a worm without friction could slide away under the load of `pressing`."""
        return not (self.centreline.straight and self.profile.constant)

    def radius_at(self, along: ArrayLike) -> FloatArray:
        """Return the radius at distances of shape (...) along the centre line, shape (...) [m]."""
        return self.profile.at(along)

    def symbolic(self) -> Formula | None:
        """Return the formula of the world's rows, or None if the pipe has so many pieces that a table is used."""
        line = self._pieces()
        if len(line) > MOST_GIVEN:
            return None
        form, parameters = self._wall()
        return pipe(_bent(line[:, 10]), *form), np.concatenate([line.ravel(), parameters])

    def _wall(self) -> tuple[Form, FloatArray]:
        """Return the form of the wall, and the parameters of `pipe_formula.pipe` after the centre line's pieces."""
        wall = self.profile.pieces()[:1] if self.profile.constant else self.profile.pieces()
        grips = [np.nan_to_num([*patch.along, patch.grip]) for patch in self.patches]  # the largest number for infinity
        form = _bent(wall[:, 4]), len(grips), bool(self.start_wall), bool(self.end_wall)
        return form, np.concatenate([wall.ravel(), [0.0, self.centreline.total], np.ravel(grips)])

    def _pieces(self) -> FloatArray:
        """Return the pieces of the centre line, including straight pieces for its continuation, shape (K, 11)."""
        line = self.centreline
        begins = line.ends - line.length
        table = np.column_stack([line.start, line.tangent, line.normal, begins, line.curvature])
        if line.curvature[0] > 0.0:
            table = np.vstack([[*table[0, :-1], 0.0], table])
        if line.curvature[-1] > 0.0:
            end, tangent = line.at(line.total)
            table = np.vstack([table, [*end, *tangent, *_normal_to(tangent), line.total, 0.0]])
        return table

    def kernel(self) -> WorldKernel:
        """Return the compiled world.

        It evaluates the formula of the whole pipe, or the formula of a single piece if that is faster.
        """
        whole = None if self._of_known_pieces() else self.symbolic()
        return self._looked_up() if whole is None else kernels.compiled(*whole)

    def _of_known_pieces(self) -> bool:
        """Return whether the pipe has several pieces, and each point inside lies between the end planes of only one."""
        return len(self._pieces()) > 1 and self.centreline.reach > float(self.profile.radius.max())

    def _looked_up(self) -> WorldKernel:
        """Return the compiled world that looks up the piece of each point in a table."""
        form, parameters = self._wall()
        one, line, reach = kernels.kernel(piece(*form)), self._pieces(), self.centreline.reach
        planes = np.column_stack([line[:, 3:6], np.sum(line[:, :3] * line[:, 3:6], axis=1)])
        certain = 1e-12 * (1.0 + float(np.abs(line[:, :3]).max()))  # beyond this, rounding cannot change the side
        pieces = np.column_stack([line, _between(planes, certain)])
        places = kernels.halves(pieces.ctypes.data, planes.ctypes.data, one.address)
        numbers = [*pieces[0], *parameters, reach, pipe_table.NO_PIECE, *places, len(line), reach]
        return kernels.kernel_by_hand(pipe_table.pipe, numbers, (one, pieces, planes))

    def along(self, points: FloatArray) -> FloatArray:
        """Return the distances along the centre line of the places nearest to the points [m].

        Points of shape (..., 3) give distances of shape (...,).
        """
        flat, pieces = arguments.array("points", np.reshape(points, (-1, 3)), ("P", 3), least=0), self._pieces()
        at_once = max(1, 2_000_000 // len(pieces))  # limits the pairs of point and piece in memory
        found = [_along(flat[k : k + at_once], pieces) for k in range(0, len(flat), at_once)]
        return np.concatenate([*found, np.zeros(0)]).reshape(np.shape(points)[:-1])

    def course(self, points: FloatArray, joints: FloatArray) -> FloatArray:
        """Return distances of points along the centre line, increasing towards the worm's head, shape (K,) [m].

        The points have the shape (K, 3), and the joints of the worm have the shape (N+1, 3).
        """
        tail, head = self.along(joints[[0, -1]])
        return np.asarray(np.sign(head - tail) * self.along(points))

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return gravity, for a straight pipe without the component along the pipe, shape (3,) [m/s^2]."""
        if self.uneven:
            return super().pressing(gravity)
        t = self.centreline.tangent[0]
        pressing = np.asarray(gravity - (gravity @ t) * t)
        small = np.linalg.norm(pressing) <= 1e-12 * np.linalg.norm(gravity)
        return np.zeros(3) if small else pressing

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a worm that follows the pipe, and the directors to the left.

        The worm lies on the bottom, or on the centre line if a part of the pipe under the worm is steeper than `STEEP`.
        `position` is (s, 0), where s is the distance of the tail along the centre line [m]. `azimuth` is 0 if the head
        points along the pipe, and pi if the head points back.

        Raises
        ------
        ValueError
            The position or the azimuth has another form, or the clearance is larger than the radius.
        """
        if position[1] != 0.0:
            raise ValueError(
                f"position: got {position.tolist()!r} m, must be (how far along the pipe the tail is, 0) in a pipe"
            )
        turned = np.cos(azimuth)
        if abs(turned) < 1.0 - 1e-9:
            raise ValueError(f"azimuth: got {azimuth!r} rad, must be 0 (along the pipe) or pi (back) in a pipe")
        return _placed_in(self, float(np.sign(turned)) * along, float(position[0]), clearance)


def _bent(curvature: FloatArray) -> tuple[bool, ...]:
    return tuple(bool(each) for each in curvature != 0.0)


def _along(points: FloatArray, pieces: FloatArray) -> FloatArray:
    """Return the distances along a chain of the places nearest to points, shape (P,) [m].

    The points have the shape (P, 3), and the pieces of the chain have the shape (K, 11).
    """
    import scipy  # slow to import, and rarely needed

    length = np.concatenate([[np.inf], np.diff(pieces[1:, 9]), [np.inf]])[: len(pieces)]
    apart = scipy.spatial.distance.cdist(points, pieces[:, :3])
    i, k = np.nonzero(apart - length <= apart.min(axis=1)[:, None])  # no other piece can be the nearest
    s, square = (np.array(value).ravel() for value in place().map(len(i))(points[i].T, pieces[k].T))
    after = np.minimum(k + 1, len(pieces) - 1)
    ahead, beyond = (np.sum((points[i] - pieces[n, :3]) * pieces[n, 3:6], axis=1) for n in (k, after))
    between = ((ahead >= 0.0) | (k == 0)) & ((beyond < 0.0) | (k == after))
    order = np.lexsort((np.where(between, square, np.inf), i))
    return np.asarray(s[order][np.unique(i[order], return_index=True)[1]])


def _between(planes: FloatArray, margin: float) -> FloatArray:
    """Return the rows `pipe_formula.BETWEEN` of the pieces that begin at `planes`, narrowed by a margin [m].

    The planes have the shape (K, 4), and the result has the shape (K, 5).
    """
    largest = np.finfo(float).max  # in place of infinity
    begins = np.full(len(planes), margin)
    begins[0] = -largest
    ends = np.vstack([planes[1:] - [0.0, 0.0, 0.0, margin], [0.0, 0.0, 0.0, largest]])
    return np.column_stack([begins, ends])


def _placed_in(pipe: Pipe, along: FloatArray, tail: float, clearance: float) -> tuple[FloatArray, FloatArray]:
    """Return joints, shape (N+1, 3), and directors, shape (N, 3), of a worm in a pipe.

    `tail` is the distance of the tail along the centre line. `along` has the distances of the joints from the tail,
    negative if the head points back.
    """
    narrow, line = float(np.min(pipe.radius_at(tail + along))), pipe.centreline
    if clearance > narrow:
        raise ValueError(
            f"the pipe is narrower than the worm: a radius of {narrow:.4g} m leaves no room for it; make the pipe "
            "wider, or the worm thinner (half_height, chamber_offset)"
        )
    steep = bool(np.max(np.abs(line.at(tail + along)[1][:, 2])) > np.sin(STEEP))

    def on_path(s: float) -> FloatArray:
        point, tangent = line.at(s)
        if steep:
            return point
        up = UP - tangent[2] * tangent
        return np.asarray(point - (pipe.radius_at(s) - clearance) * up / np.linalg.norm(up))

    joints = _spaced(on_path, along, tail)
    edges = np.diff(joints, axis=0)
    tangents = edges / np.linalg.norm(edges, axis=1)[:, None]
    return joints, _carried(tangents) if steep else np.array([_normal_to(t) for t in tangents])


def _normal_to(tangent: FloatArray) -> FloatArray:
    """Return a horizontal unit vector normal to a tangent, or the y axis if the tangent is vertical, shape (3,)."""
    level = np.cross(UP, tangent)
    size = float(np.linalg.norm(level))
    return level / size if size > 1e-9 else np.array([0.0, 1.0, 0.0])


def _spaced(on_path: Callable[[float], FloatArray], along: FloatArray, tail: float) -> FloatArray:
    """Return the joints as points on a path. Neighbouring joints have the straight-line distances given by `along`."""
    import scipy  # slow to import, and rarely needed

    s, joints = tail, [on_path(tail)]
    for way in np.diff(along):

        def too_far(to: float, begin: FloatArray = joints[-1], length: float = abs(way)) -> float:
            return float(np.linalg.norm(on_path(to) - begin)) - length

        reach = 2.0 * way
        while too_far(s + reach) < 0.0:
            reach *= 2.0
        s = scipy.optimize.brentq(too_far, s, s + reach, xtol=1e-15, rtol=1e-14)
        joints.append(on_path(s))
    return np.array(joints)


def _carried(tangents: FloatArray) -> FloatArray:
    """Return the directors of a worm without twist, by parallel transport of the first director along the worm."""
    directors = [_normal_to(tangents[0])]
    for a, b in pairwise(tangents):
        d = directors[-1]
        directors.append(d - (d @ b) / (1.0 + a @ b) * (a + b))
    return np.array(directors)
