"""Checks before a run, and settling, which brings the worm to rest on the world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from worm3d.physics.friction import RESTING_PENETRATION, Friction
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.physics.worm import Worm
from worm3d.recorded.state import State, StateError
from worm3d.recorded.status import Status
from worm3d.running.plant import DOMAIN_ROUNDING, SUNK_DEPTH, Plant
from worm3d.running.problem import Problem
from worm3d.solver.guard import CHAMBER_SIDES, OK
from worm3d.solver.pose import settle as settle_core
from worm3d.values.arrays import FloatArray
from worm3d.worlds import World


class Rested(NamedTuple):
    """A worm that was brought to rest, or the initial state if that failed."""

    state: State
    status: Status
    """DONE, or the reason why the worm did not come to rest."""
    reason: str = ""
    """The part of the worm that caused a failure, and the remedy."""


Settling = Callable[[Problem, State], Rested]
"""A function with the same parameters and return value as `settle`."""


STICKING_RATE = 100.0 * float(np.sqrt(1.0 / 9.81))
"""Number of time steps in a `Plant.natural_time` while a worm settles on an uneven world. For the default worm, the
steps are 0.01 s long.

Contacts that stick hold the worm in the first position where it can stay. This position depends on the length of the
steps. On rubble and in bends, half this number changes the pose by up to 1.2e-2 of the body length, and double this
number by up to 1.7e-3. None of these poses is more correct than the others.
"""

STICKING_FRICTION = (3.0, 1.0, 10.0)
"""Coefficients of friction for settling on uneven worlds. They are tried one after the other until the worm comes to
rest. With too little friction, a worm slides down a steep place. With too much friction, Newton's method may fail."""

REST_TOLERANCE = 1e-13
"""The worm is at rest if no joint moves by more than this fraction of the body length in a step."""

REST_TOLERANCE_LOOSE = 1e-9
"""After the last allowed step, a motion below this fraction of the body length is also accepted as rest, because
rounding errors may keep the motion above `REST_TOLERANCE`."""

HASTE = 1e6
"""The actuators are faster by this factor while the worm comes to rest. Slow valves would otherwise prevent rest.

The value has almost no effect on the result. With factors from 1e3 to 1e12, pneumatic chambers with valves from 1e-10
to 1e-3 kg/(s Pa) come to rest in poses that differ by at most 4e-13 m. With a factor of 1, a worm with valves of 1e-8
kg/(s Pa) or less does not come to rest.
"""

SLIDES = 0.03
"""Largest motion of a settled worm under the friction of the run, as a fraction of the body length. If the worm slides
farther, this friction does not hold the worm, and the slide is simulated as a part of the run."""

OVERLAP = 10.0 * RESTING_PENETRATION
"""Largest allowed depth of a contact point in the world at the start, as a fraction of the segment length."""

GUARDED = (
    Status.DONE,
    Status.NO_CONVERGENCE,
    Status.NOT_FINITE,
    Status.FLATTENED,
    Status.FOLDED,
    Status.SUNK,
    Status.OUTSIDE,
)
"""Statuses in the order of the solver's numbers for the end of a step (`worm3d.solver.guard`)."""


class LimitPointError(ValueError):
    """The weight of the worm would flatten its chambers, so that there is no equilibrium to start from."""


def flattening_weight(worm: Worm, contraction: float = 0.0) -> FloatArray:
    """Return the weight that flattens each segment (limit point), shape (N,) [N].

    The weight is infinite for a segment law without links. The equation is in
    `worm3d.physics.segment_laws.limit_point`. `contraction` is the contraction of all chambers.
    """
    return worm.segment.flattening_weight(worm, contraction)


def carried_weight(worm: Worm, gravity: float) -> FloatArray:
    """Return the weight that each segment carries if all segments stand on their lower apexes, shape (N,) [N].

    The weight of each mass is multiplied by its height divided by the half-height. The factor is 1 for the joints and
    the outward apexes, and 2 for the upper apexes.
    """
    mass = worm.joint_mass + worm.load_mass
    joints = (mass[:-1] + mass[1:]) / 2.0
    joints[0] += mass[0] / 2.0
    joints[-1] += mass[-1] / 2.0
    apexes = worm.apex_mass
    load: FloatArray = gravity * (joints + 2.0 * apexes[:, [1, 4]].sum(axis=1) + apexes[:, [2, 5]].sum(axis=1))
    return load


