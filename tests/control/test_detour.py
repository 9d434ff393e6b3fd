"""Ways around obstacles: clear of them with the whole body, of least cost, on the cheaper side, found anew."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.tracking import search as searching
from control.tracking.detour import Body, Detour
from control.tracking.guide import Guide, led, led_from, led_on
from control.tracking.obstacles import Disc, Obstacle, Wall
from control.tracking.paths import Circle, Line, Path, SCurve, WayPoints, offset
from control.tracking.references import Constant, Reference
from control.tracking.search import SHARE_KEPT, NoWayError, Search
from worm3d import Worm
from worm3d.values.arrays import FloatArray

BODY = Body(1.0, 0.1)
LINE, CIRCLE = Line(), Circle(1.5)


def asked(*obstacles: Obstacle, path: Path = LINE, **more) -> Reference:
    return Reference(Constant(0.08), path=path, obstacles=obstacles, **more)


def way_of(reference: Reference) -> Detour:
    assert isinstance(reference.path, Detour)
    return reference.path


def sides(way: Detour, discs: Sequence[Disc]) -> list[float]:
    """Return on which side discs are passed, 1 for the left."""
    found = [offset(way, [each.x, each.y], float(way.project([each.x, each.y]))) for each in discs]
    return [-float(np.sign(each)) for each in found]


def outlines(way: Detour) -> FloatArray:
    """Return points of the outlines of rectangular bodies all along a way, (K, 2)."""
    s = np.linspace(0.0, way.length, 300)
    azimuth = way.heading(s)
    along, across = np.stack([np.cos(azimuth), np.sin(azimuth)], -1), np.stack([-np.sin(azimuth), np.cos(azimuth)], -1)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 21), [-BODY.half_width, 0.0, BODY.half_width])
    return (way.point(s)[:, None] + x.ravel()[:, None] * along[:, None] + y.ravel()[:, None] * across[:, None]).reshape(
        -1, 2
    )


@pytest.mark.parametrize("path", [LINE, CIRCLE, SCurve(0.3), Line(length=4.0)])
@pytest.mark.parametrize("seed", range(5))
def test_the_whole_body_keeps_off_and_ways_are_gently_bent(seed: int, path: Path) -> None:
    random, corridor = np.random.default_rng([7, seed]), 0.8
    (x, y), heading = path.point(1.7), float(path.heading(1.7))
    aside, radius, azimuth = random.uniform([-0.3, 0.05, -1.5], [0.3, 0.25, 1.5])
    place = x - aside * np.sin(heading), y + aside * np.cos(heading)
    obstacle = Disc(*place, radius) if seed % 2 else Wall(*place, radius / 3.0, 0.4, azimuth)
    way = way_of(led(asked(obstacle, path=path, corridor=corridor, ends=path.length == 4.0), BODY))
    assert obstacle.distances(outlines(way)).min() > SHARE_KEPT * 0.04 - 1e-3
    s = np.linspace(0.0, way.length, 400)
    assert np.abs(way.curvature(s)).max() < 2.3
    near = None
    for point in way.point(s):
        near = float(path.project(point, near))
        assert abs(float(offset(path, point, near))) < corridor + 0.01
    assert way.closed == path.closed
    assert_allclose(way.point(0.0), path.point(0.0), atol=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sharp_corner_of_the_path_is_no_reason_to_refuse_it(side: float) -> None:
    disc = Disc(2.05, 1.5 * side, 0.1)
    path = WayPoints([(0.0, 0.0), (2.0, 0.0), (2.0, 3.0 * side)], 0.02)
    way = way_of(led(asked(disc, path=path, ends=True), BODY))
    assert disc.distances(outlines(way)).min() > SHARE_KEPT * 0.04 - 1e-3
    assert_allclose(way.point(way.length), (2.0, 3.0 * side), atol=1e-6)


def test_a_body_is_as_wide_as_its_segments_get() -> None:
    """A segment of l0 = 1/6 m, h0 = 0.05 m, shortened by 0.45, is 0.0857 m high, 0.03 m off the middle."""
    assert Body.of(Worm()) == pytest.approx((1.0, 0.03 + np.sqrt(0.05**2 + (1.0 - 0.55**2) / 144.0)))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_cheaper_side_is_chosen(side: float) -> None:
    one = Disc(2.0, -0.03 * side, 0.1)
    assert sides(way_of(led(asked(one), BODY)), [one]) == [side]
    # Beside it stands another one, near enough to leave no way between them: both are passed where one alone is not.
    other = Disc(2.0, 0.25 * side, 0.1)
    assert sides(way_of(led(asked(one, other), BODY)), [one, other]) == [-side, -side]
    # Two that stand far enough apart are passed between, and those after each other on the outer sides of a slalom.
    apart = Disc(2.0, 0.3 * side, 0.1), Disc(2.0, -0.3 * side, 0.1)
    assert sides(way_of(led(asked(*apart), BODY)), apart) == [-side, side]
    slalom = Disc(2.0, 0.05 * side, 0.1), Disc(4.5, -0.05 * side, 0.1)
    assert sides(way_of(led(asked(*slalom), BODY)), slalom) == [-side, side]
    # A corridor takes away the cheaper side of a wall.
    wall = Wall(2.0, -0.15 * side, 0.03, 0.5, np.pi / 2.0)
    free, narrow = (way_of(led(asked(wall, corridor=corridor), BODY)).aside for corridor in (np.inf, 0.29))
    assert max(side * free) > 0.2
    assert abs(max(free, key=abs)) <= 0.3
    assert max(side * narrow) > 0.2


def test_no_other_way_near_a_smooth_one_costs_less() -> None:
    """Changes of it either cost more or bring the body nearer than it is to be."""
    disc = Disc(2.0, 0.05, 0.15)
    search = Search(LINE, asked(), (disc,), BODY, np.zeros(2))
    aside, _ = search._on_grid(0.04)
    assert aside is not None
    smooth = search._smoothed(aside, 0.04)
    assert smooth is not None

    def cost(e: FloatArray) -> float:
        bend = np.diff(np.concatenate([[0.0], e, [0.0]]), 2) / search.step**2
        return float(search.step * (e @ e + searching.BENDS**4 * bend @ bend))

    def room(e: FloatArray) -> float:
        slope = np.gradient(e, search.step)
        places, azimuth = search._bodies(np.arange(len(e)), e, slope)
        spots = places[:, None] + searching.CHORD[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)[:, None]
        return float(disc.distances(spots).min())

    assert room(smooth) == pytest.approx(BODY.half_width + 0.04, abs=1e-4)
    assert cost(0.999 * smooth) < cost(smooth)
    assert room(0.999 * smooth) < room(smooth) - 1e-5
    random = np.random.default_rng(3)
    for size in (1e-3, 1e-2):
        for _ in range(40):
            change = size * np.convolve(random.standard_normal(len(smooth) + 8), np.hanning(11)[1:-1], "valid")
            change[[0, -1]] = 0.0
            assert cost(smooth + change) > cost(smooth) or room(smooth + change) < room(smooth) - 1e-5


def test_the_search_on_the_grid_finds_what_trying_all_ways_finds() -> None:
    """Of all ways of four steps with changes of the slope by up to 2, none costs less than that of (P3)."""
    search = Search(LINE, asked(), (Disc(5.0, 0.0, 0.1),), BODY, np.array([0.01, 0.03]))
    rows, columns = len(search.cells), len(searching.SLOPES)
    value = np.full((rows, columns), np.inf)
    begin = search._row(0.03), searching._column(0.02)
    value[begin] = 0.0
    for _ in range(3):
        value = search._stepped(value, 0)[0] + search.step * search.cells[:, None] ** 2
    best = {}
    for turns in np.stack(np.meshgrid(*[[-2, -1, 0, 1, 2]] * 3), -1).reshape(-1, 3).tolist():
        aside, slope, cost = 0.03, 2, 0.0
        for turn in turns:
            slope += turn
            aside += 0.01 * slope
            cost += 0.1 * (aside**2 + searching.BENDS**4 * turn**2)
        at = search._row(aside), slope + len(searching.SLOPES) // 2
        best[at] = min(best.get(at, np.inf), cost)
    step = search.step
    assert step == pytest.approx(0.1, abs=1e-3)
    found = {at: float(value[at]) for at in best}
    assert found == pytest.approx(best, rel=0.02)


def test_what_leaves_no_way_is_named() -> None:
    wall = Wall(2.0, 0.0, 0.05, 8.0, np.pi / 2.0)
    far = Disc(1.2, 1.5, 0.1)
    for reference, k in (
        (asked(far, wall), 1),
        (asked(Disc(2.0, 0.0, 0.3), far, corridor=0.4), 0),
        (asked(far, Disc(4.3, 0.0, 0.1), path=Line(length=4.0), ends=True), 1),
        (asked(Disc(0.3, 0.0, 0.1), far), 0),
    ):
        with pytest.raises(ValueError, match=rf"obstacles\[{k}\]: got one past which no way leads, must leave one"):
            led(reference, BODY)
    assert way_of(led(asked(replace(wall, sight=0.5)), BODY)).unknown == (replace(wall, sight=0.5),)
    assert led(asked(), BODY).path is LINE


def test_what_lies_behind_stays_where_a_way_is_found_anew() -> None:
    known, hidden = Disc(2.0, 0.05, 0.1), Disc(4.0, 0.05, 0.1, sight=1.0)
    before = led(asked(known, hidden), BODY)
    after = led_on(before, BODY, [hidden], 2.75)
    assert after.obstacles == (known, hidden)
    assert way_of(after).unknown == ()
    s = np.linspace(0.0, 2.6, 100)
    assert_allclose(way_of(after).point(s), way_of(before).point(s), atol=2e-4)
    assert hidden.distances(outlines(way_of(before))).min() < 0.0
    assert hidden.distances(outlines(way_of(after))).min() > 0.02
    with pytest.raises(NoWayError):
        led_on(before, BODY, [replace(hidden, x=3.2)], 2.75)


def test_a_worm_beside_an_obstacle_comes_no_nearer_to_it_and_keeps_off_later_ones_as_usual() -> None:
    passed, later = Disc(2.0, 0.0, 0.15), Disc(5.0, 0.05, 0.1)
    begun = led_from(led(asked(passed, later), BODY), BODY, np.array([2.0, -0.27]), 0.0)
    rest = outlines(way_of(begun))
    assert passed.distances(rest[rest[:, 0] > 1.6]).min() > 0.01
    assert later.distances(rest).min() > 0.03


@pytest.mark.parametrize("s", [-0.003, 0.003])
def test_a_closed_way_is_found_anew_where_it_begins(s: float) -> None:
    hidden = Disc(1.5, 1.4, 0.15, sight=1.0)
    after = way_of(led_on(led(asked(hidden, path=CIRCLE), BODY), BODY, [hidden], s))
    assert hidden.distances(outlines(after)).min() > 0.02


@pytest.mark.parametrize("turned", [0.3, -0.3])
def test_a_way_begins_where_the_worm_is(turned: float) -> None:
    reference = led(asked(Disc(2.5, 0.05, 0.1)), BODY)
    way = way_of(led_from(reference, BODY, np.array([0.52, 0.2]), turned))
    s = float(way.project([0.52, 0.2]))
    assert_allclose(way.point(s), [0.52, 0.2], atol=5e-3)
    assert float(way.heading(s)) == pytest.approx(turned, abs=0.05)
    assert_allclose(way.aside[-5:], 0.0, atol=0.02)


def test_a_closed_way_is_alike_in_every_lap() -> None:
    way = way_of(led(asked(Disc(1.5, 1.4, 0.15), path=CIRCLE), BODY))
    s = np.linspace(0.0, way.length, 50)
    assert_allclose(way.point(s + 3.0 * way.length), way.point(s), atol=1e-9)
    assert_allclose(way.bounds_at(s + 2.0 * way.length), way.bounds_at(s), rtol=1e-9)
    assert_allclose(np.diff(way.heading(np.array([0.0, way.length]))), 2.0 * np.pi)


def test_the_guide_tells_of_an_obstacle_as_its_edge_comes_into_sight() -> None:
    """The head is half a length ahead of the middle."""
    guide = Guide(led(asked(Disc(3.0, 0.02, 0.1, sight=0.6)), BODY), BODY)
    assert not guide.look(np.array([1.79, 0.0]), 0.0, sure=True)
    assert guide.reference.obstacles == ()
    assert guide.look(np.array([1.81, 0.0]), 0.0, sure=True)
    assert len(guide.reference.obstacles) == 1
    assert not guide.look(np.array([1.83, 0.0]), 0.0, sure=True)
    guide.reset()
    assert guide.reference.obstacles == ()
    assert guide.look(np.array([0.3, 0.1]), 0.0, sure=True), "a worm that stands apart has a way of its own"
