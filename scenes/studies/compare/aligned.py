"""Alignment of records: one record is moved and turned about the vertical so that it fits another record best.

Alignment is needed because a camera measures positions in a coordinate system of its own. Let p_k be the points of one
record, r_k the points of the reference at the same instants, p and r their means, and R(a) the rotation by the angle a.
In the horizontal plane, the sum of |r_k - R(a) (p_k - p) - r|^2 is smallest for

    tan a = sum((p_k - p) x (r_k - r)) / sum((p_k - p) . (r_k - r)),

where x denotes the z-component of the cross product. If a record has only x or only y of a point, the residual is this
component in the coordinate system of that record, and Gauss-Newton iterations starting from a minimise the sum.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scenes.language.errors import SceneError
from scenes.records import measured
from scenes.records.columns import MARKER
from scenes.records.record import Record
from scenes.studies.compare.differences import common
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable


def aligned(reference: Record, other: Record) -> Record:
    """Return `other`, moved and turned about z so that its positions fit the positions in `reference` best.

    The fit is a least-squares fit to the centre of mass, the joints and the markers that both records have. It uses all
    instants and components that are known in both records. The record is moved but not turned if no point has x and y
    in both records, or if one of the records is a simulated worm in a vertical plane.

    Raises
    ------
    SceneError
        The records have no position in common.
    """
    ours, theirs = _points(reference, other)
    known = np.isfinite(ours) & np.isfinite(theirs)
    shift = np.array([(ours - theirs)[known[:, k], k].mean() if known[:, k].any() else 0.0 for k in range(3)])
    angle, both = 0.0, known[:, 0] & known[:, 1]
    if both.any() and not (_is_planar(reference) or _is_planar(other)):
        angle, shift[:2] = _fitted(ours[:, :2], theirs[:, :2], both)
    return replace(other, variables=tuple(_moved(variable, angle, shift) for variable in other.variables))


def _points(reference: Record, other: Record) -> tuple[FloatArray, FloatArray]:
    """Return the positions of the reference and of the other record, with a shape of (K, 3) each [m].

    Only points that both records have are returned. Unknown components are NaN.
    """
    pairs = [
        [
            np.pad(each.reshape(-1, each.shape[-1]), ((0, 0), (0, 3 - each.shape[-1])), constant_values=np.nan)
            for each in of
        ]
        for name, (_, *of) in common(reference, other).items()
        if name == "com" or name in measured.JOINTS or name.startswith(MARKER)
    ]
    ours, theirs = (np.concatenate([np.empty((0, 3)), *(pair[k] for pair in pairs)]) for k in (0, 1))
    if not (np.isfinite(ours) & np.isfinite(theirs)).any():
        raise SceneError(f"--align: {other.name} and {reference.name} have no position in common")
    return ours, theirs


def _fitted(ours: FloatArray, theirs: FloatArray, both: NDArray[np.bool_]) -> tuple[float, FloatArray]:
    """Return the angle [rad] and the shift [m] that map the points `theirs` to the points `ours` best.

    Parameters
    ----------
    ours, theirs : ndarray, shape (K, 2)
    both : ndarray, shape (K,)
        Whether x and y of a point are known in both records.
    """
    middle, right = theirs[both].mean(axis=0), ours[both].mean(axis=0)
    angle = _turn(theirs[both] - middle, ours[both] - right)
    begin = np.array([angle, *(right - _turned(middle, angle))])
    whole = np.isfinite(theirs).all(axis=1)
    parts = ~whole & np.isfinite(ours).all(axis=1)

    def off(moves: FloatArray) -> FloatArray:
        there = _turned(theirs[whole], moves[0]) + moves[1:] - ours[whole]
        back = _turned(ours[parts] - moves[1:], -moves[0]) - theirs[parts]
        found = np.concatenate([there, back]).ravel()
        return np.asarray(found[np.isfinite(found)], dtype=float)

    if len(off(begin)) > 2 * both.sum():
        from scipy.optimize import least_squares

        begin = least_squares(off, begin, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    return float(begin[0]), begin[1:]


def _is_planar(record: Record) -> bool:
    """Return whether a simulated worm lives in a vertical plane, where y is up."""
    return not measured.is_measured(record) and record.sizes.get("axis") == 2


def _turn(points: FloatArray, towards: FloatArray) -> float:
    cross = float(np.sum(points[:, 0] * towards[:, 1] - points[:, 1] * towards[:, 0]))
    return math.atan2(cross, float(np.sum(points[:, :2] * towards[:, :2])))


def _turned(vectors: FloatArray, angle: float) -> FloatArray:
    """Return vectors, shape (..., 2 or 3), turned about z by an angle [rad].

    If the angle is 0, the vectors are returned unchanged, so that a NaN in x does not spread to y.
    """
    x, y, c, s = vectors[..., 0], vectors[..., 1], math.cos(angle), math.sin(angle)
    turned: FloatArray = np.array(vectors, dtype=float)
    if angle:
        turned[..., 0], turned[..., 1] = c * x - s * y, s * x + c * y
    return turned


def _moved(variable: Variable, angle: float, shift: FloatArray) -> Variable:
    """Return a variable in the new coordinate system. Positions are turned and moved, other vectors are only turned."""
    values = variable.values
    if variable.dims[-1:] == ("axis",):
        values = _turned(values, angle) + (shift[: values.shape[-1]] if variable.units == "m" else 0.0)
    elif variable.name == "heading":
        values = values + angle
    return Variable(variable.name, variable.dims, values, variable.units, variable.long_name)
