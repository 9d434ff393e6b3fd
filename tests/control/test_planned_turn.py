"""Waves planned without slip: the geometry of (N1) to (N3), how turns follow one another, and slip on the plant."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import GAITS, ExtensionWave, Gait, PlannedTurn, Steered
from worm3d import Plane, Status, Worm, simulate

WORM = Worm()
STEP = 5.0 / 6.0
GEOMETRIES = {
    "two of six": (PlannedTurn(turn=np.deg2rad(20.0)), WORM),
    "one of six": (PlannedTurn(turn=np.deg2rad(-15.0), swinging=1), WORM),
    "three of nine": (PlannedTurn(turn=np.deg2rad(25.0), swinging=3), Worm(segments=9)),
}


def poses(gait: PlannedTurn, worm: Worm, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and heading of each segment, (K, N, 3), from commanded lengths and hinges, and whether it stands.

    A segment that stands at two successive times keeps its place between them; the first one begins at the origin.
    """
    n, given = worm.segments, gait.bind(worm).commands(times)
    lengths = (1.0 - given.contraction[..., 0]) / n
    headings = np.pad(np.cumsum(given.hinge, axis=1), ((0, 0), (1, 0)))
    stands = lengths < lengths.min() + 1e-9
    found = np.empty((len(times), n, 3))
    for k, (length, heading) in enumerate(zip(lengths, headings, strict=True)):
        found[k, :, 2] = heading
        steps = length[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        found[k, :, :2] = np.cumsum(steps, axis=0) - steps / 2.0
        if k > 0:
            anchor = np.flatnonzero(stands[k] & stands[k - 1])[0]
            angle = found[k - 1, anchor, 2] - found[k, anchor, 2]
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            found[k, :, :2] = (found[k, :, :2] - found[k, anchor, :2]) @ turn.T + found[k - 1, anchor, :2]
            found[k, :, 2] += angle
    return found, stands


@pytest.mark.parametrize("name", GEOMETRIES)
def test_standing_segments_keep_their_places_and_each_wave_turns_the_body(name: str) -> None:
    gait, worm = GEOMETRIES[name]
    n, step = worm.segments, gait.period / worm.segments
    times = np.arange(0, 2 * n * 16 + 1) * step / 16.0  # two waves
    found, stands = poses(gait, worm, times)
    both = (stands[1:] & stands[:-1])[..., None]
    moved = np.where(both, np.diff(found, axis=0), 0.0)
    assert np.abs(moved).max() < 1e-8  # at instants that were planned
    # The head has done two waves when it stands again, before the third.
    assert found[-1, -1, 2] - found[0, -1, 2] == pytest.approx(2.0 * gait.turn, abs=1e-8)


def test_standing_segments_hardly_move_between_planned_instants() -> None:
    gait, worm = GEOMETRIES["two of six"]
    found, stands = poses(gait, worm, np.linspace(0.0, 10.0, 1483))
    for segment, stood in zip(found.transpose(1, 0, 2), stands.T, strict=True):
        for rows in np.split(np.arange(len(stood)), np.flatnonzero(np.diff(stood)) + 1):
            if stood[rows[0]]:
                assert np.ptp(segment[rows, :2], axis=0).max() < 3e-4 / worm.segments


def test_a_wave_of_no_turn_is_an_extension_wave() -> None:
    straight = PlannedTurn(turn=0.0)
    same = ExtensionWave(amplitude=0.3, extension=-1 / 3, period=5.0, moving=3 / 6, held=1 / 3)
    times = 10.0 + np.arange(96) * STEP / 16.0
    assert_allclose(straight.activations(times, 6), same.activations(times, 6), atol=1e-12)
    assert_allclose(straight.bind(WORM).commands(times).contraction, same.bind(WORM).commands(times).contraction)
    assert_array_equal(straight.bind(WORM).commands(times).hinge, 0.0)


def test_lengths_stay_within_reach_and_one_is_used_up() -> None:
    given = PlannedTurn(amplitude=0.45, turn=0.35).bind(WORM).commands(np.linspace(0.0, 10.0, 961))
    assert given.contraction.max() == pytest.approx(0.45)  # the stroke
    assert given.contraction.min() == pytest.approx(-0.1, abs=1e-6)
    assert np.abs(given.hinge).max() < 0.6


def test_a_turn_to_the_right_is_the_mirror_image() -> None:
    left, right = (PlannedTurn(turn=side * 0.3).bind(WORM).commands(np.linspace(0.0, 10.0, 211)) for side in (1, -1))
    assert_allclose(right.contraction, left.contraction, atol=1e-12)
    assert_allclose(right.hinge, -left.hinge, atol=1e-12)


def test_it_turns_by_the_total_and_goes_straight_then() -> None:
    gait = PlannedTurn(turn=-0.3, total=0.75)  # waves of 0.3, 0.3 and 0.15
    times = np.arange(0, 5 * 6 * 16 + 1) * STEP / 16.0
    found, _ = poses(gait, WORM, times)
    turned = found[:, -1, 2] - found[0, -1, 2]
    for waves, total in ((1, 0.3), (2, 0.6), (3, 0.75), (5, 0.75)):
        assert turned[waves * 96] == pytest.approx(-total, abs=1e-8)
    assert_array_equal(gait.bind(WORM).commands(times[400:]).hinge, 0.0)


def figures(gait: Gait) -> dict[str, Any]:
    run = simulate(WORM, Plane(), actuation=gait, duration=35.0, record_every=5)
    assert run.status is Status.DONE, run.stop.sentence
    return run.summary()


def test_planned_waves_slip_half_as_much_as_periodic_ones_that_turn_as_fast() -> None:
    planned, periodic = (
        figures(PlannedTurn(turn=np.deg2rad(20.0))),
        figures(Steered(amplitude=0.3, period=5.0, hinge=0.1)),
    )
    assert planned["degrees_per_wave_deg"] > periodic["degrees_per_wave_deg"] > 12.0
    assert planned["slip_per_metre"] < 0.6 * periodic["slip_per_metre"]
    assert planned["stride_bl"] > 0.9 * periodic["stride_bl"]
    assert planned["roll_margin_deg"] > 33.0
    straight = figures(PlannedTurn(turn=0.0))
    assert planned["slip_per_metre"] < 1.2 * straight["slip_per_metre"]


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: PlannedTurn(swinging=5).require_body(6), "swinging: got 5, must be at most 4 in a worm of 6 segments"),
        (
            lambda: PlannedTurn(turn=2.0).require_body(6),
            r"turn: got 2 rad \(114.6 degrees\), must be less: 2 swinging segments of 0\.1",
        ),
        (lambda: PlannedTurn(amplitude=0.0), r"amplitude: got 0\.0, must be finite and above 0"),
        (lambda: PlannedTurn(total=0.0), r"total: got 0\.0 rad, must be above 0"),
    ],
)
def test_bad_turns_are_refused(build, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build()
    assert GAITS["planned_turn"] is PlannedTurn
