"""A cache of worms on their worlds before the first step, so that equal worms are placed and settled only once."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from threading import Lock
from typing import Generic, TypeVar

from worm3d.recorded.state import State
from worm3d.running.problem import Problem
from worm3d.running.start import Placed, Rested, place, settle
from worm3d.worlds import World

T = TypeVar("T")

MAX_SEGMENTS_KEPT = 100
"""Number of segments of the largest worm that is kept for later runs of the process. Such a worm needs 2 MB. For larger
worms, placing takes little time compared with the run."""


class _Once(Generic[T]):
    """Cache for several threads. Each object is made once, and the `most` objects used last are kept."""

    def __init__(self, most: float) -> None:
        self._lock, self._most, self._found = Lock(), most, dict[Hashable, Future[T]]()

    def __call__(self, key: Hashable, make: Callable[[], T]) -> T:
        with self._lock:
            known = self._found.pop(key, None)
            found = self._found[key] = known or Future()  # the newest entry is dropped last
            if len(self._found) > self._most:
                del self._found[next(iter(self._found))]
        if known is None:
            try:
                found.set_result(make())
            except BaseException as error:
                self._found.pop(key, None)
                found.set_exception(error)
                raise
        return found.result()


class Places:
    """Cache of placed worms.

    Equal worms with equal friction are copies of a placed worm. Worms that differ only in their coefficients of
    friction share the settled pose.
    """

    def __init__(self, most: float = math.inf) -> None:
        self._placed, self._rested = _Once[Placed](most), _Once[Rested](most)

    def place(self, problem: Problem) -> Placed:
        """Return the result of `worm3d.running.start.place`."""
        key = self._key(problem, problem.settle_first, problem.friction, problem.state)
        placed = self._placed(key, lambda: place(problem, self._settle))
        own = placed.plant.copy()
        own.worm, own.world, own.gravity, own.friction = problem.worm, problem.world, problem.weight, problem.friction
        return placed._replace(plant=own)

    def _settle(self, problem: Problem, start: State) -> Rested:
        key = self._key(problem, start, problem.friction.contact_stiffness)
        return self._rested(key, lambda: settle(problem, start))

    def _key(self, problem: Problem, *parts: object) -> Hashable:
        worm, law = problem.worm, type(problem.friction.law)
        classes = (
            type(worm),
            *map(type, (worm.actuator, worm.hinge_actuator, worm.hysteresis, worm.medium, worm.segment, *worm.loads)),
            law,
        )
        fixed = problem.weight.tobytes(), problem.held_mask.tobytes()
        world = problem.world if _is_ours(problem.world) else id(problem.world)
        return world, classes, fixed, _content((worm, *parts))


def _is_ours(world: World | None) -> bool:
    """Return whether the class of a world belongs to worm3d. Objects of these classes never change."""
    return world is None or type(world).__module__.startswith("worm3d.")


def _content(parts: tuple[object, ...]) -> Hashable:
    """Return a key that is the same for equal parts. Parts that cannot be pickled get a key of their own."""
    try:
        return pickle.dumps(parts)
    except (AttributeError, TypeError, pickle.PicklingError):
        return object()


_kept = Places(16)


def place_kept(problem: Problem) -> Placed:
    """Return the result of `worm3d.running.start.place`, copied if an equal worm was placed on this world before.

    The worm is always placed again in a user-defined world, which may have changed, and from a state with memory.
    """
    goes_on = problem.state is not None and bool(problem.state.memory)
    keeps = _is_ours(problem.world) and not goes_on and problem.worm.segments <= MAX_SEGMENTS_KEPT
    return _kept.place(problem) if keeps else place(problem)
