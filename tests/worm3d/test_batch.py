"""Many runs at once are the runs one by one."""

import numpy as np
import pytest

from control.gaits import TravellingWave
from worm3d import Friction, LimitPointError, Plane, State, Status, Worm, simulate, simulate_batch

WORMS = [Worm(), Worm(segments=8), Worm(mass=0.15)]
GAITS = [TravellingWave(), TravellingWave(amplitude=0.3, bias=0.3), TravellingWave(period=1.0)]


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_run_is_that_of_simulate(threads: int) -> None:
    runs = simulate_batch(WORMS, Plane(0.05), Friction(), GAITS, duration=1.0, record_every=10, threads=threads)
    for worm, gait, run in zip(WORMS, GAITS, runs, strict=True):
        alone = simulate(worm, Plane(0.05), Friction(), gait, duration=1.0, record_every=10)
        assert run.worm is worm
        assert run.status is alone.status is Status.DONE
        for name in ("joints", "contact_force", "newton_iterations"):
            np.testing.assert_array_equal(getattr(run, name), getattr(alone, name))
        np.testing.assert_array_equal(run.energy.numerical_loss, alone.energy.numerical_loss)


def test_one_run_that_stops_does_not_stop_the_others() -> None:
    pulls = [None, lambda t: np.full((7, 3), np.nan), None]
    runs = simulate_batch(
        Worm(), None, external_force=[pulls[0], lambda t: np.zeros((7, 3)) / (t < 0.2), None], duration=0.4
    )
    assert [run.status for run in runs] == [Status.DONE, Status.BAD_COMMAND, Status.DONE]
    assert len(runs[1].time) == 20
    with pytest.raises(ValueError, match="run 1: external_force: got shape"):
        simulate_batch(Worm(), None, external_force=pulls)


def test_what_cannot_be_run_is_said_before_any_begins() -> None:
    with pytest.raises(ValueError, match="got no list, must have one"):
        simulate_batch(Worm(), Plane())
    with pytest.raises(ValueError, match="got 3 of worm, 2 of actuation, lists must have one for each run"):
        simulate_batch(WORMS, Plane(), actuation=GAITS[:2])
    with pytest.raises(LimitPointError, match="run 1: segment"):
        simulate_batch([Worm(), Worm(mass=5.0)], Plane())
    with pytest.raises(ValueError, match="threads: got 0"):
        simulate_batch(WORMS, Plane(), threads=0)
    assert simulate_batch([], Plane()) == []
    start = State.straight(Worm(), Plane(), (1.0, 0.0))
    ahead, here = simulate_batch(Worm(), Plane(), actuation=TravellingWave(), state=[start, None], duration=0.5)
    np.testing.assert_allclose(ahead.com[-1, 0] - here.com[-1, 0], 1.0, atol=1e-9)
