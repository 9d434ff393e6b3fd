"""Checks before a run, and settling: the worm comes to rest on the world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from worm3d.physics import elements
from worm3d.physics.friction import RESTING_PENETRATION, Friction
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.physics.worm import Worm
from worm3d.recorded.state import State, StateError
from worm3d.recorded.status import Status
from worm3d.running.plant import SUNK_DEPTH, Plant
from worm3d.running.problem import Problem
from worm3d.solver.guard import OK
from worm3d.solver.pose import settle as settle_core
from worm3d.values.arrays import FloatArray
from worm3d.worlds import World


class Rested(NamedTuple):
    """A worm that was brought to rest, or the initial state if that failed."""

    state: State
    status: Status
    """Status DONE, or the reason why the worm does not come to rest."""
    reason: str = ""
    """The part at fault, and the remedy."""


Settling = Callable[[Problem, State], Rested]
"""Function with the parameters and the return value of `settle`."""


STICKING_RATE = 100.0 * float(np.sqrt(1.0 / 9.81))
"""Number of time steps in a `Plant.natural_time` on uneven worlds: steps of 0.01 s for the default worm.

Contacts that stick hold the worm at the first possible position, which depends on the step: half and double the rate
move the pose by up to 1.2e-2 and 1.7e-3 of the body length, on rubble and in bends. No value is more correct than
another.
"""

STICKING_FRICTION = (3.0, 1.0, 10.0)
"""Coefficients of friction on uneven worlds, tried in turn: with too little friction a worm slides down a steep place,
with too much friction a worm may jam in a pose that no step reaches."""

REST_TOLERANCE = 1e-13
"""Motion of the joints per step, as a fraction of the body length, that counts as rest."""

REST_TOLERANCE_LOOSE = 1e-9
"""Motion per step, as a fraction of the body length, accepted as rest when rounding prevents `REST_TOLERANCE`."""

HASTE = 1e6
"""Speed-up of the actuators while the worm comes to rest: slow valves would prevent rest.

Half and double give the same result: with factors from 1e3 to 1e12, pneumatic chambers with valves from 1e-10 to 1e-3
kg/(s Pa) come to rest in the same pose within 4e-13 m. With a factor of 1, valves of 1e-8 kg/(s Pa) and below prevent
rest.
"""

SLIDES = 0.03
"""Largest motion of a held worm before rest, as a fraction of the body length; a longer slide belongs to the run."""

OVERLAP = 10.0 * RESTING_PENETRATION
"""Largest depth of a contact point at the start, as a fraction of the segment length."""

LIMIT_ANGLES = 65
"""Number of angles in each of five rounds of the search for the limit point. Each round lies between the neighbours of
the best angle. The angle is accurate to 1e-7 and the weight to 1e-14, since the weight has a maximum there."""

GUARDED = (Status.DONE, Status.NO_CONVERGENCE, Status.NOT_FINITE, Status.FLATTENED, Status.FOLDED, Status.SUNK)
"""Status for each way that a step can end (`worm3d.solver.guard`)."""


class LimitPointError(ValueError):
    """The worm's weight would flatten the chambers: there is no equilibrium to start from."""


def flattening_weight(worm: Worm, contraction: float = 0.0) -> FloatArray:
    """Return the weight that flattens each segment (limit point), shape (N,) [N].

    A segment whose joints, at height h above the lower apexes, carry the vertical load w is in equilibrium if
    dE/dl = w dh/dl. E is the energy of both chambers, each with this `contraction`. The greatest w with a solution is
    the limit point: under a greater load the chamber collapses.
    """
    shapes = zip(np.asarray(worm.k_spring), np.asarray(worm.k_apex), worm.link_length, strict=True)
    return np.array([_limit_point(k, k_apex, a, worm.l0, contraction) for k, k_apex, a in shapes])


