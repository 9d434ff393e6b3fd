"""Checks before the start of a run, and the worm's equilibrium on the ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planar.linkage.ground import RESTING_PENETRATION, Friction, Ground
from planar.linkage.learned import Learned
from planar.linkage.shape import apexes_by_law, diagonals, joint_cosines
from planar.linkage.step import ContactStepper, State
from planar.linkage.worm import Linkage
from planar.status import Status
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

FLATTENED_HEIGHT = 0.02
"""A rhombus counts as flattened if its height is below this fraction of its height at rest."""

SETTLING_TIME = float(np.sqrt(9.81))
"""Time step for settling, in units of sqrt(worm length / gravity). For a worm of 1 m under 9.81 m/s^2 it is 1 s."""

OVERLAP = 10.0 * RESTING_PENETRATION
"""Largest allowed penetration of an apex at the start, as a fraction of the segment length."""


class LimitPointError(ValueError):
    """The worm's weight would flatten its rhombi, so that there is no equilibrium to start from."""


def require_shape(name: str, got: object, shape: tuple[int, ...], meaning: str) -> None:
    """Raise ValueError if an array (or the result of a callable) does not have the given shape."""
    found = np.asarray(got, dtype=object).shape if name == "held" else arguments.floats(name, got).shape
    if found != shape:
        raise ValueError(f"{name}: got shape {found}, must be {shape}: {meaning}")


def require_equilibrium(worm: Linkage, gravity: float) -> None:
    """Raise LimitPointError if the rhombi cannot carry the weight, however it is distributed over them.

    The check applies to the worm without commands. During a run, lengthened segments carry less
    (`Linkage.flattening_weight`), and a wave may put the weight on few segments. If a segment collapses during the run,
    the run ends with the status FLATTENED.
    """
    load, limit = worm.apex_load(gravity), worm.flattening_weight()
    if load.sum() >= limit.sum():
        i, lightest = int(np.argmax(load / limit)), worm.total_mass * limit.sum() / load.sum()
        raise LimitPointError(
            f"segment {i} would be pressed flat: it carries {load[i]:.3g} N, its limit point is {limit[i]:.3g} N; make "
            f"the worm lighter than {lightest:.3g} kg, or k_spring or half_height larger"
        )


def shape_status(worm: Linkage, joints: FloatArray, l_cmd: FloatArray, on_ground: bool) -> Status:
    """Return DONE if the model is valid for the shape of the worm, else the status that names the failure."""
    if not np.isfinite(joints).all():
        return Status.NOT_FINITE
    length, _ = diagonals(joints)
    if worm.has_links:
        height = np.sqrt(np.maximum(worm.link_length**2 - length**2 / 4.0, 0.0))
        if (height < FLATTENED_HEIGHT * worm.rest_half_height).any():
            return Status.FLATTENED
    if isinstance(worm.segment, Learned) and not worm.segment.contains(length, 1.0 - l_cmd / worm.l0):
        return Status.OUTSIDE
    if (joint_cosines(joints) <= 0.0).any():
        return Status.FOLDED
    if on_ground and (joints[:, 1] <= 0.0).any():
        return Status.SUNK
    return Status.DONE


def start_joints(worm: Linkage, start: FloatArray | None, on_ground: bool) -> FloatArray:
    """Return the joints at the start, shape (N+1, 2) [m].

    Raise ValueError if a segment has no such length, or if an apex is inside the ground.
    """
    if start is None:
        height = float(worm.rest_half_height.max()) if on_ground else 0.0
        return np.asarray(worm.rest() + np.array([0.0, height]))
    joints: FloatArray = arguments.floats("start", start)
    require_shape("start", joints, (worm.segments + 1, 2), "x, z of each joint")
    length = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    low, high, why = worm.possible_lengths
    wrong = ~((length > low) & (length < high))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(
            f"start: segment {i} is {length[i]:.4g} m long, must lie between {low[i]:.4g} and {high[i]:.4g} m, {why}"
        )
    lowest = _lowest(worm, joints)
    if on_ground and lowest < -OVERLAP * worm.l0:
        raise ValueError(f"start: an apex lies {-lowest:.3g} m inside the ground z = 0; lift the worm")
    return joints


def touches(worm: Linkage, joints: FloatArray) -> bool:
    """Return whether an apex touches the ground z = 0, up to rounding."""
    return _lowest(worm, joints) <= 1e-6 * worm.length


def _lowest(worm: Linkage, joints: FloatArray) -> float:
    return float(apexes_by_law(joints, np.full(worm.segments, worm.l0), worm.segment_law)[..., 1].min())


def settled(worm: Linkage, weight: FloatArray, held: NDArray[np.bool_], joints: FloatArray) -> tuple[State, Status]:
    """Return the state of the worm at rest under the weight normal to the ground, and the status.

    The status is DONE or names the failure.
    """
    state, load = State.at_rest(joints, worm), np.zeros((worm.segments, 2))
    stepper = ContactStepper(
        worm, np.array([0.0, weight[1]]), Ground.of(worm, Friction(0.0, 0.0), float(np.hypot(*weight))), held
    )
    dt = SETTLING_TIME * float(np.sqrt(worm.length / np.hypot(*weight)))
    for _ in range(200):
        step = stepper.step(state, state.l_cmd, np.zeros((worm.segments + 1, 2)), dt)
        status = shape_status(worm, step.end.joints, step.end.l_cmd, on_ground=True)
        if status is not Status.DONE:
            return state, status
        if not step.solution.converged:
            return state, Status.UNSETTLED
        moved, load = np.abs(step.end.joints - state.joints).max(), step.end.load
        state = State.at_rest(step.end.joints, worm)
        if moved < 1e-13 * worm.length:
            break
    return replace(state, load=load), Status.DONE


def shape_checked(
    function: Callable[[float], FloatArray], shape: tuple[int, ...]
) -> Callable[[float], FloatArray | None]:
    """Return a function of the time that returns `function(t)`, or None if its shape is wrong or it is not finite."""

    def checked(t: float) -> FloatArray | None:
        value = np.array(function(t), dtype=float)
        return value if value.shape == shape and np.isfinite(value).all() else None

    return checked
