"""How many iterations Newton takes where left and right contacts differ: nothing but a silent slow-down shows there."""

import numpy as np
import pytest

from control.gaits import TravellingWave
from worm3d import Bend, Centreline, Friction, Pipe, Plane, Result, Straight, Worm, simulate
from worm3d.recorded.status import Status
from worm3d.worlds import World

ALONG = np.linspace(0.0, 1.0, 7)
SPLINE = np.column_stack([4.0 * ALONG, 0.5 * np.sin(4.0 * ALONG), 0.3 * ALONG])
ARC = np.linspace(0.0, 1.5, 9)
CIRCLE = np.column_stack([2.0 * np.sin(ARC), 2.0 * (1.0 - np.cos(ARC)), np.zeros(9)])


def crawled(world: World, bias: float = 0.0, static_ratio: float = 1.2) -> Result:
    gait = TravellingWave(bias=bias)
    run = simulate(Worm(), world, Friction(static_ratio=static_ratio), actuation=gait, duration=8.0)
    assert run.status is Status.DONE
    return run


@pytest.mark.parametrize("bias", [0.01, 0.05])
def test_a_worm_that_hardly_turns_takes_at_most_twice_the_iterations_of_one_that_goes_straight(bias: float) -> None:
    """With Newton's primal tangents of sliding friction it took 3.5 and 2.6 times as many, and fell back 63 times."""
    straight, turning = crawled(Plane()), crawled(Plane(), bias)
    assert turning.newton_iterations.mean() < 2.0 * straight.newton_iterations.mean()
    assert turning.fallbacks.sum() < 0.01 * len(turning.fallbacks)


@pytest.mark.parametrize(
    "world",
    [
        Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 0.48), Straight(3.0)]), 0.12),
        Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 2.0), Straight(3.0)]), 0.12),
        Pipe(SPLINE, 0.12),
    ],
    ids=["bend", "wide bend", "spline"],
)
def test_in_a_crooked_pipe_newton_seldom_falls_back(world: Pipe) -> None:
    """Before, it did in 20, 55 and 69 of these 800 steps."""
    assert crawled(world).fallbacks.sum() < 16


def test_a_pipe_through_points_of_a_circle_costs_as_many_iterations_as_a_bend() -> None:
    """Where curvature is continuous, and where it jumps from arc to arc (16 times in the spline of a circle)."""
    bend = crawled(Pipe(Centreline.of([Bend(1.5, 2.0)]), 0.12))
    spline = crawled(Pipe(CIRCLE, 0.12))
    assert abs(spline.newton_iterations.mean() / bend.newton_iterations.mean() - 1.0) < 0.15
    assert abs(spline.distance / bend.distance - 1.0) < 0.02


def test_friction_in_one_direction_alone_costs_few_iterations() -> None:
    """What slides turns and turns: with all but the changed contacts' part of the Jacobian kept then, it took 7."""
    gait, friction = TravellingWave(), Friction(1.0, 0.01, 0.01)
    run = simulate(Worm(), Plane(), friction, actuation=gait, duration=0.5, dt=0.005)
    assert (run.newton_iterations + run.gradient_evaluations).mean() < 6.0
    assert not run.fallbacks.any()
