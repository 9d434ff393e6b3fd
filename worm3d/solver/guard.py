"""Shapes outside the model. The solver rejects a step that ends in such a shape, and reports reason and remedy."""

from __future__ import annotations

import numpy as np

from worm3d.machine.compiled import inner
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import joint, point, segment
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.recorded.status import Status
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import matrix, rows, total, vector
from worm3d.solver.entry import kernel, run
from worm3d.solver.evaluate import LENGTHS, TANGENT
from worm3d.values.arrays import FloatArray

Arrays = dict[str, FloatArray]

BEND = 4
"""Index of the chamber bend among the coordinates of a segment."""
CHAMBER_SIDES = ("left", "right")

OK, NO_CONVERGENCE, NOT_FINITE, FLATTENED, FOLDED, SUNK, OUTSIDE, TOO_COARSE = range(8)
"""Status of a step. TOO_COARSE: the step was solved, but its estimated error exceeds the allowed error."""

_HINGE = joint.JOINT_LAYOUT.first("hinge")
_REST = segment.SEGMENT_LAYOUT.first("commanded")
_DISTANCE = point.POINT_LAYOUT.first("distance")


@inner
def guard(core: Core) -> int:
    """Return OK for a shape within the model, otherwise the reason for rejecting the step."""
    rest, longest = matrix(core.block, a.SEGMENT_SHAPE_OUT), vector(core.block, a.FLATTENED_LENGTH)
    if not (np.isfinite(total(vector(core.block, a.X))) and _actuators_end_finite(core)):
        return NOT_FINITE
    for i in range(core.n):
        if max(rest[LENGTHS, i], rest[LENGTHS + 1, i]) > longest[i]:
            return FLATTENED
    if _folded(core):
        return FOLDED
    if _sunk(core):
        return SUNK
    return OUTSIDE if _outside(core) else OK


@inner
def _outside(core: Core) -> bool:
    """Return whether a chamber is outside the domain of the segment law."""
    rest, given = matrix(core.block, a.SEGMENT_SHAPE_OUT), matrix(core.block, a.SEGMENT_IN)
    domain = matrix(core.block, a.DOMAIN)
    for i in range(core.n):
        for c in range(2):
            if not domain[0, i] <= given[_REST + c, i] <= domain[1, i]:
                return True
            shortest, longest = _bounds(domain, i, given[_REST + c, i])
            if not shortest <= rest[LENGTHS + c, i] <= longest:
                return True
    return False


@inner
def _bounds(domain: FloatArray, i: int, commanded: float) -> tuple[float, float]:
    """Return the least and the greatest length of a chamber of segment i at a commanded rest length in the domain."""
    count = (domain.shape[0] - 2) // 2
    shortest, longest = domain[2, i], domain[2 + count, i]
    if count > 1:
        at = (domain[1, i] - commanded) / (domain[1, i] - domain[0, i]) * (count - 1)
        k = min(int(at), count - 2)
        shortest = domain[2 + k, i] + (at - k) * (domain[3 + k, i] - domain[2 + k, i])
        longest = domain[2 + count + k, i] + (at - k) * (domain[3 + count + k, i] - domain[2 + count + k, i])
    return shortest, longest


@inner
def actuators_start_finite(core: Core) -> bool:
    """Return whether all outputs of the actuators that are known at the start of a step are finite."""
    block = core.block
    value = total(vector(block, a.ACTUATOR_COMMANDS)) + total(vector(block, a.GIVEN))
    value += total(rows(block, a.SEGMENT_IN, _REST, 2)) + _sum(matrix(block, a.HINGE_OUT), core.n - 1)
    return bool(np.isfinite(value))


@inner
def _actuators_end_finite(core: Core) -> bool:
    """Return whether the outputs, states and energies of the chambers' actuators at the end of the step are finite."""
    if kernel(core, a.ACTUATOR_END) == 0:
        return True
    run(core, a.ACTUATOR_END, a.ACTUATED, a.ACTUATOR_OUT, core.n)
    return bool(np.isfinite(_sum(matrix(core.block, a.ACTUATOR_OUT), core.n)))


@inner
def _sum(values: FloatArray, count: int) -> float:
    """Return the sum of the first `count` entries of all rows."""
    value = 0.0
    for row in range(values.shape[0]):
        value += total(values[row, :count])
    return value


@inner
def _folded(core: Core) -> bool:
    """Return whether a joint is bent by 90 degrees or more, or bends and hinge command 90 degrees or more."""
    rest, joints = matrix(core.block, a.SEGMENT_SHAPE_OUT), matrix(core.block, a.JOINT_IN)
    x = vector(core.block, a.X)
    for i in range(core.n - 1):
        cosine = 0.0
        for d in range(3):
            cosine += rest[TANGENT + d, i] * rest[TANGENT + d, i + 1]
        asked = 0.5 * (x[BLOCK_SIZE * i + 4] + x[BLOCK_SIZE * i + 9]) + joints[_HINGE, i]
        if cosine <= 0.0 or abs(asked) >= 0.5 * np.pi:
            return True
    return False


