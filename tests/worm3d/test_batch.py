"""Many runs at once are the runs one by one."""

from threading import get_ident
from typing import Any

import numpy as np
import pytest

from control.gaits import TravellingWave
from worm3d import Command, Friction, LimitPointError, Plane, State, Status, Worm, simulate, simulate_batch
from worm3d.running import places as places_of_batch
from worm3d.running.start import place

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


@pytest.mark.parametrize("threads", [1, 3])
def test_equal_worms_are_put_there_once_and_go_their_own_ways(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    places = []

    def counted(*given: Any) -> Any:
        places.append(given)
        return place(*given)

    monkeypatch.setattr(places_of_batch, "place", counted)
    worms = [Worm() for _ in range(5)]
    grounds = [Friction(), Friction(), Friction(), Friction(forward=0.1), Friction()]
    gaits = [*GAITS, GAITS[0], None]
    ahead = simulate(worms[0], Plane(), duration=0.3, actuation=GAITS[0]).state
    states = [None, None, None, None, ahead]
    places.clear()
    plane = Plane()
    runs = simulate_batch(worms, plane, grounds, gaits, state=states, duration=1.0, threads=threads)
    assert len(places) == 3, "one of three equal worms, one on other ground, one from another state"
    for k, run in enumerate(runs):
        alone = simulate(worms[k], plane, grounds[k], gaits[k], state=states[k], duration=1.0)
        assert run.worm is worms[k]
        for name in ("joints", "contact_force", "newton_iterations"):
            np.testing.assert_array_equal(getattr(run, name), getattr(alone, name))
        for name, memory in alone.state.memory.items():
            np.testing.assert_array_equal(run.state.memory[name], memory)


def test_one_run_that_stops_does_not_stop_the_others() -> None:
    pulls = [None, lambda t: np.full((7, 3), np.nan), None]
    runs = simulate_batch(
        Worm(), None, external_force=[pulls[0], lambda t: np.zeros((7, 3)) / (t < 0.2), None], duration=0.4
    )
    assert [run.status for run in runs] == [Status.DONE, Status.BAD_COMMAND, Status.DONE]
    assert len(runs[1].time) == 20
    with pytest.raises(ValueError, match="run 1: external_force: got nan, every value must be finite"):
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


def _raises(t: float) -> Command:
    raise ZeroDivisionError("valve 3")


def test_a_function_that_raises_at_the_start_ends_its_own_run_only() -> None:
    results = simulate_batch(Worm(), Plane(), actuation=[TravellingWave(), _raises, TravellingWave()], duration=0.1)
    assert [result.status for result in results] == [Status.DONE, Status.BAD_COMMAND, Status.DONE]
    assert "ZeroDivisionError: valve 3" in results[1].stop.sentence
    assert len(results[1].time) == 1
    alone = simulate(Worm(), Plane(), external_force=_raises, duration=0.1)
    assert alone.status is Status.BAD_COMMAND
    assert np.isfinite(alone.joints).all()


def test_what_is_refused_names_the_run() -> None:
    class Broken:
        def bind(self, worm: Worm) -> None:
            raise RuntimeError("no such valve")

    with pytest.raises(ValueError, match="run 1: actuation: returned a NoneType"):
        simulate_batch(Worm(), Plane(), actuation=[TravellingWave(), lambda t: None], duration=0.1)  # type: ignore[list-item, return-value]
    with pytest.raises(RuntimeError, match="no such valve") as caught:
        simulate_batch(Worm(), Plane(), actuation=[TravellingWave(), Broken()], duration=0.1)  # type: ignore[list-item]
    assert "run 1 of the batch" in caught.value.__notes__[0]


def test_runs_are_prepared_in_the_thread_that_calls() -> None:
    """CasADi, which each worm needs for its start, must not be used by two threads at a time."""
    threads = set[int]()

    class Told(TravellingWave):
        def bind(self, worm: Any) -> Any:
            threads.add(get_ident())
            return super().bind(worm)

    worms = [Worm(k_spring=12.0 + k) for k in range(4)]
    simulate_batch(worms, Plane(), actuation=[Told()] * 4, duration=0.02, threads=4)
    assert threads == {get_ident()}
