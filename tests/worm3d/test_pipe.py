"""The inside of a pipe: distances in closed form and against trimesh, normals and curvature against differences."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from worm3d import Bend, Centreline, Patch, Pipe, Profile, Straight
from worm3d.values.arrays import FloatArray
from worm3d.worlds.kernels import looked_up as rows

CROOKED = Centreline.of(
    [Straight(1.0), Bend(np.pi / 2, 0.3), Straight(0.3), Bend(1.0, 0.4, "up"), Bend(3.0, 0.5, "right"), Bend(0.5, 0.6)],
    start=(0.1, -0.2, 0.3),
    heading=0.4,
    tilt=0.3,
)  # fmt: skip
SPLINE = Centreline.through([(0.0, 0.0, 0.0), (0.5, 0.0, 0.1), (1.0, 0.4, 0.0), (1.2, 1.0, 0.3)])
NARROW = Profile([0.2, 0.35, 0.6, 0.8], [0.1, 0.08, 0.08, 0.12])
HESSIAN = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def across(tangents: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Random unit vectors normal to tangents."""
    v = rng.normal(size=tangents.shape)
    v -= np.sum(v * tangents, axis=1)[:, None] * tangents
    return v / np.linalg.norm(v, axis=1)[:, None]


def sampled(line: Centreline, reach: float, count: int = 2000) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points around a line, where their nearest points are along it, and how far away."""
    rng = np.random.default_rng(7)
    s = rng.uniform(-0.3, line.total + 0.3, count)
    d = rng.uniform(0.001, reach, count)
    points, tangents = line.at(s)
    return points + d[:, None] * across(tangents, rng), s, d


def differences(pipe: Pipe, points: FloatArray, first: int, last: int) -> FloatArray:
    """Central differences of rows of the world, shape (3, last - first, K)."""
    h = 1e-6
    ends = [[rows(pipe.kernel(), points + sign * h * axis)[first:last] for sign in (1, -1)] for axis in np.eye(3)]
    return np.array([(a - b) / (2.0 * h) for a, b in ends])


@pytest.mark.parametrize("line", [CROOKED, SPLINE])
def test_with_one_radius_the_distance_is_that_from_the_centre_line(line: Centreline) -> None:
    """g = R - d with d < R below the radius of each bend: closed form for cylinders and tori."""
    points, s, d = sampled(line, 0.14)
    pipe = Pipe(line, 0.1)
    assert_allclose(pipe.distance(points), 0.1 - d, rtol=0, atol=1e-12)
    assert_allclose(pipe.along(points), s, rtol=0, atol=1e-11)


def test_distances_are_trimeshs() -> None:
    """From inside the wall a vertex of a mesh inscribed into it is as near as the wall itself.

    Of a bend that is so on its outer side: on the inner one the chords of the mesh lie nearer.
    """
    line, radius = Centreline.of([Straight(0.5), Bend(1.2, 0.4), Straight(0.5)]), 0.1
    s, angle = np.linspace(0.0, line.total, 200), np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    centre, tangent = line.at(s)
    left = np.cross([0.0, 0.0, 1.0], tangent)
    rim = np.cos(angle)[:, None] * left[:, None] + np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])
    vertices = centre[:, None] + radius * rim
    k, m = np.meshgrid(np.arange(199), np.arange(64), indexing="ij")
    a, b, c, d = (i * 64 + j % 64 for i, j in ((k, m), (k + 1, m), (k + 1, m + 1), (k, m + 1)))
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    mesh = trimesh.Trimesh(vertices.reshape(-1, 3), faces, process=False)
    rng = np.random.default_rng(3)
    at, where = rng.integers(5, 195, 50), rng.integers(17, 48, 50)  # right of the line, where the bend is outside
    deep = rng.uniform(1e-4, 0.05, 50)
    points = vertices[at, where] + deep[:, None] * rim[at, where]
    nearest = [trimesh.triangles.closest_point(mesh.triangles, np.tile(p, (len(faces), 1))) for p in points]
    exact = np.array([np.linalg.norm(q - p, axis=1).min() for q, p in zip(nearest, points, strict=True)])
    assert_allclose(exact, deep, rtol=0, atol=1e-12)
    assert_allclose(Pipe(line, radius).distance(points), -exact, rtol=0, atol=1e-9)


def test_a_ramp_is_a_cone() -> None:
    """The distance from the straight part of a ramp is (R(s) - d) cos(slope)."""
    pipe = Pipe(Centreline.of([Straight(2.0)]), Profile([0.5, 1.0], [0.12, 0.08], rounding=0.2))
    slope = np.arctan2(0.04, 0.5)
    s, d = np.meshgrid(np.linspace(0.7, 0.8, 7), np.linspace(0.05, 0.12, 9))
    points = np.stack([s, d * np.sin(2.0), d * np.cos(2.0)], axis=-1)
    wide = 0.12 - (s - 0.5) * np.tan(slope)
    assert_allclose(pipe.distance(points), (wide - d) * np.cos(slope), rtol=0, atol=1e-12)
    assert_allclose(pipe.radius_at(s), wide, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_changing_radius_is_as_far_as_the_nearest_place_of_the_wall() -> None:
    """Against places of the wall 4 um apart: the square of the distance is then too great by (2 um)^2 at most."""
    pipe = Pipe(Centreline.of([Straight(1.0)]), NARROW)
    s, d = np.random.default_rng(5).uniform([-0.1, 0.0], [1.1, 0.13], (200, 2)).T
    wall = np.linspace(-0.3, 1.3, 400_001)
    nearest = np.array([np.hypot(wall - a, pipe.radius_at(wall) - b).min() for a, b in zip(s, d, strict=True)])
    found = pipe.distance(np.column_stack([s, d, np.zeros(200)]))
    assert_allclose(found**2, nearest**2, rtol=0, atol=5e-12)
    assert_array_equal(found > 0.0, pipe.radius_at(s) > d)


@pytest.mark.parametrize("pipe", [Pipe(CROOKED, 0.1), Pipe(CROOKED, NARROW), Pipe(SPLINE, 0.1)], ids="cns")
def test_normals_are_the_gradient_and_unit_vectors(pipe: Pipe) -> None:
    points, _, _ = sampled(pipe.centreline, 0.13)
    points = points[np.abs(pipe.distance(points)) < 0.03]  # near the wall, where forces arise
    assert len(points) > 500
    found = rows(pipe.kernel(), points)[1:4]
    assert_allclose(np.linalg.norm(found, axis=0), 1.0, rtol=0, atol=1e-14)
    assert_allclose(found, differences(pipe, points, 0, 1)[:, 0], rtol=0, atol=1e-8)


@pytest.mark.parametrize("pipe", [Pipe(CROOKED, 0.1), Pipe(CROOKED, NARROW), Pipe(SPLINE, 0.1)], ids="cns")
def test_the_hessian_is_that_of_the_distance_without_what_bulges(pipe: Pipe) -> None:
    """H = H+ + H- of the true Hessian: its negative part H- is kept."""
    points, _, _ = sampled(pipe.centreline, 0.13, 1000)
    points = points[np.abs(pipe.distance(points)) < 0.03]
    true = np.moveaxis(differences(pipe, points, 1, 4), 2, 0)
    values, vectors = np.linalg.eigh((true + true.transpose(0, 2, 1)) / 2.0)
    kept = np.einsum("kij,kj,klj->kil", vectors, np.minimum(values, 0.0), vectors)
    found = rows(pipe.kernel(), points)[4:10]
    # A few points lie within the differences' step of an edge between two pieces, where curvature jumps.
    off = np.abs(found - np.array([kept[:, i, j] for i, j in HESSIAN])).max(axis=0)
    assert np.quantile(off, 0.99) < 1e-6


@pytest.mark.parametrize("side", [-1e-5, 1e-5])
def test_beside_a_seam_of_two_arcs_the_hessian_is_that_of_the_arc(side: float) -> None:
    """Across it the normal is continuous, and only the curvature along the pipe jumps: by that of the two arcs."""
    seams = SPLINE.ends[:-1]
    points, tangents = SPLINE.at(seams + side)
    walls = points + 0.1 * across(tangents, np.random.default_rng(2))
    pipe = Pipe(SPLINE, 0.1)
    true = np.moveaxis(differences(pipe, walls, 1, 4), 2, 0)
    along = np.einsum("ki,kij,kj->k", tangents, true, tangents)
    found = rows(pipe.kernel(), walls)
    kept = true + np.where(along > 0.0, -along, 0.0)[:, None, None] * tangents[:, :, None] * tangents[:, None, :]
    assert_allclose(found[4:10], [kept[:, i, j] for i, j in HESSIAN], rtol=0, atol=1e-6)
    beyond = walls - 2.0 * side * tangents
    moved = found[1:4] - rows(pipe.kernel(), beyond)[1:4]
    assert np.linalg.norm(moved, axis=0).max() < 4.0 * abs(side) / 0.1


def test_the_reach_of_known_lines() -> None:
    """The least radius, or half of the way to the next turn; never more, and no less than 0.7 of it."""
    turn = np.linspace(0.0, 8.0 * np.pi, 80)
    coil = Centreline.through(np.column_stack([2.0 * np.cos(turn), 2.0 * np.sin(turn), 0.1 * turn]))
    legs = Centreline.of([Straight(1.0), Bend(np.pi / 2, 0.2), Straight(0.2), Bend(np.pi / 2, 0.2), Straight(1.0)])
    apart = 0.1 * np.pi * 2.0 / np.hypot(2.0, 0.1)
    for line, reach in ((SPLINE, 1.0 / SPLINE.curvature.max()), (coil, apart), (legs, 0.2)):
        assert 0.7 * reach < line.reach <= reach
    assert Centreline.of([Straight(1.0), Bend(3.0 * np.pi / 2, 0.5), Straight(1.0)]).reach == 0.0, "it crosses itself"
    assert Centreline.of([Straight(3.0)]).reach > 2.0


@pytest.mark.parametrize("gap", [0.63, 0.16], ids=["apart", "touching"])
def test_in_a_coil_the_nearest_of_all_turns_counts(gap: float) -> None:
    """Turns a `gap` apart: of points one after the other on different turns, and farther away than the reach."""
    turn = np.linspace(0.0, 8.0 * np.pi, 80)
    line = Centreline.through(np.column_stack([2.0 * np.cos(turn), 2.0 * np.sin(turn), gap / 2.0 / np.pi * turn]))
    points, _, _ = sampled(line, 0.4, 600)
    places = line.at(np.linspace(-3.0, line.total + 3.0, 60_001))[0]  # 1 mm apart
    brute = np.array([np.linalg.norm(places - p, axis=1).min() for p in points])
    assert_allclose(0.1 - Pipe(line, 0.1).distance(points), brute, rtol=0, atol=1.3e-4)
    assert (brute < line.reach).any()
    assert (brute > line.reach).any()


def test_centre_lines() -> None:
    u_turn = Centreline.of([Bend(np.pi, 0.5, "left")], heading=np.pi / 2)
    assert_allclose(u_turn.at(u_turn.total)[0], [-1.0, 0.0, 0.0], rtol=0, atol=1e-15)
    up = Centreline.of([Straight(1.0), Bend(np.pi / 2, 0.5, "up"), Bend(np.pi / 2, 0.5, "right"), Straight(1.0)])
    point, tangent = up.at(up.total)
    assert_allclose(tangent, [0.0, -1.0, 0.0], rtol=0, atol=1e-15)
    assert_allclose(point, [1.5, -1.5, 1.0], rtol=0, atol=1e-15)
    assert_allclose(up.at(-1.0)[0], [-1.0, 0.0, 0.0], rtol=0, atol=1e-15)
    vertical = Centreline.of([Straight(2.0)], tilt=np.pi / 2)
    assert_allclose(vertical.at(1.5)[0], [0.0, 0.0, 1.5], rtol=0, atol=1e-15)


def test_a_spline_goes_through_its_points_and_its_ends_are_as_given() -> None:
    points = np.array([(0.0, 0.0, 0.0), (0.5, 0.0, 0.1), (1.0, 0.4, 0.0), (1.2, 1.0, 0.3)])
    places = Pipe(SPLINE, 0.05).along(points)
    assert_allclose(SPLINE.at(places)[0], points, rtol=0, atol=1e-12)
    straight = Centreline.through([(0.0, 0.0, 0.0), (3.0, 4.0, 0.0)])
    assert straight.straight
    assert_allclose(straight.total, 5.0, rtol=1e-14)
    circle = np.linspace(0.0, np.pi, 9)
    arc = Centreline.through(np.column_stack([np.cos(circle), np.sin(circle), np.zeros(9)]))
    assert_allclose(arc.total, np.pi, rtol=1e-3)  # the spline's, whose ends are natural


def test_the_same_line_from_its_other_end_is_the_same_pipe() -> None:
    points, _, _ = sampled(CROOKED, 0.14)
    ends, tangents = CROOKED.at(CROOKED.ends)
    turn = (CROOKED.curvature * CROOKED.length)[:, None]
    normal = np.cos(turn) * CROOKED.normal - np.sin(turn) * CROOKED.tangent
    arrays = (ends, -tangents, normal, CROOKED.curvature, CROOKED.length)
    mirrored = Centreline(*(array[::-1] for array in arrays))
    assert_allclose(Pipe(mirrored, 0.1).distance(points), Pipe(CROOKED, 0.1).distance(points), rtol=0, atol=1e-12)


def test_walls_close_the_ends() -> None:
    line = Centreline.of([Straight(0.5), Bend(1.0, 0.4), Straight(0.5)])
    pipe = Pipe(line, 0.1, start_wall=True, end_wall=True)
    points = np.array([[0.02, 0.0, 0.0], [-0.03, 0.05, 0.0], [0.3, 0.09, 0.0], [-0.03, 0.0, 0.14]])
    assert_allclose(pipe.distance(points), [0.02, -0.03, 0.01, -0.05], rtol=0, atol=1e-14)  # the corner: 3, 4, 5
    assert_allclose(rows(pipe.kernel(), points)[1:4].T[-1], [0.6, 0.0, -0.8], rtol=0, atol=1e-14)
    end, tangent = line.at(line.total)
    assert_allclose(pipe.distance(end + np.outer([-0.04, 0.06], tangent)), [0.04, -0.06], rtol=0, atol=1e-14)
    inside = sampled(line, 0.13)[0]
    assert_allclose(rows(pipe.kernel(), inside)[1:4], differences(pipe, inside, 0, 1)[:, 0], rtol=0, atol=1e-2)


def test_grip_changes_along_the_pipe() -> None:
    pipe = Pipe(CROOKED, 0.1, patches=(Patch(0.5, along=(0.5, 2.0)), Patch(2.0, along=(1.9, np.inf))))
    points, s, _ = sampled(CROOKED, 0.12)
    expected = np.where(s >= 1.9, 2.0, np.where(s >= 0.5, 0.5, 1.0))
    assert_array_equal(rows(pipe.kernel(), points)[10], expected)


MISTAKES = [
    (lambda: Straight(0.0), r"length: got 0.0 m, must be finite and above 0"),
    (lambda: Bend(1.0, 0.5, "north"), r"towards: got 'north', must be one of 'left', 'right', 'up', 'down'"),  # type: ignore[arg-type]
    (lambda: Centreline.of([]), r"pieces: got none"),
    (lambda: Centreline.through([(0.0, 0.0, 0.0)]), r"points: got shape \(1, 3\), must be \(P, 3\)"),
    (lambda: Centreline.through([(0.0, 0.0, 0.0)] * 2), r"points: two that follow each other coincide"),
    (lambda: Pipe(CROOKED, 0.0), r"radius: got 0.0 m, must be finite and above 0"),
    (lambda: Pipe(CROOKED, 0.35), r"radius: got 0.35 m in a bend of 0.3 m at 1 m along the pipe, must be below"),
    (lambda: Pipe(CROOKED, Profile([0.9, 1.1], [0.1, 0.08])), r"radius: changes from .* m along the pipe, where it"),
    (lambda: Pipe(CROOKED, 0.1, end_wall=True), r"end_wall: the pipe must be straight there for at least its diameter"),
    (lambda: Pipe(CROOKED, 0.1, (Patch(1.0, across=(0.0, 1.0)),)), r"patches: got an `across`"),
    (lambda: Profile([0.0, 0.0], [0.1, 0.2]), r"along, radius: got .* places increasing"),
    (lambda: Profile([0.0, 0.01], [0.1, 0.2]), r"rises or falls by 84.3 degrees at 0 m, must be at most 80 degrees"),
    (lambda: Profile([0.0], [-0.1]), r"radius: got -0.1, every value must be finite and above 0"),
    (lambda: Profile([0.0], [0.1], rounding=0.0), r"rounding: got 0.0 m"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "sentence"), MISTAKES)
def test_what_makes_no_pipe_is_refused(make: object, sentence: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=sentence):
        make()


def test_pieces_with_a_kink_are_refused() -> None:
    line = Centreline.of([Straight(1.0), Straight(1.0)])
    with pytest.raises(ValueError, match="pieces 0 and 1 do not meet without a kink; put a bend between them"):
        Centreline(line.start, [[1, 0, 0], [0, 1, 0]], line.normal, line.curvature, line.length)  # type: ignore[arg-type]


def test_distances_of_no_places() -> None:
    pipe = Pipe(Centreline.of([Straight(1.0)]), 0.1)
    distance = pipe.distance(np.empty((0, 3)))
    assert np.shape(distance) == (0,)
