"""The gate: what it lets through, what it refuses and why, and that nothing else comes through whatever comes."""

import numpy as np
import pytest
from fuzzing import replaced
from numpy.testing import assert_array_equal

from control.sensing.gate import SPAN, Gate, Refusal
from control.sensing.sensors import QUANTITIES, Measurement
from worm3d import Command, Observation, Plane, Worm, simulate

WORM = Worm()
NOW = 5.0
GOOD = Measurement(NOW, strain=(np.full((6, 2), -0.1), NOW), com=(np.array([1.0, 0.2, 0.07]), 4.9), heading=(0.3, 4.95))
NAN, INF = float("nan"), float("inf")


def changed(name: str, index: object, value: float) -> Measurement:
    sample = np.array(getattr(GOOD, name))
    sample[index] = value
    return replaced(GOOD, **{name: sample})


def test_good_measurements_pass_as_they_are() -> None:
    gate = Gate(WORM)
    assert gate(NOW, GOOD) is GOOD
    nothing = Measurement(NOW, strain=(None, NAN), com=(None, NAN))
    assert gate(NOW, nothing) is nothing
    assert gate.refused.total() == 0


@pytest.mark.parametrize(
    ("channel", "bad", "why"),
    [
        ("com", changed("com", 0, NAN), Refusal.NOT_FINITE),
        ("com", changed("com", 1, -INF), Refusal.NOT_FINITE),
        ("com", changed("com", 1, 1e30), Refusal.OUT_OF_RANGE),
        ("com", replaced(GOOD, com=np.zeros(2)), Refusal.SHAPE),
        ("com", replaced(GOOD, com="here"), Refusal.SHAPE),
        ("com", replaced(GOOD, com=[[1.0], [2.0, 3.0]]), Refusal.SHAPE),
        ("com", replaced(GOOD, com=np.zeros(3, dtype=complex)), Refusal.SHAPE),
        ("com", replaced(GOOD, com_time=NOW + 0.01), Refusal.FUTURE),
        ("com", replaced(GOOD, com_time=INF), Refusal.NO_TIME),
        ("com", replaced(GOOD, com_time=NAN), Refusal.NO_TIME),
        ("com", replaced(GOOD, com_time=None), Refusal.NO_TIME),
        ("com", replaced(GOOD, com_time=NOW - SPAN - 0.1), Refusal.TOO_OLD),
        ("strain", replaced(GOOD, strain=np.full((6, 2), NAN)), Refusal.NOT_FINITE),
        ("strain", replaced(GOOD, strain=np.full((6, 2), 7.0)), Refusal.OUT_OF_RANGE),
        ("strain", replaced(GOOD, strain=np.zeros((5, 2))), Refusal.SHAPE),
        ("strain", replaced(GOOD, strain_time=NOW + 1e-3), Refusal.FUTURE),
        ("heading", replaced(GOOD, heading=NAN), Refusal.NOT_FINITE),
        ("heading", replaced(GOOD, heading=1e9), Refusal.OUT_OF_RANGE),
        ("heading", replaced(GOOD, heading=np.zeros(2)), Refusal.SHAPE),
        ("heading", replaced(GOOD, heading_time=NOW + 100.0), Refusal.FUTURE),
    ],
)
def test_each_reason(channel: str, bad: Measurement, why: Refusal) -> None:
    gate = Gate(WORM)
    seen = gate(NOW, bad)
    assert getattr(seen, channel) is None
    assert gate.refused == {(channel, why): 1}
    assert gate.first == {(channel, why): NOW}
    for other in {"strain", "com", "heading"} - {channel}:
        assert getattr(seen, other) is getattr(GOOD, other)


def test_what_is_right_in_part_is_used_in_part() -> None:
    gate = Gate(WORM)
    seen = gate(NOW, changed("com", 2, NAN))
    assert seen.com is not None
    assert_array_equal(seen.com, [1.0, 0.2, NAN])
    seen = gate(NOW + 0.1, replaced(changed("strain", (2, 0), INF), strain_time=5.1))
    assert seen.strain is not None
    assert np.isnan(seen.strain[2, 0])
    assert np.isfinite(seen.strain).sum() == 11
    few = np.full((6, 2), NAN)
    few[:3] = -0.1
    assert gate(NOW + 0.2, replaced(GOOD, strain=few, strain_time=5.2)).strain is None, (
        "three unknowns in three segments"
    )
    assert gate.refused == {
        ("com", Refusal.NOT_FINITE): 1,
        ("strain", Refusal.NOT_FINITE): 2,
        ("com", Refusal.AGAIN): 2,
        ("heading", Refusal.AGAIN): 2,
    }