@cache
def _limit_point(k: float, k_apex: float, a: float, l0: float, contraction: float) -> float:
    commanded = l0 * (1.0 - contraction)
    low, high = float(elements.hinge_angle(ca.SX(a), ca.SX(commanded))), np.pi
    for _ in range(5):
        place = np.linspace(low, high, LIMIT_ANGLES)
        carried = _carried()(place[None], k, k_apex, a, l0, commanded).full()[0]
        best = int(np.argmax(carried))
        low, high = place[max(best - 1, 0)], place[min(best + 1, LIMIT_ANGLES - 1)]
    return float(carried[best])


@cache
def _carried() -> ca.Function:
    """Return the weight as a function of hinge angles; unlike in the length, it is regular up to the flat chamber.

    The arguments of the function are the angles, k, k_apex, link, rest length and commanded length.
    """
    angle, k, k_apex, a, l0, commanded = given = [ca.SX.sym("x") for _ in range(6)]
    length, height = 2.0 * a * ca.sin(angle / 2.0), a * ca.cos(angle / 2.0)
    turning = elements.hinge_energy(k_apex, angle, elements.hinge_angle(a, l0))
    energy = elements.chamber_energy(k, l0, length, commanded) + turning
    weight = -2.0 * ca.gradient(energy, angle) / ca.gradient(height, angle)
    return ca.Function("weight", given, [weight]).map(LIMIT_ANGLES)


def carried_weight(worm: Worm, gravity: float) -> FloatArray:
    """Return the weight that each segment carries if all segments stand on the lower apexes, shape (N,) [N].

    The joints and the outward apexes are at the half-height and count once; the upper apexes are at twice the
    half-height and count twice.
    """
    mass = worm.joint_mass + worm.load_mass
    joints = (mass[:-1] + mass[1:]) / 2.0
    joints[0] += mass[0] / 2.0
    joints[-1] += mass[-1] / 2.0
    apexes = worm.apex_mass
    load: FloatArray = gravity * (joints + 2.0 * apexes[:, [1, 4]].sum(axis=1) + apexes[:, [2, 5]].sum(axis=1))
    return load


def require_equilibrium(worm: Worm, gravity: float) -> None:
    """Raise LimitPointError if the chambers cannot carry the weight, however the chambers share the weight.

    This check is for the uncommanded worm. Lengthening lowers the limit (`flattening_weight`), and a wave may put the
    weight on few segments; a failure in these cases ends the run with a separate reason.
    """
    load, limit = carried_weight(worm, gravity), flattening_weight(worm)
    if load.sum() >= limit.sum():
        i, carried = int(np.argmax(load / limit)), gravity * float(worm.load_mass.sum())
        room = (limit.sum() - carried) / (load.sum() - carried)
        lighter = f"make the worm lighter than {worm.mass * room:.3g} kg, or" if room > 0.0 else "carry less, or make"
        raise LimitPointError(
            f"segment {i} would be pressed flat: it carries {load[i]:.3g} N, its limit point is {limit[i]:.3g} N; "
            f"{lighter} k_spring or half_height larger"
        )


def require_shape(worm: Worm, state: State) -> None:
    """Raise StateError if a state does not fit the worm."""
    if state.segments != worm.segments:
        raise StateError(f"state: got {state.segments} segments, the worm has {worm.segments}")
    length = np.linalg.norm(np.diff(state.joints, axis=0), axis=1)
    chambers = length[:, None] + worm.chamber_offset * np.abs(state.bend)[:, None] * [-1.0, 1.0]
    wrong = ~((chambers > 0.0) & (chambers < 2.0 * worm.link_length[:, None])).all(axis=1)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise StateError(
            f"state: the chambers of segment {i} are {chambers[i].min():.4g} and {chambers[i].max():.4g} m long, must "
            f"lie between 0 and {2 * worm.link_length[i]:.4g} m, twice the links"
        )


