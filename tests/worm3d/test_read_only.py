"""Arrays of what is frozen are read-only: all of them, nested too, in copies, and where they were pickled."""

import copy
import dataclasses
import pickle
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from control.gaits import TravellingWave
from control.tracking.paths import SplinePath, WayPoints
from planar import linkage
from worm3d import (
    Centreline,
    Command,
    Friction,
    Heightfield,
    Patch,
    Pipe,
    Plane,
    Profile,
    Result,
    State,
    Straight,
    Union,
    Worm,
    simulate,
)
from worm3d.values.read_only import kept

POINTS = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [2.0, 0.0, 0.1]]
PIPE = Pipe(Centreline.of([Straight(2.0)]), Profile([0.0, 1.0], [0.12, 0.14]), (Patch(0.5),))

FROZEN = {
    "worm": Worm(),
    "friction": Friction(),
    "state": State.straight(Worm()),
    "command": Command(np.zeros((6, 2))),
    "centre line": Centreline.through(POINTS),
    "profile": Profile([0.0], [0.1]),
    "pipe": PIPE,
    "heightfield": Heightfield(np.zeros((5, 5)), 0.1, grip=np.ones((5, 5))),
    "union": Union([PIPE, Plane()]),
    "spline": SplinePath(np.array(POINTS)[:, :2]),
    "way points": WayPoints([[0, 0], [5, 0], [5, 5]]),
    "linkage": linkage.Linkage(),
    "planar friction": linkage.Friction(),
}

WAYS: dict[str, Callable[[Any], Any]] = {
    "itself": lambda thing: thing,
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "replace": lambda thing: dataclasses.replace(thing) if type(thing).__name__ not in OWN_INIT else thing,
}
OWN_INIT = ("WayPoints", "Union")
"""Whose constructors take less than their fields."""


def arrays(thing: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(thing, np.ndarray):
        yield name, thing
    elif isinstance(thing, Mapping):
        assert isinstance(thing, MappingProxyType), f"{name} can be written to"
        for key, value in thing.items():
            yield from arrays(value, f"{name}[{key!r}]")
    elif isinstance(thing, list | tuple):
        for k, value in enumerate(thing):
            yield from arrays(value, f"{name}[{k}]")
    elif dataclasses.is_dataclass(thing):
        for key, value in vars(thing).items():
            yield from arrays(value, f"{name}.{key}")


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(Worm(), Plane(), Friction(forward=np.full(6, 0.03)), TravellingWave(), duration=0.1)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["result", *FROZEN])
def test_arrays_are_read_only(result: Result, name: str, way: str) -> None:
    original = {**FROZEN, "result": result}[name]
    found, before = list(arrays(WAYS[way](original), name)), dict(arrays(original, name))
    assert found
    for place, array in found:
        assert not array.flags.writeable, f"{place} can be written to"
        assert_array_equal(array, before[place])


@pytest.mark.parametrize("name", ["com_velocity", "heading", "chamber_strain", "end_load", "apexes"])
def test_what_a_result_computes_is_read_only(result: Result, name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(result, name)[0] = 1.0


def test_an_array_that_was_given_stays_the_callers_own() -> None:
    stiffness = np.full(6, 13.0)
    worm = Worm(k_spring=stiffness)
    stiffness[:] = 1.0
    assert_array_equal(worm.k_spring, 13.0)


def test_a_pickled_state_goes_on_bit_for_bit(result: Result) -> None:
    on = simulate(Worm(), Plane(), actuation=TravellingWave(), duration=0.1, state=result.state)
    kept = pickle.loads(pickle.dumps(result.state))
    again = simulate(Worm(), Plane(), actuation=TravellingWave(), duration=0.1, state=kept)
    assert_array_equal(on.joints, again.joints)


def test_what_is_kept_of_an_instance_is_computed_once_and_not_for_its_changed_copy() -> None:
    calls = []

    @kept
    def doubled(worm: Worm) -> float:
        calls.append(worm)
        return 2.0 * worm.length

    worm = Worm()
    assert doubled(worm) == doubled(worm) == 2.0 * worm.length
    assert len(calls) == 1
    longer = dataclasses.replace(worm, length=3.0)
    assert doubled(longer) == 6.0
    assert calls == [worm, longer]