@inner
def _sunk(core: Core) -> bool:
    """Return whether a joint is too deep in the world."""
    numbers, distance = vector(core.block, a.NUMBERS_), matrix(core.block, a.POINT_IN)[_DISTANCE]
    lanes = len(distance) // POINTS_PER_SEGMENT
    for i in range(core.n):
        if distance[6 * lanes + i] <= -numbers[a.MAX_PENETRATION]:
            return True
    return bool(distance[7 * lanes + core.n - 1] <= -numbers[a.MAX_PENETRATION])


def refused(arrays: Arrays, segments: int, status: Status) -> tuple[int, str]:
    """Return the segment because of which the guard rejected a step, and the reason in words.

    Parameters
    ----------
    arrays : dict of str to ndarray
        Arrays of the solver after the step (`worm3d.solver.arrays`). All arrays except the coordinates belong to the
        rejected shape.
    segments : int
        Number of segments.
    status : Status
        Why the step was rejected.
    """
    of = {
        Status.FOLDED: _where_folded,
        Status.FLATTENED: _where_flattened,
        Status.SUNK: _where_sunk,
        Status.OUTSIDE: _where_outside,
    }.get(status)
    return of(arrays, segments) if of else (0, "")


def joint_angles(arrays: Arrays, segments: int) -> tuple[FloatArray, FloatArray]:
    """Return the angles between segments, and the angles that bends and hinges command, each (N-1,) [rad]."""
    tangent = arrays["rest"][TANGENT : TANGENT + 3, :segments]
    cosine = np.sum(tangent[:, :-1] * tangent[:, 1:], axis=0)
    bend = arrays["segment_in"][segment.SEGMENT_LAYOUT.first("q") + BEND, :segments]
    hinge = arrays["joint_in"][joint.JOINT_LAYOUT.first("hinge"), : segments - 1]
    return np.arccos(np.clip(cosine, -1.0, 1.0)), np.abs(0.5 * (bend[:-1] + bend[1:]) + hinge)


def _where_folded(arrays: Arrays, segments: int) -> tuple[int, str]:
    enclosed, asked = joint_angles(arrays, segments)
    i = int(np.argmax(np.maximum(enclosed, asked)))
    bent, wanted = np.rad2deg(enclosed[i]), np.rad2deg(asked[i])
    return i + 1, (
        f"joint {i + 1}, between segments {i} and {i + 1}, is bent by {bent:.3g} degrees, hinge and chambers ask for "
        f"{wanted:.3g}, and each must stay below 90; ask for less (hinge, bias, amplitude)"
        f"{', or make it stiffer (k_yaw, k_torsion)' if bent >= wanted else ''}"
    )


def _where_flattened(arrays: Arrays, segments: int) -> tuple[int, str]:
    share = arrays["rest"][LENGTHS : LENGTHS + 2, :segments] / arrays["longest"][0, :segments]
    side, i = np.unravel_index(int(np.argmax(share)), share.shape)
    length = float(share[side, i] * arrays["longest"][0, i])
    return int(i), (
        f"segment {i}, whose {CHAMBER_SIDES[side]} chamber is {length:.4g} m long, as long as its links can be; "
        "lengthen it less (negative contraction, bias, pull), or make the worm lighter, k_spring or half_height larger"
    )


def _where_outside(arrays: Arrays, segments: int) -> tuple[int, str]:
    """Return the segment with the chamber that is farthest outside the domain, relative to the size of the domain."""
    domain, rest = arrays["domain"][:, :segments], segment.SEGMENT_LAYOUT.of("commanded", arrays["segment_in"])
    commanded = np.clip(rest[:, :segments], *domain[:2])
    bounds = [[_bounds(domain, i, commanded[side, i]) for i in range(segments)] for side in range(2)]
    found = np.stack([arrays["rest"][LENGTHS : LENGTHS + 2, :segments], rest[:, :segments]])  # what, chamber, segment
    low, high = (
        np.stack([np.array(bounds)[..., end], np.broadcast_to(domain[end], commanded.shape)]) for end in range(2)
    )
    far = np.maximum(low - found, found - high) / np.maximum(high - low, np.finfo(float).tiny)
    what, side, i = np.unravel_index(int(np.argmax(far)), far.shape)
    named = ("is", "has the commanded rest length of")[what]
    free = f" where its free length is {commanded[side, i]:.4g} m" if what == 0 else ""
    return int(i), (
        f"the {CHAMBER_SIDES[side]} chamber of segment {i} {named} {found[what, side, i]:.4g} m, must be from "
        f"{low[what, side, i]:.4g} to {high[what, side, i]:.4g} m{free}; command less, load the worm less, or fit the "
        "segment law to more states"
    )


def _where_sunk(arrays: Arrays, segments: int) -> tuple[int, str]:
    distance = arrays["point_in"][point.POINT_LAYOUT.first("distance")].reshape(POINTS_PER_SEGMENT, -1)[6:, :segments]
    faces = np.append(distance[0], distance[1, -1])
    j = int(np.argmin(faces))
    return min(j, segments - 1), (
        f"joint {j} is {-faces[j]:.3g} m deep; press on it less (weight, external force), or make the worm stiffer "
        "(k_torsion, k_spring)"
    )