def require_felt(worm: Worm, world: World | None) -> None:
    """Raise StateError for terrain with bumps that would pass between contact points and through the worm's axis."""
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
    """Return the worm at rest under the component of gravity that presses the worm to the world, and the status.

    The method takes long steps of implicit Euler without friction and stops the motion after each step. If the world is
    `uneven`, the method takes short steps with contacts that stick, until the worm rests. The state has loads but no
    anchors yet (the anchors are the points of contact). The status is DONE or the reason why the worm does not rest.
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
    friction = Friction(mu, mu, mu, 1.0)
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

    The function takes steps of implicit Euler until the worm rests again; the anchors then stay at the new points. A
    worm that does not come to rest returns to the previous pose.
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
    """Return whether a worm can be settled: there is an unclamped world, and a force presses the worm to this world."""
    if world is None or world.clamped:
        return False
    return contracted or bool(np.any(world.pressing(gravity)))


class Placed(NamedTuple):
    """A worm before its first step."""

    plant: Plant
    state: State
    """Initial state of the run."""
    status: Status
    """Status DONE, or the reason why the worm cannot start."""
    settling: float | None
    """Largest motion of a joint during settling [m]; None without settling."""
    reason: str = ""
    """The part at fault if the worm cannot start, and the remedy."""


def touches(plant: Plant, start: State) -> bool:
    """Return whether a contact point touches the world, or would touch with contracted chambers, which are higher.

    A straight worm `laid` on rough ground touches the world if the remaining gap is smaller than the half-height.
    """
    worm, height = plant.worm, np.asarray(plant.worm.half_height)
    half = worm.l0 * (1.0 - np.clip(start.contraction, *worm.stroke)) / 2.0
    contracted = np.sqrt(np.maximum(worm.link_length[:, None] ** 2 - half**2, 0.0))
    rounding = 1e-6 * worm.length
    grown = float(np.max(contracted - height[:, None], initial=0.0))
    return plant.gap() <= max(grown + rounding, float(height.max()) if start.laid else 0.0)


def place(problem: Problem, settling: Settling = settle) -> Placed:
    """Return the worm before the first step; raises the errors of `worm3d.simulate`."""
    worm, world, gravity = problem.worm, problem.world, problem.weight
    start = State.straight(worm, world) if problem.state is None else problem.state
    require_shape(worm, start)
    require_felt(worm, world)
    if settles(world, gravity):
        assert world is not None
        require_equilibrium(worm, float(np.linalg.norm(world.pressing(gravity))))
    plant = Plant(worm, world, problem.friction, gravity, problem.held_mask)
    plant.set_pose(start)
    require_clear(plant, SUNK_DEPTH if start.memory else OVERLAP)
    if start.memory:
        plant.remember(start.memory)
    elif _needs_settling(plant, start, problem.settle_first):
        status, reason = _come_to_rest(plant, problem, start, settling)
        moved = float(np.linalg.norm(plant.arrays["joints"][:3, : plant.n + 1].T - start.joints, axis=1).max())
        return Placed(plant, start, status, moved if status is Status.DONE else None, reason)
    return Placed(plant, start, Status.DONE, None)


def _needs_settling(plant: Plant, start: State, settle_first: bool | None) -> bool:
    """Return whether to settle a worm before the first step: by default if the worm touches the world."""
    if start.moves or not settles(plant.world, plant.gravity, bool(start.contraction.any())):
        return False
    return touches(plant, start) if settle_first is None else settle_first


def _come_to_rest(plant: Plant, problem: Problem, start: State, settling: Settling) -> tuple[Status, str]:
    """Bring the worm to rest from the initial state; return DONE, or the reason why the worm does not come to rest."""
    rested, status, reason = settling(problem, start)
    if status is Status.DONE:
        plant.set_pose(rested)
        plant.set_normal_loads(rested.memory["load_n"].reshape(POINTS_PER_SEGMENT, -1)[:, : plant.n])
        if plant.world is not None and plant.world.uneven:
            hold(plant)
    return status, reason
