"""Signed distance from a pipe's wall, with gradient and Hessian, as symbolic expressions.

Centre line and wall are chains of straight pieces and circular arcs. A piece has the curvature kappa, and a frame
p, t, n at its beginning: a point, the tangent, and the normal towards the centre of a bend. X, Y, Z are the coordinates
of a point x in this frame. Z is the coordinate along t x n, and 0 for the wall, which is a chain in a plane. With

    w = sqrt((kappa X)^2 + (1 - kappa Y)^2)                                                                  (WP1)

the nearest point of the piece, continued as a line or a full circle, lies at the distance s along the piece, and x lies
at the distance d from it:

    s = atan2(kappa X, 1 - kappa Y)/kappa   (s = X if kappa = 0),                                             (WP2)
    delta = (kappa (X^2 + Y^2) - 2 Y)/(1 + w),   d^2 = delta^2 + Z^2                                          (WP3)

In the plane of the piece, delta is the distance of x from the arc's centre minus the arc's radius. For kappa = 0 it is
-Y. In this form, no digits cancel for small kappa, and no case distinction is needed. The tangent T and the outward
normal O at the nearest point are

    T = ((1 - kappa Y) t + kappa X n)/w,   O = (kappa X t - (1 - kappa Y) n)/w                               (WP4)

On a chain without kinks and without ends, x lies in the normal plane of its nearest point. The candidates for the
nearest piece are therefore the pieces between whose end planes x lies, with X_k >= 0 and X_{k+1} < 0. The candidate
with the smallest d is the nearest piece.

Let s be the place of the nearest point along the centre line, d the distance of x from the centre line, T the tangent
there, and e the unit vector from the centre line to x. In the half-plane (s, rho), the wall is the chain rho = R(s).
Let y be the distance of x from the wall, positive in the solid, (N_s, N_rho) the normal of the wall that points out of
the pipe, and kappa_w and w_w the values of kappa and w of the nearest piece of the wall. Then

    g = -y,   n = -(N_s T + N_rho e)                                                                         (WP5)

If the radius is constant, g = R - d and n = -e. The Hessian is written in the directions c = T x e around the pipe,
m = N_rho T - N_s e along the wall, and T along the bend:

    H = -(N_rho/d) c c^T + min(0, kappa_w/w_w) m m^T + min(0, n.O kappa/w) T T^T                             (WP6)

Positive curvatures, of walls that bulge towards the worm, are left out, because they would make Newton's matrix
indefinite.

A wall across the end of the pipe is at the distance f = s_end - s. Where both g and f are negative, in the corner, the
combined distance is -sqrt(g^2 + f^2). Elsewhere it is the smaller of g and f. This is exact because the pipe is
straight at a wall.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca

from worm3d.worlds.kernels import ON_AXIS, rows

Bends = tuple[bool, ...]

PIECE = 11
"""Number of values that describe a piece of the centre line: p (3), t (3), n (3), s at its start, kappa."""

BETWEEN = 5
"""Number of values that describe the region that certainly lies between the end planes of a piece. The values are the
minimum distance beyond the first plane [m], the normal (3) of the last plane, and the largest coordinate along this
normal [m]."""

WALL = 5
"""Number of values that describe a piece of the wall: s and rho at its start, cosine and sine of its direction,
kappa."""

GRIP = 3
"""Number of values that describe a stretch with another friction: begin and end along the pipe, multiplier."""

OUT_OF_QUESTION = 1e30
"""Squared distance assigned to a piece that is not a candidate for a point [m^2]."""


class Local(NamedTuple):
    """Coordinates of a point in the frame of a piece, and the piece's curvature."""

    X: ca.SX
    Y: ca.SX
    Z: ca.SX
    kappa: ca.SX


def _stretch(c: Local) -> ca.SX:
    """Return w of (WP1), the distance from the axis of the bend as a multiple of the radius of the bend."""
    return ca.sqrt((c.kappa * c.X) ** 2 + (1.0 - c.kappa * c.Y) ** 2)


def _excess(c: Local) -> ca.SX:
    """Return delta of (WP3) [m]."""
    return (c.kappa * (c.X**2 + c.Y**2) - 2.0 * c.Y) / (1.0 + _stretch(c))


def _way(c: Local) -> ca.SX:
    """Return s of (WP2) [m]."""
    bent = c.kappa != 0.0
    angle = ca.atan2(c.kappa * c.X, 1.0 - c.kappa * c.Y)
    return ca.if_else(bent, angle / ca.if_else(bent, c.kappa, 1.0), c.X)


