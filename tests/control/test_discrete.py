"""Discrete gaits {n2, n3, n1 / nP}: which there are, how their patterns move, and where they take a worm."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import Discrete
from worm3d import Plane, Worm, simulate


def discrete(left: int, right: int, contracted: int, shift: int = 1, **others: object) -> Discrete:
    return Discrete(left_bends=left, right_bends=right, contracted=contracted, shift=shift, **others)


def exists(gait: Discrete, segments: int) -> bool:
    try:
        gait.pattern(segments)
    except ValueError:
        return False
    return True


def test_five_segments_have_the_twenty_five_gaits_of_the_paper() -> None:
    found = [discrete(*counts) for counts in product(range(6), range(6), range(6), range(1, 6))]
    bends = [(gait.left_bends, gait.right_bends) for gait in found if exists(gait, 5)]
    circular = sum(left != right for left, right in bends)
    assert (bends.count((0, 0)), len(bends) - bends.count((0, 0)) - circular, circular) == (4, 3, 18)


def test_patterns_that_are_known_of_the_paper() -> None:
    assert discrete(0, 0, 2).pattern(5).tolist() == [0, 0, 0, 1, 1]
    assert discrete(1, 0, 1).pattern(5).tolist() == [2, 0, 0, 0, 1]
    assert discrete(1, 2, 0).pattern(6).tolist() == [2, 3, 3, 0, 0, 0]
    assert discrete(1, 2, 0, first="right").pattern(6).tolist() == [3, 3, 2, 0, 0, 0]


def test_a_segment_contracts_on_both_sides_then_lets_one_go_then_the_other() -> None:
    gait = discrete(1, 0, 1, period=5.0, bend=0.8, relaxed=-0.2)
    sides = gait.activations(np.arange(6.0), 5)
    assert_allclose(sides[:, 2, 0], [-0.2, -0.2, 1.0, 0.8, -0.2, -0.2], atol=1e-12)
    assert_allclose(sides[:, 2, 1], [-0.2, -0.2, 1.0, -0.2, -0.2, -0.2], atol=1e-12)
    assert_allclose(sides[5], sides[0], atol=1e-12)


@pytest.mark.parametrize("counts", [(0, 0, 2, 2), (2, 1, 0, 1), (1, 0, 2, 2), (2, 2, 0, 1)])
def test_the_pattern_moves_by_its_shift_and_is_back_after_a_period(counts: tuple[int, ...]) -> None:
    segments, gait = 8, discrete(*counts, period=4.0, moving=0.6)
    step = gait.period / (segments // np.gcd(segments, gait.shift))
    times = np.linspace(0.0, 4.0, 57)
    now = gait.activations(times, segments)
    assert_allclose(gait.activations(times + step, segments), np.roll(now, -gait.shift, axis=1), atol=1e-9)
    assert_allclose(gait.activations(times + gait.period, segments), now, atol=1e-9)
    direct = replace(gait, direction="direct").activations(times + step, segments)
    back = replace(gait, direction="direct").activations(times, segments)
    assert_allclose(direct, np.roll(back, gait.shift, axis=1), atol=1e-9)
    # Towards the head the same steps are made as towards the tail with time running backwards.
    assert_allclose(replace(gait, moving=1.0, direction="direct").activations(times, segments),
                    replace(gait, moving=1.0).activations(-times, segments), atol=1e-7)  # fmt: skip


def test_a_bent_segment_turns_its_joint() -> None:
    gait = discrete(1, 1, 1, hinge=0.2)
    command = gait.bind(Worm())(0.0)
    assert gait.pattern(6).tolist() == [2, 3, 0, 0, 0, 1]
    assert_allclose(command.hinge, [-0.2, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    assert_allclose(command.contraction[:, 0], [0.2, 0, 0, 0, 0, 0.2], atol=1e-9)
    assert_allclose(command.contraction[:, 1], [0, 0.2, 0, 0, 0, 0.2], atol=1e-9)


def test_what_there_is_no_room_for_is_refused() -> None:
    for counts in ((2, 2, 1, 1), (0, 0, 1, 2), (0, 0, 3, 3), (0, 0, 0, 1)):
        with pytest.raises(ValueError, match=r"shift: got .*, must be at most the number of contracted and bent"):
            discrete(*counts).activations(np.zeros(1), 6)


def moved(gait: Discrete, periods: int = 8, skipped: int = 3) -> np.ndarray:
    """Return the way along and across the heading [m] and the turn to the left [deg], a period on average."""
    run = simulate(Worm(), Plane(), actuation=gait, duration=periods * gait.period, record_every=10)
    each = round(gait.period / 0.1)
    heading, way = run.heading[::each], np.diff(run.com[::each, :2], axis=0)
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    rows = np.column_stack(
        [
            way[:, 0] * cos + way[:, 1] * sin,
            way[:, 1] * cos - way[:, 0] * sin,
            np.rad2deg(np.diff(heading)),
        ]
    )
    return rows[skipped:].mean(axis=0)


@pytest.mark.parametrize("counts", [(0, 0, 1, 1), (0, 0, 2, 2), (0, 0, 3, 1)])
def test_rectilinear_gaits_go_straight(counts: tuple[int, ...]) -> None:
    along, across, turn = moved(discrete(*counts, amplitude=0.3), periods=4, skipped=1)
    assert along > 0.08
    assert_allclose([across, turn], 0.0, atol=1e-6)


@pytest.mark.parametrize("hinge", [0.08, 0.105, 0.13])
def test_sidewinding_goes_aside_and_keeps_its_heading(hinge: float) -> None:
    along, across, turn = moved(discrete(2, 2, 0, amplitude=0.3, bend=0.3, hinge=hinge))
    assert abs(turn) < 1.0
    assert -0.8 < across / along < -0.4


@pytest.mark.parametrize("counts", [(2, 0, 1), (2, 1, 0), (3, 0, 1)])
def test_circular_gaits_turn_to_the_side_of_their_bends_and_mirror(counts: tuple[int, int, int]) -> None:
    left, right, contracted = counts
    gait = discrete(left, right, contracted, amplitude=0.3, hinge=0.105)
    mirrored = discrete(right, left, contracted, first="right", amplitude=0.3, hinge=0.105)
    one, other = moved(gait), moved(mirrored)
    assert one[2] > 30.0
    assert_allclose(other, one * [1.0, -1.0, -1.0], rtol=0, atol=1e-7)