def require_equilibrium(worm: Worm, gravity: float, contraction: FloatArray | float = 0.0) -> None:
    """Raise LimitPointError if the chambers together cannot carry the weight of the worm.

    This check is for a worm at the start, where its chambers have a `contraction` of shape (N, 2). Commands that
    lengthen the chambers reduce the weight that they can carry (`flattening_weight`), and a wave may put the weight on
    few segments. If chambers are flattened then, the run ends with the status FLATTENED.
    """
    kinds, which = np.unique(np.broadcast_to(contraction, (worm.segments, 2)).mean(axis=1), return_inverse=True)
    limits = np.array([flattening_weight(worm, float(each)) for each in kinds])
    load, limit = carried_weight(worm, gravity), limits[which, np.arange(worm.segments)]
    if load.sum() >= limit.sum():
        i, carried = int(np.argmax(load / limit)), gravity * float(worm.load_mass.sum())
        room = (limit.sum() - carried) / (load.sum() - carried)
        lighter = f"make the worm lighter than {worm.mass * room:.3g} kg, or" if room > 0.0 else "carry less, or make"
        raise LimitPointError(
            f"segment {i} would be pressed flat: it carries {load[i]:.3g} N, its limit point is {limit[i]:.3g} N; "
            f"{lighter} {worm.segment.bears_more}"
        )


def require_shape(worm: Worm, state: State) -> None:
    """Raise StateError if a state does not fit the worm: the number of segments, and lengths at any contraction."""
    if state.segments != worm.segments:
        raise StateError(f"state: got {state.segments} segments, the worm has {worm.segments}")
    low, high = worm.segment.possible(worm)
    chambers = _chambers(worm, state)
    wrong = ~((chambers > low) & (chambers < high)).all(axis=1)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise StateError(
            f"state: the chambers of segment {i} are {chambers[i].min():.4g} and {chambers[i].max():.4g} m long, must "
            f"lie between {low[i, 0]:.4g} and {high[i, 0]:.4g} m, {worm.segment.bounded_by}"
        )


def require_domain(worm: Worm, state: State) -> None:
    """Raise StateError if a chamber of a state has a length that its segment law does not have at its contraction."""
    (low, high), chambers = worm.segment.possible(worm, state.contraction), _chambers(worm, state)
    room = DOMAIN_ROUNDING * worm.l0
    wrong = ~((chambers > low - room) & (chambers < high + room))
    if wrong.any():
        i, side = np.argwhere(wrong)[0]
        raise StateError(
            f"state: the {CHAMBER_SIDES[side]} chamber of segment {i} is {chambers[i, side]:.4g} m long, must lie "
            f"between {low[i, side]:.4g} and {high[i, side]:.4g} m at its contraction of "
            f"{state.contraction[i, side]:.4g}, {worm.segment.bounded_by}; change one of them, or let the worm settle"
        )


def _chambers(worm: Worm, state: State) -> FloatArray:
    """Return the lengths of the chambers [left, right] of a state, shape (N, 2) [m]."""
    length = np.linalg.norm(np.diff(state.joints, axis=0), axis=1)
    found: FloatArray = length[:, None] + np.outer(worm.chamber_offset * state.bend, [-1.0, 1.0])
    return found


def require_felt(worm: Worm, world: World | None) -> None:
    """Raise StateError for terrain with bumps that would pass between contact points and reach the worm's axis."""
    bump, clearance = 0.0 if world is None else world.bumps(worm.l0), float(np.max(worm.half_height))
    if bump > clearance:
        raise StateError(
            f"state: the terrain is finer than the worm's contact points: it has bumps of {bump:.3g} m within "
            f"{worm.l0:.3g} m, the distance of its feet, which are {clearance:.3g} m below its axis; smooth or lower "
            "it, or take more segments"
        )


def require_clear(plant: Plant, overlap: float) -> None:
    """Raise StateError if a contact point lies deeper in the world than `overlap` times the segment length."""
    depth = plant.depth()
    if depth.max() > overlap * plant.worm.l0:
        segment = int(np.argmax(depth.max(axis=0)))
        raise StateError(f"state: segment {segment} lies {depth.max():.3g} m inside the world; lift or move the worm")


def settle(problem: Problem, start: State) -> Rested:
    """Return the worm at rest under the component of gravity that presses it against the world (`World.pressing`).

    The function takes long steps of implicit Euler without friction, and stops the motion after each step. If the world
    is `uneven`, it takes short steps instead, with contacts that stick, until the worm is at rest. In the returned
    state, the memory has the normal loads, and static friction is unloaded.
    """
    for mu in STICKING_FRICTION if problem.world is not None and problem.world.uneven else (0.0,):
        rested = _settled(problem, start, mu)
        if rested.status is Status.DONE:
            break
    return rested


def _settled(problem: Problem, start: State, mu: float) -> Rested:
    worm, world = problem.worm, problem.world
    assert world is not None
    if worm.loads:
        worm = replace(worm, load=tuple(each for each in worm.loads if each.acts_at_rest))
    friction = Friction(mu, mu, mu, 1.0, contact_stiffness=problem.friction.contact_stiffness)
    plant = Plant(worm, world, friction, world.pressing(problem.weight), problem.held_mask, scale=problem.weight)
    plant.set_pose(start)
    plant.hasten(HASTE)
    command = np.zeros(5 * worm.segments)
    command[: 2 * worm.segments] = start.contraction.ravel()
    slides, rest = mu == 0.0, REST_TOLERANCE * worm.length
    rate, steps = (STICKING_RATE / 100.0, 200) if slides else (STICKING_RATE, 1000)
    end, moved, _ = settle_core(plant.core, command, plant.natural_time / rate, steps, slides, rest, np.inf)
    if end != OK:
        status = GUARDED[end]
        unsettled = status is Status.NO_CONVERGENCE
        return Rested(start, Status.UNSETTLED if unsettled else status, plant.refused(status)[1])
    plant.reset_at_pose()
    rests = moved < REST_TOLERANCE_LOOSE * worm.length
    return Rested(plant.state(start.time), Status.DONE if rests else Status.UNSETTLED)


