"""Paths against closed forms and differences, their projections, and references."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from control.tracking.paths import (
    Circle,
    Line,
    Path,
    PlanView,
    SCurve,
    SplinePath,
    WayPoints,
    lengthening,
    offset,
    track,
)
from control.tracking.preview import speed_at
from control.tracking.references import Constant, Reference, Sine, Steps
from worm3d import Bend, Centreline, Straight

PIPE = Centreline.of([Straight(1.0), Bend(1.2, 1.5, "right"), Straight(0.5), Bend(2.0, 2.0, "left")], heading=0.4)
CORNERS = [(0.0, 0.0), (2.0, 0.0), (3.0, 2.0), (6.0, 2.5)]
PATHS: dict[str, Path] = {
    "line": Line((0.3, -0.2), 0.7),
    "circle": Circle(1.5, (0.1, 0.2), 0.5),
    "circle to the right": Circle(1.5, (0.1, 0.2), 0.5, "right"),
    "s-curve": SCurve(start=(1.0, 2.0), azimuth=0.3),
    "s-curve to the right": SCurve(towards="right"),
    "spline": SplinePath(np.array(CORNERS)),
    "closed spline": SplinePath(np.array([(0, 0), (2, 0.3), (2.5, 2), (0.5, 1.5)]), closed=True),
    "way points": WayPoints(CORNERS, 0.8),
    "pipe": PlanView(PIPE),
    "rising pipe": PlanView(Centreline.of([Straight(0.5), Bend(0.6, 1.5, "up"), Bend(0.9, 1.0, "left")])),
}
every_path = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())


def arc_lengths(path: Path) -> np.ndarray:
    """Inside, and beyond the ends; a little off the places where the curvature jumps."""
    length = min(path.length, 5.0)
    return np.linspace(-0.2, 1.2, 97) * length + 1.234e-3


@every_path
def test_the_parameter_is_the_arc_length_and_the_heading_that_of_the_tangent(path: Path) -> None:
    s, h = arc_lengths(path), 1e-4
    tangent = (path.point(s + h) - path.point(s - h)) / (2 * h)
    azimuth = path.heading(s)
    assert_allclose(tangent, np.column_stack([np.cos(azimuth), np.sin(azimuth)]), atol=3e-8)
    assert np.abs(np.diff(azimuth)).max() < 0.4, "the heading is continuous"


@every_path
def test_the_curvature_is_that_of_the_heading(path: Path) -> None:
    s, h = arc_lengths(path), 1e-5
    assert_allclose(path.curvature(s), (path.heading(s + h) - path.heading(s - h)) / (2 * h), atol=2e-5)


@every_path
def test_a_place_beside_the_path_is_projected_to_where_it_is(path: Path) -> None:
    s = arc_lengths(path)
    left = np.column_stack([-np.sin(path.heading(s)), np.cos(path.heading(s))])
    for e in (-0.15, 0.0, 0.2):
        found = np.array([path.project(p, near) for p, near in zip(path.point(s) + e * left, s + 0.05, strict=True)])
        assert_allclose(found, s, atol=1e-9)
        assert_allclose(offset(path, path.point(s) + e * left, found), e, atol=1e-9)


@every_path
def test_no_point_of_the_path_is_nearer_than_the_projection_but_on_a_later_pass(path: Path) -> None:
    rng = np.random.default_rng(5)
    length = min(path.length, 6.0)
    along = np.linspace(0.0, length, 20_001)
    dense = path.point(along)
    for p in dense[rng.integers(len(dense), size=12)] + rng.uniform(-0.8, 0.8, (12, 2)):
        far = np.linalg.norm(dense - p, axis=1)
        s = float(path.project(p))
        found = float(np.linalg.norm(path.point(s) - p))
        if found > far.min() + 1e-9:
            assert found <= far.min() + 0.01 * path.length
            assert s < along[np.argmin(far)]
            assert far[np.abs(along - s) < 0.1].min() >= found - 1e-9


@pytest.mark.parametrize("behind", [0.02, -0.02])
def test_a_path_that_ends_where_it_begins_is_begun_at_its_begin(behind: float) -> None:
    path = SplinePath(np.array([(0, 0), (2, 0), (3, 1.5), (0.5, 3), (-1.5, 1), (0, 0)]))
    for aside in (-0.1, 0.0, 0.1):
        assert float(path.project((-behind, aside))) == pytest.approx(-behind, abs=0.05)
    back = path.point(path.length - 0.3)
    assert float(path.project(back, path.length - 0.5)) == pytest.approx(path.length - 0.3)


def test_a_crossing_belongs_to_the_pass_that_is_first_or_near() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 13)
    path = SplinePath(np.column_stack([1.0 + 2.0 * np.sin(turn), np.sin(2.0 * turn) - 1.0]))
    middle = (1.0, -1.0)
    assert float(path.project(middle)) == pytest.approx(0.0, abs=1e-6)
    for near in (0.4, 0.5, 0.6):
        assert float(path.project(middle, near * path.length)) == pytest.approx(path.length / 2.0, abs=1e-6)


def test_the_nearest_pass_counts_where_knots_are_far_apart() -> None:
    """A place beside the middle of a long chord is nearer to a node of another pass than to those of its own."""
    path = SplinePath(np.array([(0.0, 0.0), (160.0, 0.0), (164.0, 3.0), (160.0, 6.0), (0.0, 6.0)]))
    s = path.length - path._nodes[1][1:2] * 0.5
    place = path.point(s)[0] - [0.0, 0.3]
    assert abs(float(path.project(place)) - s[0]) < 1.0


@seed(3)
@given(s=st.floats(-20, 20), e=st.floats(-1.0, 1.0), azimuth=st.floats(-7, 7))
def test_lines_and_circles_are_projected_exactly(s: float, e: float, azimuth: float) -> None:
    for path in (Line((0.5, -1.0), azimuth), Circle(1.5, (0.5, -1.0), azimuth, "right")):
        left = np.array([-np.sin(path.heading(s)), np.cos(path.heading(s))])
        place = path.point(s) + e * left
        assert_allclose(path.project(place, s), s, atol=1e-12)
        assert_allclose(offset(path, place, path.project(place)), e, atol=1e-12)


def test_the_circle_is_one() -> None:
    path = Circle(1.5)
    assert path.length == pytest.approx(3 * np.pi)
    assert_allclose(path.point([0.0, path.length / 4, path.length / 2]), [[0, 0], [1.5, 1.5], [0, 3]], atol=1e-12)
    assert path.heading(2 * path.length) == pytest.approx(4 * np.pi)
    assert path.project((0.0, 3.2)) == pytest.approx(path.length / 2)
    assert path.project((0.0, 3.2), 2.4 * path.length) == pytest.approx(2.5 * path.length)


def test_the_s_curve_is_the_sine_it_says() -> None:
    path = SCurve(amplitude=0.4, wavelength=4.0, waves=1.0)
    axis = -math.atan(0.4 * np.pi / 2)
    crest = np.array([np.cos(axis) - 0.4 * np.sin(axis), np.sin(axis) + 0.4 * np.cos(axis)])
    quarter = float(path.project(crest))
    assert_allclose(path.point(quarter), crest, atol=1e-12)
    assert path.curvature(quarter) == pytest.approx(-0.4 * (np.pi / 2) ** 2)
    assert path.heading(quarter) == pytest.approx(axis)
    assert float(path.heading(0.0)) == pytest.approx(0.0)
    assert float(path.curvature(0.0)) == pytest.approx(0.0)
    x = np.linspace(0.0, 4.0, 40_001)
    assert path.length == pytest.approx(np.hypot(np.diff(x), np.diff(0.4 * np.sin(np.pi / 2 * x))).sum(), rel=1e-8)


def test_a_spline_passes_through_its_points_without_a_jump_of_curvature() -> None:
    points = np.array(CORNERS)
    path = SplinePath(points)
    s = path.project(points)
    assert_allclose(path.point(s), points, atol=1e-12)
    assert_allclose(path.curvature(s[1:-1] - 1e-7), path.curvature(s[1:-1] + 1e-7), atol=1e-5)


def test_a_closed_spline_goes_on_where_it_began() -> None:
    path = PATHS["closed spline"]
    s = np.array([0.3, 1.7])
    assert_allclose(path.point(s + 2 * path.length), path.point(s), atol=1e-12)
    assert_allclose(path.heading(s - path.length), path.heading(s) - 2 * np.pi, atol=1e-9)
    assert_allclose(path.project(path.point(0.02), path.length - 0.1), path.length + 0.02, atol=1e-9)


def test_way_points_are_legs_and_arcs() -> None:
    path = WayPoints([(0, 0), (2, 0), (2, 3)], radius=0.5)
    assert path.length == pytest.approx(1.5 + np.pi / 4 + 2.5)
    assert_allclose(path.point([0.0, 1.0, path.length]), [[0, 0], [1, 0], [2, 3]], atol=1e-12)
    assert_allclose(path.curvature([1.0, 1.6, 3.0]), [0.0, 2.0, 0.0], atol=1e-12)


def test_a_level_pipe_seen_from_above_is_its_centre_line() -> None:
    path, s = PlanView(PIPE), np.linspace(0.0, PIPE.total, 50)
    assert path.length == pytest.approx(PIPE.total, abs=1e-12)
    assert_allclose(path.point(s), PIPE.at(s)[0][:, :2], atol=1e-12)
    assert_allclose(np.unique(np.round(path.curvature(s), 9)), [-1 / 1.5, 0.0, 0.5], atol=1e-8)


def test_a_path_that_crosses_itself_is_not_confused_when_tracked() -> None:
    eight = SplinePath(
        np.array([(0, 0), (1, 1), (2, 0), (1, -1), (0, 0.0001), (-1, 1), (-2, 0), (-1, -1)]), closed=True
    )
    s = np.linspace(0.05, 0.95 * eight.length, 200)
    assert_allclose(track(eight, eight.point(s), near=0.0), s, atol=1e-8)


MIRRORED: dict[str, tuple[Path, Path]] = {
    "line": (Line((0.3, -0.2), 0.7), Line((0.3, 0.2), -0.7)),
    "circle": (Circle(1.5, (0, 1), 0.2), Circle(1.5, (0, -1), -0.2, "right")),
    "s-curve": (SCurve(azimuth=0.3), SCurve(azimuth=-0.3, towards="right")),
    "spline": (SplinePath(np.array(CORNERS)), SplinePath(np.array(CORNERS) * [1, -1])),
    "way points": (WayPoints(CORNERS, 0.8), WayPoints(np.array(CORNERS) * [1, -1], 0.8)),
}


@pytest.mark.parametrize(("one", "other"), MIRRORED.values(), ids=MIRRORED.keys())
def test_mirrored_paths_are_mirror_images(one: Path, other: Path) -> None:
    s = np.linspace(0.0, 3.0, 20)
    assert_allclose(other.point(s), one.point(s) * [1, -1], atol=1e-14)
    assert_allclose(other.heading(s), -one.heading(s), atol=1e-14)
    assert_allclose(other.curvature(s), -one.curvature(s), atol=1e-14)
    assert_allclose(other.project([1.0, -0.3], 1.0), one.project([1.0, 0.3], 1.0), atol=1e-13)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Line(length=0.0), "length: got 0.0 m, must be above 0"),
        (lambda: Circle(-1.0), "radius: got -1.0 m, must be finite and above 0"),
        (lambda: Circle(1.0, towards="up"), "towards: got 'up', must be 'left' or 'right'"),  # type: ignore[arg-type]
        (lambda: Line((0.0, math.nan)), "must be finite"),
        (lambda: SCurve(wavelength=0.0), "wavelength: got 0.0, must be finite and above 0"),
        (lambda: SplinePath(np.zeros((1, 2))), r"points: got shape \(1, 2\)"),
        (lambda: SplinePath(np.zeros((2, 2))), "two that follow each other coincide; leave"),
        (
            lambda: SplinePath([(0, 0), (1, 0), (1, 1), (0, 0)], closed=True),
            "coincide, as the first one of a closed path",
        ),
        (lambda: WayPoints([(0, 0), (1, 0), (1, 1), (1, 0)], 0.1), "the path turns back on itself at point 2"),
        (lambda: WayPoints([(0, 0), (1, 0), (1, 1)], 1.5), "too large for the stretch of 1 m from point 0 to 1"),
        (lambda: PlanView(Centreline.of([Straight(1.0)], tilt=np.pi / 2)), "vertical somewhere"),
    ],
)
def test_bad_paths_are_told(make: Callable[[], object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


def test_profiles() -> None:
    steps = Steps(0.04, (5.0, 10.0), (0.08, 0.06))
    assert_array_equal(steps(np.array([0.0, 4.99, 5.0, 9.99, 10.0, 99.0])), [0.04, 0.04, 0.08, 0.08, 0.06, 0.06])
    assert steps(500 * 0.01) == 0.08
    assert_allclose(Sine(0.06, 0.02, 20.0)(np.array([0.0, 5.0, 15.0])), [0.06, 0.08, 0.04])
    assert_array_equal(Constant(0.08)([1.0, 2.0]), [0.08, 0.08])
    with pytest.raises(ValueError, match=r"times: got \(2.0, 1.0\), must grow"):
        Steps(0.0, (2.0, 1.0), (1.0, 1.0))
    with pytest.raises(ValueError, match="got 1 for 2 times"):
        Steps(0.0, (1.0, 2.0), (1.0,))
    with pytest.raises(ValueError, match="period: got 0"):
        Sine(0.0, 1.0, 0)


def test_a_reference_has_a_heading_or_a_path() -> None:
    assert Reference(Constant(0.08), path=Line()).heading is None
    with pytest.raises(ValueError, match="got both, must be at most one"):
        Reference(Constant(0.08), Constant(0.0), Line())
    with pytest.raises(ValueError, match=r"speed: got float, must be a function of time"):
        Reference(0.08)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="path: got list"):
        Reference(Constant(0.08), path=[(0, 0)])  # type: ignore[arg-type]


def test_the_way_along_a_pipe_that_rises_is_longer_than_it_seems_from_above() -> None:
    """By one over the cosine of its tilt; speeds asked for are along it, so less is asked for as seen from above."""
    rise = PlanView(Centreline.of([Straight(1.0), Bend(0.6, 2.0, "up"), Straight(1.0)]))
    assert_allclose(lengthening(rise, [0.5, rise.length - 0.1, rise.length + 1.0]), 1.0 / np.cos([0.0, 0.6, 0.6]))
    s = np.linspace(0.0, rise.length, 20001)
    assert_allclose(np.trapezoid(lengthening(rise, s), s), 3.2, rtol=1e-7)
    assert_allclose(lengthening(Line(), [0.0, 1.0]), 1.0)
    asked = speed_at(Reference(Constant(0.06), path=rise), np.zeros(2), np.array([0.5, rise.length]))
    assert_allclose(asked, 0.06 * np.cos([0.0, 0.6]))
