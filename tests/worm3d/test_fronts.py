"""What contacts are expected to do: fronts that run along the body at a steady pace are awaited, others are not."""

import pytest
from numpy.testing import assert_array_equal

from control.gaits import TravellingWave
from worm3d import Plane, Worm, simulate


@pytest.mark.parametrize("segments", [60, 100])
def test_long_worms_take_not_many_more_iterations_than_a_short_one(segments: int) -> None:
    """In each of their steps contacts change somewhere; by the contacts' last state alone it was 2.3 and 2.8 times.

    Nearly every step has a round of breakaway, (C6), which a solved step begins: 2.05 times with 100 segments.
    """
    short, long = (
        simulate(Worm(segments=n), Plane(), actuation=TravellingWave(), duration=4.0, tolerance=1e-9).newton_iterations
        for n in (6, segments)
    )
    assert long[100:].mean() < 2.2 * short[100:].mean()


def test_the_first_guess_of_a_run_that_is_resumed_is_that_of_the_whole_run() -> None:
    worm, gait = Worm(segments=20), TravellingWave()
    whole = simulate(worm, Plane(), actuation=gait, duration=1.0)
    begun = simulate(worm, Plane(), actuation=gait, duration=0.5)
    rest = simulate(worm, Plane(), actuation=gait, duration=0.5, state=begun.state)
    assert_array_equal(rest.newton_iterations, whole.newton_iterations[-len(rest.newton_iterations) :])