def hold(plant: Plant) -> bool:
    """Apply the friction of the run to a worm at rest, and return whether this friction holds the worm.

    The function takes steps of implicit Euler until the worm is at rest again, and leaves it there with its friction
    forces. A worm that does not come to rest is set back to the previous pose.
    """
    before, command, length = plant.memory(), plant.arrays["asked"][0].copy(), plant.worm.length
    plant.hasten(HASTE)
    rest, far = REST_TOLERANCE * length, SLIDES * length
    dt = plant.natural_time / STICKING_RATE
    end, moved, away = settle_core(plant.core, command, dt, 2000, False, rest, far)
    holds = end == OK and moved < REST_TOLERANCE_LOOSE * length and away <= far
    if not holds:
        plant.remember(before)
    plant.hasten(1.0)
    plant.zero_velocities()
    return holds


def settles(world: World | None, gravity: FloatArray, contracted: bool = False) -> bool:
    """Return whether a worm can be settled.

    There must be a world that is not clamped, and gravity must press the worm against it, or its chambers must be
    contracted.
    """
    if world is None or world.clamped:
        return False
    return contracted or bool(np.any(world.pressing(gravity)))


class Placed(NamedTuple):
    """A worm before its first step."""

    plant: Plant
    state: State
    """Initial state of the run."""
    status: Status
    """DONE, or the reason why the run cannot start."""
    settling: float | None
    """Largest displacement of a joint during settling [m]. None if the worm was not settled."""
    reason: str = ""
    """The part of the worm that caused a failure, and the remedy."""


def touches(plant: Plant, start: State) -> bool:
    """Return whether the worm touches the world at the start.

    Contracted actuators make the chambers higher than at rest. Therefore the worm also counts as touching if the gap to
    the world is at most this increase of the height. A straight worm that was `laid` on rough ground touches the world
    if the gap is at most the half-height.
    """
    worm, height = plant.worm, np.asarray(plant.worm.half_height)
    contracted, _ = worm.segment.free_outlines(worm, worm.l0 * (1.0 - np.clip(start.contraction, *worm.stroke)))
    rounding = 1e-6 * worm.length
    grown = float(np.max(contracted - height[:, None], initial=0.0))
    return plant.gap() <= max(grown + rounding, float(height.max()) if start.laid else 0.0)


def place(problem: Problem, settling: Settling = settle) -> Placed:
    """Return the worm before the first step, settled if requested. Raises the errors of `worm3d.simulate`."""
    worm, world, gravity = problem.worm, problem.world, problem.weight
    start = State.straight(worm, world) if problem.state is None else problem.state
    require_shape(worm, start)
    require_felt(worm, world)
    if settles(world, gravity):
        assert world is not None
        require_equilibrium(worm, float(np.linalg.norm(world.pressing(gravity))), start.contraction)
    plant = Plant(worm, world, problem.friction, gravity, problem.held_mask)
    plant.set_pose(start)
    require_clear(plant, SUNK_DEPTH if start.memory else OVERLAP)
    if start.memory:
        plant.remember(start.memory)
    elif _needs_settling(plant, start, problem.settle_first):
        status, reason = _come_to_rest(plant, problem, start, settling)
        moved = float(np.linalg.norm(plant.arrays["joints"][:3, : plant.n + 1].T - start.joints, axis=1).max())
        return Placed(plant, start, status, moved if status is Status.DONE else None, reason)
    else:
        require_domain(worm, start)
    return Placed(plant, start, Status.DONE, None)


def _needs_settling(plant: Plant, start: State, settle_first: bool | None) -> bool:
    """Return whether to settle a worm before the first step. The default is whether the worm touches the world."""
    if start.moves or not settles(plant.world, plant.gravity, bool(start.contraction.any())):
        return False
    return touches(plant, start) if settle_first is None else settle_first


def _come_to_rest(plant: Plant, problem: Problem, start: State, settling: Settling) -> tuple[Status, str]:
    """Bring the worm to rest from the initial state. Return `Placed.status` and `Placed.reason`."""
    rested, status, reason = settling(problem, start)
    if status is Status.DONE:
        plant.set_pose(rested)
        plant.set_normal_loads(rested.memory["load_n"].reshape(POINTS_PER_SEGMENT, -1)[:, : plant.n])
        if plant.world is not None and plant.world.uneven:
            hold(plant)
    return status, reason
