"""What contacts are expected to do: fronts that run along the body at a steady pace are awaited, others are not."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from control.gaits import TravellingWave
from worm3d import Friction, Plane, Worm, simulate
from worm3d.machine.compiled import njit
from worm3d.physics.kernels import point
from worm3d.running.plant import Plant
from worm3d.running.problem import held_mask
from worm3d.solver import arrays, fronts, regimes
from worm3d.solver.arrays import Core
from worm3d.solver.fronts import STEPS_LEFT

SEGMENTS = 9


@njit
def noted(core: Core) -> None:
    fronts.note(core)


@njit
def expected(core: Core) -> None:
    regimes.set_regimes_from_last_step(core)
    fronts.expect(core)


class Contacts:
    """The first apexes of a worm, whose contacts do what the test says: ">" and "<" slide, "#" sticks, "." is open."""

    def __init__(self) -> None:
        worm, gravity = Worm(segments=SEGMENTS), np.array([0.0, 0.0, -9.81])
        mask = held_mask(None, SEGMENTS, flat=worm.flat, clamped=False)
        self.plant = Plant(worm, Plane(), Friction(), gravity, mask)
        self.row = {name: point.POINT_LAYOUT.first(name) for name in ("load_n", "load_m", "pull", "pull_m", "regime")}

    def do(self, what: str) -> None:
        p, stuck = self.plant.arrays["point_in"], self.plant.arrays["stuck"][0]
        for i, kind in enumerate(what):
            load, pull = float(kind != "."), -0.2 if kind == "<" else 0.03
            for name, value in (("load_n", load), ("load_m", load), ("pull", pull), ("pull_m", pull)):
                p[self.row[name], i] = value
            stuck[i] = float(kind == "#")
        self.plant.arrays["pull_n"][:] = p[self.row["pull"] : self.row["pull"] + 2]
        noted(self.plant.core)

    @property
    def due(self) -> list[float]:
        return self.plant.arrays["fronts"][STEPS_LEFT, :SEGMENTS].tolist()

    def expect(self) -> str:
        expected(self.plant.core)
        p = self.plant.arrays["point_in"]
        names = {point.OPEN: ".", point.STICKING_FORWARD: "#", point.STICKING_BACK: "#"}
        regime, pull = p[self.row["regime"], :SEGMENTS], p[self.row["pull"], :SEGMENTS]
        return "".join(names.get(kind, ">" if f > 0.0 else "<") for kind, f in zip(regime, pull, strict=True))


def passed(changed: int, before: str, after: str, *, backward: bool) -> str:
    """Return what contacts do when a front has passed so many of them, from the tail or from the head."""
    what = after * changed + before * (SEGMENTS - changed)
    return what[::-1] if backward else what


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("before_after", [">#", "#<", "><", ".>", "#."])
@pytest.mark.parametrize("pace", [1, 2, 5])
def test_a_front_is_expected_where_and_when_it_arrives(pace: int, before_after: str, backward: bool) -> None:
    contacts, known = Contacts(), 0
    for step in range(-3, pace * SEGMENTS):
        changed = 0 if step < 0 else 1 + step // pace
        now = passed(changed, *before_after, backward=backward)
        contacts.do(now)
        if not 3 <= changed < SEGMENTS:
            continue  # two contacts, and a third as much later, show the pace
        due = [0.0] * SEGMENTS
        due[SEGMENTS - 1 - changed if backward else changed] = pace - step % pace
        assert contacts.due == due
        arrives = passed(changed + (step % pace == pace - 1), *before_after, backward=backward)
        assert contacts.expect() == arrives
        known += arrives != now
    assert known == SEGMENTS - 3


def test_no_front_is_awaited_where_the_pace_changes_or_is_slow() -> None:
    for steps in ((2, 3, 4, 2, 5), (30, 30, 30, 30)):
        contacts = Contacts()
        for changed, count in enumerate(steps):
            for _ in range(count):
                contacts.do(passed(changed, ">", "#", backward=False))
                assert contacts.due == [0.0] * SEGMENTS
                assert contacts.expect() == passed(changed, ">", "#", backward=False)


def test_a_contact_that_changes_by_itself_awaits_no_more() -> None:
    contacts = Contacts()
    for what in (">>>>>>>>>", "#>>>>>>>>", "#>>>>>>>>", "##>>>>>>>", "##>>>>>>>", "###>>>>>>"):
        contacts.do(what)
    assert contacts.due[3] == 2.0
    contacts.do("###.>>>>>")
    assert contacts.due == [0.0] * SEGMENTS


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
    assert np.any(begun.state.memory["fronts"] != 0.0)
    assert list(arrays.ARRAYS)[arrays.FRONTS] == "fronts"
