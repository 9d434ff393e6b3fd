"""A record moved and turned about the vertical so that it fits another one best: cameras have frames of their own.

With points p_k of one record and r_k of the other, at the same instants and with means p and r, the sum of
|r_k - R(a) (p_k - p) - r|^2 is least for tan a = sum((p_k - p) x (r_k - r)) / sum((p_k - p) . (r_k - r)) in the
horizontal plane, where x is the z-component of the cross product.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scenes.compare.differences import common
from scenes.language.errors import SceneError
from scenes.records import measured
from scenes.records.columns import MARKER
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable


def aligned(reference: Record, other: Record) -> Record:
    """Return a record moved and turned about z so that its positions fit those of a reference best (least squares).

    Positions are the centre of mass, joints and markers, as far as both have them, at all instants that they have in
    common. A worm in a vertical plane is moved, not turned.

    Raises
    ------
    SceneError
        They have no position in common.
    """
    ours, theirs = _points(reference, other)
    axes = ours.shape[1]
    middle, right = theirs.mean(axis=0), ours.mean(axis=0)
    angle = 0.0 if _is_planar(reference) or _is_planar(other) else _turn(theirs - middle, ours - right)
    shift = np.zeros(3)
    shift[:axes] = right - _turned(middle, angle)
    return replace(other, variables=tuple(_moved(variable, angle, shift) for variable in other.variables))


def _points(reference: Record, other: Record) -> tuple[FloatArray, FloatArray]:
    """Return the positions that both records have, shapes (K, 2 or 3) [m]."""
    found = [
        (ours.reshape(-1, ours.shape[-1]), theirs.reshape(-1, theirs.shape[-1]))
        for name, (_, ours, theirs) in common(reference, other).items()
        if name == "com" or name in measured.JOINTS or name.startswith(MARKER)
    ]
    axes = min((ours.shape[1] for ours, _ in found), default=0)
    for seen in range(axes, 1, -1):  # x and y alone, where no z was measured
        pairs = [(ours[:, :seen], theirs[:, :seen]) for ours, theirs in found]
        ours, theirs = (np.concatenate(each) for each in zip(*pairs, strict=True))
        known = np.isfinite(ours).all(axis=1) & np.isfinite(theirs).all(axis=1)
        if known.any():
            return ours[known], theirs[known]
    raise SceneError(f"--align: {other.name} and {reference.name} have no position in common")


def _is_planar(record: Record) -> bool:
    """Return whether a simulated worm lives in a vertical plane, where y is up."""
    return not measured.is_measured(record) and record.sizes.get("axis") == 2


def _turn(points: FloatArray, towards: FloatArray) -> float:
    cross = float(np.sum(points[:, 0] * towards[:, 1] - points[:, 1] * towards[:, 0]))
    return math.atan2(cross, float(np.sum(points[:, :2] * towards[:, :2])))


def _turned(vectors: FloatArray, angle: float) -> FloatArray:
    """Return vectors, shape (..., 2 or 3), turned about z; what is NaN stays in its component where nothing turns."""
    x, y, c, s = vectors[..., 0], vectors[..., 1], math.cos(angle), math.sin(angle)
    turned: FloatArray = np.array(vectors, dtype=float)
    if angle:
        turned[..., 0], turned[..., 1] = c * x - s * y, s * x + c * y
    return turned


def _moved(variable: Variable, angle: float, shift: FloatArray) -> Variable:
    """Return a variable in the new frame: positions are moved and turned, other vectors turned."""
    values = variable.values
    if variable.dims[-1:] == ("axis",):
        values = _turned(values, angle) + (shift[: values.shape[-1]] if variable.units == "m" else 0.0)
    elif variable.name == "heading":
        values = values + angle
    return Variable(variable.name, variable.dims, values, variable.units, variable.long_name)