def _tangent_and_outward(c: Local, t: ca.SX, n: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return T and O of (WP4)."""
    w = _stretch(c)
    ahead, aside = (1.0 - c.kappa * c.Y) / w, c.kappa * c.X / w
    return ahead * t + aside * n, aside * t - ahead * n


def _nearest_piece(locals_: Sequence[Local], pieces: Sequence[ca.SX]) -> ca.SX:
    """Return the column of `pieces` with the values of the nearest piece. `locals_` has a `Local` for each piece."""
    best, chosen = ca.SX(OUT_OF_QUESTION), pieces[0]
    for k, c in enumerate(locals_):
        square = _excess(c) ** 2 + c.Z**2
        if k > 0:
            square = ca.if_else(c.X >= 0.0, square, OUT_OF_QUESTION)
        if k + 1 < len(locals_):
            square = ca.if_else(locals_[k + 1].X < 0.0, square, OUT_OF_QUESTION)
        if k > 0:
            closer = square < best
            chosen = ca.if_else(closer, pieces[k], chosen)
            best = ca.if_else(closer, square, best)
        else:
            best = square
    return chosen


class Surface(NamedTuple):
    """Signed distance, its gradient (3) and Hessian (3, 3)."""

    g: ca.SX
    n: ca.SX
    H: ca.SX


class _Chain(NamedTuple):
    """A chain: the values of its pieces, a column for each piece with the curvature last, and which pieces are arcs."""

    rows: ca.SX
    bent: Bends

    def nearest(self, local: Callable[[ca.SX, ca.SX], Local], at: ca.SX) -> ca.SX:
        """Return the values of the piece nearest to a place. `local` returns coordinates in the frame of a piece."""
        columns = ca.horzsplit(self.rows)
        each = (local(at, column) for column in columns)
        known = [c if bent else c._replace(kappa=ca.SX(0.0)) for c, bent in zip(each, self.bent, strict=True)]
        found = _nearest_piece(known, columns)
        return found if any(self.bent) else ca.vertcat(found[:-1], 0.0)


@cache
def pipe(bent: Bends, bent_walls: Bends, stretches: int, at_start: bool, at_end: bool) -> ca.Function:
    """Return a function of a point and the parameters of a pipe that returns the rows of a world.

    `bent` and `bent_walls` say which pieces of the centre line and of the wall are arcs. If the wall has only one
    straight piece, the radius is constant. The first and the last piece are infinitely long. `stretches` is the number
    of stretches with another friction. `at_start` and `at_end` say whether walls close the ends.
    """
    x, given, found, _ = _world(bent, bent_walls, stretches, at_start, at_end)
    return ca.Function("pipe", [x, given], [found])


@cache
def piece(bent_walls: Bends, stretches: int, at_start: bool, at_end: bool) -> ca.Function:
    """Return a function that returns the rows of `pipe` for a given piece of the centre line.

    The friction multiplier has a minus sign if another piece may be nearer to the point. No other piece is nearer if
    the point lies between the end planes of the given piece and is closer to the centre line than the reach. After the
    point, the inputs begin with the values of the piece and the values of `BETWEEN`. The reach is the last input.
    """
    inside, reach = ca.SX.sym("between", BETWEEN), ca.SX.sym("reach")
    x, given, found, d = _world((True,), bent_walls, stretches, at_start, at_end)
    begins = ca.dot(x - given[:3], given[3:6]) > inside[0]
    ends = ca.dot(x, inside[1:4]) < inside[4]
    known = ca.logic_and(ca.logic_and(begins, ends), d < reach)
    marked = ca.copysign(found[-1], ca.if_else(known, 1.0, -1.0))
    inputs = ca.vertcat(given[:PIECE], inside, given[PIECE:], reach)
    return ca.Function("pipe_piece", [x, inputs], [ca.vertcat(found[:-1], marked)])


def _world(
    bent: Bends, bent_walls: Bends, stretches: int, at_start: bool, at_end: bool
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the symbols of point and parameters, the rows of the world, and the distance from the centre line."""
    x, line = ca.SX.sym("x", 3), ca.SX.sym("pieces", PIECE, len(bent))
    wall, grips = ca.SX.sym("wall", WALL, len(bent_walls)), ca.SX.sym("grips", GRIP, stretches)
    ends = ca.SX.sym("ends", 2)
    surface, s, d, tangent = _tube(x, _Chain(line, bent), _Chain(wall, bent_walls))
    if at_start:
        surface = _closed(surface, Surface(s - ends[0], tangent, ca.SX.zeros(3, 3)))
    if at_end:
        surface = _closed(surface, Surface(ends[1] - s, -tangent, ca.SX.zeros(3, 3)))
    grip = ca.SX(1.0)
    for k in range(stretches):
        inside = ca.logic_and(s >= grips[0, k], s < grips[1, k])
        grip = ca.if_else(inside, grips[2, k], grip)
    given = ca.vertcat(ca.vec(line), ca.vec(wall), ends, ca.vec(grips))
    return x, given, rows(*surface, grip), d


@cache
def place() -> ca.Function:
    """Return a function of a point and a piece that returns the nearest place and the squared distance.

    The place is measured along the centre line. The distance is measured from the piece, continued as a line or circle.
    """
    x, row = ca.SX.sym("x", 3), ca.SX.sym("piece", PIECE)
    c = _local(x, row)
    return ca.Function("place", [x, row], [row[9] + _way(c), _excess(c) ** 2 + c.Z**2])


def _tube(x: ca.SX, line: _Chain, wall: _Chain) -> tuple[Surface, ca.SX, ca.SX, ca.SX]:
    """Return the surface of the wall, the place along the centre line, the distance from it, and the tangent there."""
    piece = line.nearest(_local, x)
    c, t, n = _local(x, piece), piece[3:6], piece[6:9]
    T, outward = _tangent_and_outward(c, t, n)
    away = _excess(c) * outward + c.Z * ca.cross(t, n)
    d = ca.sqrt(ca.sumsqr(away) + ON_AXIS)
    e, s = away / d, piece[9] + _way(c)
    y, N, bulge = _wall(ca.vertcat(s, d), wall)
    g, normal = -y, -(N[0] * T + N[1] * e)
    around, along = ca.cross(T, e), N[1] * T - N[0] * e
    bent = ca.fmin(0.0, ca.dot(normal, outward) * c.kappa / _stretch(c))
    H = -N[1] / d * around @ around.T + ca.fmin(0.0, bulge) * along @ along.T + bent * T @ T.T
    return Surface(g, normal, H), s, d, T


def _local(x: ca.SX, piece: ca.SX) -> Local:
    """Return the coordinates of a point in the frame of a piece of the centre line."""
    away, t, n = x - piece[0:3], piece[3:6], piece[6:9]
    return Local(ca.dot(away, t), ca.dot(away, n), ca.dot(away, ca.cross(t, n)), piece[10])


def _wall(at: ca.SX, wall: _Chain) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return y of (WP5) for a point (s, rho) [m], and the wall's normal (N_s, N_rho) and kappa_w/w_w of (WP6)."""
    if len(wall.bent) == 1:
        return at[1] - wall.rows[1, 0], ca.SX([0.0, 1.0]), ca.SX(0.0)
    piece = wall.nearest(_local_of_wall, at)
    c, t, n = _local_of_wall(at, piece), piece[2:4], ca.vertcat(-piece[3], piece[2])
    _, outward = _tangent_and_outward(c, t, n)
    return -_excess(c), -outward, c.kappa / _stretch(c)


def _local_of_wall(at: ca.SX, piece: ca.SX) -> Local:
    away, t = at - piece[0:2], piece[2:4]
    return Local(ca.dot(away, t), ca.dot(away, ca.vertcat(-t[1], t[0])), ca.SX(0.0), piece[4])


def _closed(side: Surface, end: Surface) -> Surface:
    """Return the combined surface of the wall of a pipe and a wall across its end."""
    a, b = ca.fmin(0.0, side.g), ca.fmin(0.0, end.g)
    deep = ca.sqrt(a**2 + b**2)
    corner = ca.logic_and(a < 0.0, b < 0.0)
    across = end.g < side.g
    safe = ca.if_else(corner, deep, 1.0)
    share, other = -a / safe, -b / safe
    g = ca.if_else(corner, -deep, ca.fmin(side.g, end.g))
    n = ca.if_else(corner, share * side.n + other * end.n, ca.if_else(across, end.n, side.n))
    H = ca.if_else(corner, share, ca.if_else(across, 0.0, 1.0)) * side.H
    return Surface(g, n, H)