def test_samples_that_come_again_or_strains_that_come_late_are_refused() -> None:
    gate = Gate(WORM)
    gate(NOW, GOOD)
    assert gate(NOW, GOOD).com is None
    assert gate.refused == {(name, Refusal.AGAIN): 1 for name in ("strain", "com", "heading")}
    gate.reset()
    gate(NOW, GOOD)
    late = gate(NOW, replaced(GOOD, strain_time=4.8, com_time=4.7, heading_time=4.6))
    assert (late.strain is None, late.com is None, late.heading is None) == (True, False, False)
    assert gate.refused == {("strain", Refusal.OUT_OF_ORDER): 1}


def test_integers_and_lists_are_numbers_too() -> None:
    seen = Gate(WORM)(NOW, replaced(GOOD, com=[1, 2, 0], com_time=4, heading=1))
    assert_array_equal(seen.com, [1.0, 2.0, 0.0])
    assert seen.heading == 1.0


def test_long_runs_are_remembered_only_as_far_as_it_matters() -> None:
    gate = Gate(WORM)
    for k in range(3 * 1000):
        gate(0.01 * k, replaced(GOOD, strain_time=0.01 * k, com_time=0.01 * k, heading_time=0.01 * k))
    assert gate.refused.total() == 0
    assert max(len(instants) for instants in gate._instants.values()) <= 1000


def test_every_channel_of_an_observation_passes_as_it_is() -> None:
    class Looking:
        def reset(self) -> None:
            pass

        def step(self, t: float, observation: Observation) -> Command:
            self.seen = observation
            return Command(np.zeros((6, 2)))

    looking = Looking()
    simulate(WORM, Plane(), actuation=looking, duration=0.1)
    seen = looking.seen
    gate = Gate(WORM)
    exact = gate(seen.time, seen)
    assert gate.refused.total() == 0
    assert list(exact) == [name for name, each in QUANTITIES.items() if each.exists(WORM)]
    assert_array_equal(exact.strain, seen.chamber_strain)
    assert_array_equal(exact.com, seen.com)
    assert exact.heading == seen.heading
    assert all(sample.time == seen.time and sample.value is not None for sample in exact.values())


def test_a_mapping_is_no_measurement() -> None:
    with pytest.raises(TypeError, match=r"measurement: got dict, must be a .*Measurement; let sensors make it"):
        Gate(WORM)(NOW, {})  # type: ignore[arg-type]


def test_what_never_changes_while_the_worm_is_to_move_is_frozen() -> None:
    """A worm that crawls along an axis has a coordinate that stays; a chamber may rest for most of a wave."""

    def refused(moving: bool, com, strain, seconds: float) -> dict[str, float]:
        gate = Gate(WORM)
        for t in np.arange(0.0, seconds, 0.05):
            sample = Measurement(t, com=(np.array(com(t)), t), strain=(strain(t), t))
            gate(t, sample, moving=moving)
        return {name: t for (name, why), t in gate.first.items() if why is Refusal.FROZEN}

    def one_still(t: float) -> np.ndarray:
        strain = np.full((6, 2), -0.1 + 0.01 * t)
        strain[2, 1] = -0.07
        return strain

    for seconds, expected in ((0.15, {}), (2.0, {"com": 0.15}), (3.0, {"com": 0.15, "strain": 2.55})):
        assert refused(True, lambda t: (1.0, 0.0, 0.1), one_still, seconds) == pytest.approx(expected)
    assert not refused(True, lambda t: (t, 0.0, 0.1), lambda t: np.full((6, 2), 0.01 * t), 3.0)
    assert not refused(False, lambda t: (1.0, 0.0, 0.1), one_still, 3.0)


def test_of_strains_only_those_that_are_frozen_are_refused() -> None:
    gate, last = Gate(WORM), None
    for t in np.arange(0.0, 3.0, 0.05):
        strain = np.full((6, 2), -0.1 + 0.01 * t)
        strain[2, 1] = -0.07
        last = gate(t, Measurement(t, strain=(strain, t)), moving=True)
    assert last is not None
    assert np.argwhere(np.isnan(last.strain)).tolist() == [[2, 1]]
