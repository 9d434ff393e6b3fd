"""What references ask for ahead of a worm: speeds that it can reach, ends, corridors, and ways around obstacles."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.planning.terms import Arrival, Offset
from control.tracking.obstacles import Disc
from control.tracking.paths import Circle, Line, WayPoints, offset
from control.tracking.preview import APPROACH, Ability, Preview, bounds, detour, look_ahead, speed_at
from control.tracking.references import Constant, Reference

SLOW_IN_CURVES = Ability(lambda curvature: 0.1 / (1.0 + np.abs(curvature)), 1.0)
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
    assert_allclose(speed_at(reference, np.zeros(5), along), [0.08, 0.1 / APPROACH, 0.01 / APPROACH, 0.0, 0.0])
    seen = ahead(reference, Ability(lambda k: np.full(k.shape, np.inf), 1.0), (2.95, 0.0), 40)
    assert (np.diff(seen.point[:, 0]) >= 0.0).all()
    assert 2.99 < seen.point[-1, 0] <= 3.0


@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize(("aside", "radius"), [(0.03, 0.15), (0.0, 0.3), (0.25, 0.4), (0.1, 2.0)])
def test_the_way_around_an_obstacle_stays_outside_and_is_gently_bent(aside, radius, towards) -> None:
    disc = Disc(1.5, towards * aside, radius)
    reference = Reference(Constant(0.08), path=LINE, obstacles=(disc,))
    s = np.linspace(-6.0, 9.0, 3001)
    e, slope = detour(reference, s, 1.0)
    assert np.hypot(s - disc.x, e - disc.y).min() == pytest.approx(radius, rel=1e-6)
    assert_allclose(np.gradient(e, s)[1:-1], slope[1:-1], atol=2e-3)
    bend = np.abs(np.gradient(slope, s))[np.abs(e) > 1e-6]
    assert bend.max() == pytest.approx(1.0 / max(radius, 1.0), rel=0.01)
    left, right = bounds(reference, s)
    assert (e <= left + 1e-9).all()
    assert (-e <= right + 1e-9).all()
    assert (e > 0.0).any() == reference.passings[0].on_left


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_an_obstacle_leaves_a_way_within_the_corridor(towards) -> None:
    disc = Disc(1.5, towards * 0.05, 0.1)  # 0.05 m on the shorter way
    wide = Reference(Constant(0.1), path=LINE, corridor=0.051, obstacles=(disc,))
    assert wide.passings[0].on_left is (towards < 0.0)
    with pytest.raises(ValueError, match=r"obstacles\[0\]: got one that leads 0.05 m off the path"):
        Reference(Constant(0.1), path=LINE, corridor=0.049, obstacles=(disc,))


@pytest.mark.parametrize("ahead", [0.0, 0.2])
def test_obstacles_that_leave_no_way_between_them_are_passed_on_one_side(ahead: float) -> None:
    discs = (Disc(1.5, 0.1, 0.15), Disc(1.5 + ahead, -0.12, 0.15))
    reference = Reference(Constant(0.1), path=LINE, corridor=1.0, obstacles=discs)
    assert [passing.on_left for passing in reference.passings] == [True, True], "0.25 m there, 0.27 m to the right"
    s = np.linspace(0.0, 3.0, 301)
    left, right = bounds(reference, s)
    assert (left > -right).all()
    e = detour(reference, s, 1.0)[0]
    assert (reference.trespass(np.column_stack([s, e]), e) < 1e-9).all()
    apart = Reference(Constant(0.1), path=LINE, obstacles=(discs[0], Disc(1.5, -0.22, 0.15)))
    assert [passing.on_left for passing in apart.passings] == [False, True], "there is a way between them"
    with pytest.raises(ValueError, match=r"obstacles\[0\]: got one that leads 0.25 m off the path"):
        Reference(Constant(0.1), path=LINE, corridor=0.24, obstacles=discs)


def test_where_walls_keep_the_worm_to_its_path_a_miss_of_it_counts_less() -> None:
    seen = [ahead(Reference(Constant(0.1), path=LINE, walled=walled), SLOW_IN_CURVES) for walled in (False, True)]
    for term in (Offset(), Arrival()):
        free, walled = (np.max(term.weight(each)) for each in seen)
        assert walled == pytest.approx(0.1 * free)
        assert free > 0.0


def test_how_far_a_place_is_where_it_must_not_be() -> None:
    reference = Reference(Constant(0.1), path=LINE, corridor=0.5, obstacles=(Disc(1.0, 0.0, 0.2),))
    places = np.array([[1.1, 0.0], [2.0, 0.6], [0.0, 0.1]])
    assert_allclose(reference.trespass(places, places[:, 1]), [0.1, 0.1, -0.4])
    assert Reference(Constant(0.1), path=LINE).trespass(places, places[:, 1]).max() == -np.inf


def test_an_obstacle_on_a_closed_path_is_passed_in_every_lap() -> None:
    path = Circle(2.0)
    disc = Disc(*path.point(0.1).tolist(), 0.2)
    reference = Reference(Constant(0.08), path=path, obstacles=(disc,))
    s = np.linspace(-2.0, 2.0, 401)
    first, later = detour(reference, s, 1.0), detour(reference, s + 3.0 * path.length, 1.0)
    assert np.abs(first[0]).max() >= 0.2
    assert_allclose(later, first, atol=1e-12)
    assert_allclose(bounds(reference, s - path.length), bounds(reference, s), atol=1e-7)


@pytest.mark.parametrize(("azimuth", "follows"), [(1.2, True), (-1.2, True), (1.4, False), (np.pi, False), (5.1, True)])
def test_a_path_is_followed_once_the_worm_faces_about_its_way(azimuth: float, follows: bool) -> None:
    seen = look_ahead(Reference(Constant(0.08), path=LINE), 0.0, 0.4, 8, np.zeros(2), azimuth, None)
    assert seen.follows == follows
    assert seen.heads
    assert np.abs(seen.heading - azimuth).max() <= np.pi + 1e-9


def test_what_is_followed_is_the_way_around_and_bounds_are_about_it() -> None:
    disc = Disc(0.3, 0.0, 0.2)
    reference = Reference(Constant(0.1), path=LINE, corridor=0.5, obstacles=(disc,))
    seen = ahead(reference, Ability(lambda k: np.full(k.shape, np.inf), 1.0))
    s = 0.04 * np.arange(1, 17)
    assert_allclose(seen.point[:, 1], detour(reference, s, 1.0)[0])
    assert_allclose(np.tan(seen.heading), detour(reference, s, 1.0)[1])
    assert_allclose(seen.point[:, 1] - seen.right, np.full(16, -0.5))
    inside = np.abs(s - disc.x) < disc.radius
    assert_allclose((seen.point[:, 1] + seen.left)[~inside], 0.5)
    assert (seen.point[:, 1] + seen.left)[inside].max() < 0.0
    assert_array_equal(offset(LINE, seen.point, s), seen.point[:, 1])


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
