"""What references ask for ahead of a worm: speeds that it can reach, ends, corridors, and ways around obstacles."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.planning.terms import Arrival, Offset
from control.tracking.detour import Body
from control.tracking.guide import led
from control.tracking.obstacles import Disc
from control.tracking.paths import Circle, Line, WayPoints
from control.tracking.preview import ANY, APPROACH, Ability, Preview, bounds, look_ahead, speed_at
from control.tracking.references import Constant, Reference

SLOW_IN_CURVES = Ability(lambda curvature: 0.1 / (1.0 + np.abs(curvature)), 1.0, 1.25)
LINE = Line((0.0, 0.0), 0.0, 3.0)


def ahead(reference: Reference, able: Ability, place=(0.0, 0.0), steps: int = 16) -> Preview:
    return look_ahead(reference, 0.0, 0.4, steps, np.array(place), 0.0, None, able)


def test_no_faster_than_the_worm_can_turn() -> None:
    """A circle of 0.5 m is followed at 0.1/(1 + 2) m/s, and the point goes on by as much."""
    seen = ahead(Reference(Constant(0.2), path=Circle(0.5)), SLOW_IN_CURVES)
    assert_allclose(seen.speed, 0.1 / 3.0)
    assert_allclose(seen.heading, 0.1 / 3.0 * 0.4 / 0.5 * np.arange(1, 17))
    assert_allclose(seen.way, 0.1 / 3.0 * 0.4)
    backwards = Reference(Constant(-0.2), path=Circle(0.5))
    assert_allclose(ahead(backwards, SLOW_IN_CURVES).speed, -0.1 / 3.0)


def test_a_corner_is_averaged_over_the_way_that_a_worm_turns_in() -> None:
    path = WayPoints([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], 0.01)
    middle = path.length / 2.0
    reference = Reference(Constant(0.2), path=path)
    found = speed_at(reference, np.zeros(3), np.array([0.5, middle, middle + 0.5]), SLOW_IN_CURVES)
    assert_allclose(found, [0.1, 0.1 / (1.0 + math.pi / 2.0 / 0.3), 0.1], rtol=1e-9)


def test_a_path_ends_in_rest() -> None:
    reference = Reference(Constant(0.08), path=LINE, ends=True)
    along = np.array([0.0, 2.9, 2.99, 3.0, 3.5])
    for wave in (1.25, 4.0):
        able, T = ANY._replace(wave=wave), APPROACH * wave
        assert_allclose(speed_at(reference, np.zeros(5), along, able), [0.08, 0.1 / T, 0.01 / T, 0.0, 0.0])
    seen = ahead(reference, ANY, (2.95, 0.0), 40)
    late = ahead(reference, ANY._replace(wave=4.0), (2.95, 0.0), 40)
    assert_allclose(3.0 - late.point[1, 0], 0.05 * (1.0 - 0.4 / (APPROACH * 4.0)) ** 2)
    assert (np.diff(seen.point[:, 0]) >= 0.0).all()
    assert 2.99 < seen.point[-1, 0] <= 3.0


def test_where_walls_keep_the_worm_to_its_path_a_miss_of_it_counts_less() -> None:
    seen = [ahead(Reference(Constant(0.1), path=LINE, walled=walled), SLOW_IN_CURVES) for walled in (False, True)]
    for term in (Offset(), Arrival()):
        free, walled = (np.max(term.weight(each)) for each in seen)
        assert walled == pytest.approx(0.1 * free)
        assert free > 0.0


def test_how_far_a_place_is_where_it_must_not_be() -> None:
    reference = Reference(Constant(0.1), path=LINE, corridor=0.5, obstacles=(Disc(1.0, 0.0, 0.2),))
    places = np.array([[1.1, 0.0], [2.0, 0.6], [0.0, 0.1]])
    assert_allclose(reference.trespass(places, np.abs(places[:, 1]) - 0.5), [0.1, 0.1, -0.4])
    assert Reference(Constant(0.1), path=LINE).trespass(places, np.full(3, -np.inf)).max() == -np.inf


@pytest.mark.parametrize(("azimuth", "follows"), [(1.2, True), (-1.2, True), (1.4, False), (np.pi, False), (5.1, True)])
def test_a_path_is_followed_once_the_worm_faces_about_its_way(azimuth: float, follows: bool) -> None:
    seen = look_ahead(Reference(Constant(0.08), path=LINE), 0.0, 0.4, 8, np.zeros(2), azimuth, None)
    assert seen.follows == follows
    assert seen.heads
    assert np.abs(seen.heading - azimuth).max() <= np.pi + 1e-9


def test_what_is_followed_is_the_way_around_and_bounds_are_about_it() -> None:
    """The corridor bounds the middle, the disc both ends of the body, which lie on the tangent of the way."""
    disc, body = Disc(1.2, 0.05, 0.1), Body(1.0, 0.1)
    bare = Reference(Constant(0.1), path=LINE, corridor=0.5, obstacles=(disc,))
    reference = led(bare, body)
    seen = ahead(reference, ANY, (0.5, 0.0))
    assert_allclose(seen.point, reference.path.point(seen.progress + 0.04 * np.arange(1, 17)), atol=1e-6)
    assert_allclose(seen.heading, reference.path.heading(seen.progress + 0.04 * np.arange(1, 17)), atol=1e-6)
    assert_allclose(seen.point[:, 1] - seen.right, -0.5, atol=2e-3)
    assert_allclose(seen.point[:, 1] + seen.left, 0.5, atol=2e-3)
    assert np.isinf(seen.room_right).all()
    beside = np.isfinite(seen.room_left)
    assert beside.any()
    left = np.column_stack([-np.sin(seen.heading), np.cos(seen.heading)])
    touching = body.clearance([disc], seen.point + seen.room_left[:, None] * left, seen.heading)
    assert_allclose(touching[beside], 0.0, atol=0.012)
    free = ahead(bare, ANY)
    assert_array_equal([free.left, free.right, free.room_left, free.room_right], bounds(bare, np.zeros(16)))
    assert_array_equal(free.right, 0.5)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"ends": True, "path": Circle(1.0)}, "ends: got true for a path without end"),
        ({"ends": True, "path": Line()}, "ends: got true for a path without end"),
        ({"corridor": 0.2}, "corridor: got one without a path"),
        ({"corridor": 0.0, "path": LINE}, "corridor: got 0.0 m, must be above 0"),
        ({"obstacles": [(1.0, 0.0, 0.1)], "path": LINE}, r"obstacles\[0\]: got tuple, must be an obstacle"),
    ],
)
def test_bad_references(given, sentence) -> None:
    with pytest.raises(ValueError, match=sentence):
        Reference(Constant(0.1), **given)
