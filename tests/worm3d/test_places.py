"""A worm that was put on its world before is a copy of that one: the same bits, and nobody else's."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Plane, State, StateError, Worm
from worm3d.running import places
from worm3d.running.problem import Problem
from worm3d.running.start import place


@pytest.fixture
def placed(monkeypatch: pytest.MonkeyPatch) -> list[Problem]:
    """The problems whose worm was put on its world anew."""
    found: list[Problem] = []

    def counted(problem: Problem, *more: object) -> places.Placed:
        found.append(problem)
        return place(problem, *more)

    monkeypatch.setattr(places, "place", counted)
    monkeypatch.setattr(places, "_kept", places.Places(2))
    return found


def test_a_kept_worm_runs_bit_for_bit_as_one_put_there_anew(placed: list[Problem]) -> None:
    runs = [worm3d.simulate(Worm(), Plane(0.1), actuation=TravellingWave(bias=0.1), duration=0.3) for _ in range(3)]
    assert len(placed) == 1, "equal worms on equal worlds, though none is the same object"
    fresh = place(Problem(worm=Worm(), world=Plane(0.1), actuation=TravellingWave(bias=0.1), duration=0.3))
    again = places.place_kept(Problem(worm=Worm(), world=Plane(0.1), duration=0.1))
    for name, values in fresh.plant.memory().items():
        assert_array_equal(again.plant.memory()[name], values, err_msg=name)
    for run in runs[1:]:
        assert_array_equal(run.joints, runs[0].joints)
        assert_array_equal(run.energy.numerical_loss, runs[0].energy.numerical_loss)


@pytest.mark.parametrize(
    "other",
    [
        {"worm": Worm(k_spring=13.1)},
        {"world": Plane(0.01)},
        {"ground": Friction(forward=0.3)},
        {"gravity": (0.0, 0.0, -3.7)},
        {"settle_first": False},
        {"held": np.array([[True, False, False]] + 6 * [[False] * 3])},
        {"state": State.straight(Worm(), Plane(), (0.5, 0.0))},
    ],
)
def test_what_differs_is_put_there_anew(other: dict[str, object], placed: list[Problem]) -> None:
    problem = Problem(worm=Worm(), world=Plane())
    for each in (problem, replace(problem, **other), problem):
        places.place_kept(each)
    assert placed == [problem, placed[1]], "the first is still there"


def test_only_the_last_ones_are_kept(placed: list[Problem]) -> None:
    for mass in (0.1, 0.2, 0.1, 0.3, 0.1, 0.2):
        places.place_kept(Problem(worm=Worm(mass=mass), world=Plane()))
    assert [problem.worm.mass for problem in placed] == [0.1, 0.2, 0.3, 0.2]


@dataclass(frozen=True)
class Hill(Plane):
    """A world of one's own, which may change between runs."""


def test_worlds_of_ones_own_and_refusals_are_not_kept(placed: list[Problem]) -> None:
    for _ in range(2):
        places.place_kept(Problem(worm=Worm(), world=Hill()))
        inside = Problem(worm=Worm(), world=Plane(), state=State.straight(Worm(), None))
        with pytest.raises(StateError, match="inside the world"):
            places.place_kept(inside)
    assert len(placed) == 4
