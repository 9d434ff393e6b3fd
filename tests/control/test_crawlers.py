"""Two anchors in turn: the sequence of commands, and climbing by it."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits.patterns import TwoAnchor
from worm3d import Centreline, Friction, Pipe, Result, State, Status, Straight, Worm

STIFF = Worm(k_spring=100.0)
HOLDS = Friction(0.3, 0.8, 0.8)


def climbing(tilt: float = np.pi / 2, radius: float = 0.092, gait: TwoAnchor | None = None, waves: int = 4) -> Result:
    gait = gait or TwoAnchor(period=3.0)
    pipe = Pipe(Centreline.of([Straight(4.0)], tilt=tilt), radius)
    start = State.straight(STIFF, pipe, contraction=gait.bind(STIFF)(0.0).contraction)
    return worm3d.simulate(STIFF, pipe, HOLDS, actuation=gait, duration=waves * gait.period, state=start)


def test_the_six_parts_of_the_period() -> None:
    """Rear, body, front at the end of each part: 1 is contracted."""
    groups = TwoAnchor(period=6.0, extension=-0.5).activations(np.arange(7.0), 6)[:, [0, 2, 5]]
    front_goes, front_holds = [1.0, 1.0, -0.5], [1.0, -0.5, 1.0]
    all_hold, rear_goes = [1.0, 1.0, 1.0], [-0.5, -0.5, 1.0]
    expected = [all_hold, front_goes, [1.0, -0.5, -0.5], front_holds, rear_goes, [-0.5, 1.0, 1.0], all_hold]
    assert_allclose(groups, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("anchors", [1, 2])
def test_an_anchor_always_holds_and_there_are_no_jumps(anchors: int) -> None:
    gait = TwoAnchor(period=1.0, anchors=anchors)
    activations = gait.activations(np.linspace(0.0, 2.0, 20_001), 6)
    assert_allclose(np.maximum(activations[:, 0], activations[:, -1]).min(), 1.0, rtol=0, atol=1e-12)
    assert_array_equal(activations[:, :anchors], activations[:, :1].repeat(anchors, axis=1))
    assert np.abs(np.diff(activations, axis=0)).max() < 6.0 * 1.5 * np.pi / 2.0 * 1e-4 * 1.001


def test_the_other_direction_is_the_mirror_image() -> None:
    times = np.linspace(0.0, 5.0, 101)
    ahead, back = (TwoAnchor(direction=way).activations(times, 7) for way in ("retrograde", "direct"))  # type: ignore[arg-type]
    assert_array_equal(ahead, back[:, ::-1])


@pytest.mark.parametrize("extension", [-0.5, 0.0])
def test_it_climbs_a_vertical_pipe_without_dropping(extension: float) -> None:
    """At least 0.06 body lengths a wave; the anchor that holds slides back by less than 2 mm a wave.

    The body's stroke is a bound: four segments between the length at which their apexes reach the wall and the extended
    length, l0 (1 + 0.2 |extension|).
    """
    run = climbing(gait=TwoAnchor(period=3.0, extension=extension))
    assert run.status is Status.DONE
    height = run.com[::300, 2]
    reached = np.sqrt(4.0 * (STIFF.link_length[0] ** 2 - (0.092 - 0.03) ** 2))
    stroke = 4.0 * (STIFF.l0 * (1.0 - 0.2 * extension) - reached)
    assert np.all(np.diff(height) > 0.06 * STIFF.length)
    assert np.all(np.diff(height) < stroke * 1.01)
    assert np.all(np.diff(height) > stroke * 0.95)
    part = np.floor(np.mod(run.time + 1e-9, 3.0) / 0.5)
    for segment, holds in ((0, part < 3), (5, part >= 3)):  # the rear holds in the first half, the front in the second
        middle = run.joints[:, segment : segment + 2, 2].mean(axis=1)
        back = np.minimum(np.diff(middle), 0.0)[holds[1:] & holds[:-1]]
        assert -back.sum() < 4 * 2e-3


def test_it_goes_the_other_way() -> None:
    assert climbing(gait=TwoAnchor(period=3.0, direction="direct"), tilt=0.0, waves=2).distance < -0.1


def test_without_a_wall_to_press_it_falls() -> None:
    assert climbing(radius=0.11, waves=1).distance < -1.0


MISTAKES: list[tuple[Callable[[], object], str]] = [
    (lambda: TwoAnchor(extension=0.1), r"extension: got 0.1, must be a number in \[-1, 0\]"),
    (lambda: TwoAnchor(period=0.0), "period: got 0.0 s, must be finite and above 0"),
    (lambda: TwoAnchor(anchors=0), "anchors: got 0, must be a whole number of at least 1"),
    (lambda: TwoAnchor(direction="standing"), "direction: got 'standing', must be 'direct' or 'retrograde'"),  # type: ignore[arg-type]
    (lambda: TwoAnchor(anchors=3).activation(0.0, 6), "anchors: got 3, must leave a segment of the worm's 6"),
]


@pytest.mark.parametrize(("make", "sentence"), MISTAKES)
def test_what_is_no_such_gait_is_refused(make: Callable[[], object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()
