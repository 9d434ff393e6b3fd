"""Heightfields: distances to the spline's surface, normals, and worms that rest and crawl on them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Heightfield, Plane, State, Status, Worm
from worm3d.recorded.energy import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from worm3d.worlds.kernels import looked_up

RUBBLE = Heightfield.rubble(3.0, 1.5, 0.02, height=0.04, size=0.12, seed=1)
WAVES = Heightfield.sinusoid(3.0, 1.6, 0.02, amplitude=0.01, wavelength=0.5)
STAIRS = Heightfield.steps(3.0, 1.5, 0.02, height=0.02, tread=0.4, ramp=0.12)
TERRAINS = pytest.mark.parametrize("world", [RUBBLE, WAVES, STAIRS], ids=["rubble", "waves", "stairs"])
START = (0.5, 0.0)


def near(world: Heightfield, count: int, cells: float) -> np.ndarray:
    """Return points within so many cells above and below the surface, shape (count, 3)."""
    rng = np.random.default_rng(0)
    low, high = [0.2, -0.5], [2.8, 0.5]
    places = rng.uniform(low, high, (count, 2))
    return np.column_stack([places, world.height(places) + cells * world.spacing * rng.uniform(-1.0, 1.0, count)])


def exact(world: Heightfield, point: np.ndarray) -> float:
    """Return the distance of a point to the interpolated surface, by a search from many starts."""

    def square(place: np.ndarray) -> float:
        return float(((point[:2] - place) ** 2).sum() + (point[2] - world.height(place)) ** 2)

    around = point[:2] + world.spacing * np.stack(np.meshgrid(*2 * [np.linspace(-3, 3, 13)]), -1).reshape(-1, 2)
    begin = around[np.argmin(((around - point[:2]) ** 2).sum(axis=1) + (point[2] - world.height(around)) ** 2)]
    found = minimize(square, begin, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-20, "maxiter": 2000})
    return float(np.sqrt(found.fun) * np.sign(point[2] - world.height(point[:2])))


@pytest.mark.slow
@TERRAINS
def test_distances_are_those_to_the_interpolated_surface(world: Heightfield) -> None:
    """The bar is 0.2 of a cell; a foot point found is exact, and only at its focus it may be another one."""
    points = near(world, 60, 2.0)
    error = np.abs(world.distance(points) - [exact(world, point) for point in points])
    assert error.max() < 0.2 * world.spacing
    assert np.quantile(error, 0.9) < 1e-8


@pytest.mark.slow
def test_distances_are_those_of_trimesh() -> None:
    """To a triangulation ten times as fine."""
    import trimesh

    world = Heightfield.rubble(0.6, 0.6, 0.02, height=0.04, size=0.12, seed=3)
    x = np.arange(0.0, 0.6, 0.002)
    grid = np.stack(np.meshgrid(x, x - 0.3, indexing="ij"), axis=-1)
    index = np.arange(len(x) ** 2).reshape(len(x), len(x))
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    surface = trimesh.Trimesh(np.dstack([grid, world.height(grid)]).reshape(-1, 3), faces, process=False)
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(0.1, 0.5, 40), rng.uniform(-0.2, 0.2, 40)])
    points = np.column_stack([places, world.height(places) + rng.uniform(-0.04, 0.04, 40)])
    _, distance, _ = trimesh.proximity.closest_point_naive(surface, points)
    signed = distance * np.sign(points[:, 2] - world.height(places))
    assert np.abs(world.distance(points) - signed).max() < 0.2 * world.spacing


@TERRAINS
def test_normals_and_curvature_are_the_derivatives_of_the_distance(world: Heightfield) -> None:
    points, h, kernel = near(world, 2000, 0.5), 1e-6, world.kernel(1.0)
    rows = looked_up(kernel, points)
    moved = [[looked_up(kernel, points + sign * h * axis) for sign in (1, -1)] for axis in np.eye(3)]
    gradient = np.array([(up[0] - down[0]) / (2 * h) for up, down in moved])
    assert_allclose(rows[1:4], gradient, rtol=0, atol=1e-5)  # the difference's error, near a focus
    assert_allclose(np.linalg.norm(rows[1:4], axis=0), 1.0, rtol=1e-12)
    hessian = np.array([(up[1:4] - down[1:4]) / (2 * h) for up, down in moved])
    for row, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        scale = 1.0 + np.abs(rows[4:10]).max(axis=0)
        assert np.abs((rows[4 + row] - hessian[i, j]) / scale).max() < 1e-3


def test_the_surface_goes_through_the_heights_and_on_beyond_its_edges() -> None:
    nodes = np.stack(np.meshgrid(RUBBLE.x, RUBBLE.y, indexing="ij"), axis=-1)
    assert_allclose(RUBBLE.height(nodes), RUBBLE.heights, rtol=0, atol=1e-7)
    beyond = np.array([[-50.0, 0.0], [1.0, 1e6]])
    assert_allclose(RUBBLE.distance(np.column_stack([beyond, RUBBLE.height(beyond)])), 0.0, rtol=0, atol=1e-9)
    assert_allclose(RUBBLE.height(np.array([-50.0, RUBBLE.y[40]])), RUBBLE.heights[0, 40], rtol=0, atol=1e-6)


def test_what_may_touch_gets_its_foot_point_and_what_is_far_is_told_to_be_outside() -> None:
    """Also on ground as rough as its grid allows, of which the surface lies far from what is linear between nodes."""
    rough = Heightfield(np.random.default_rng(8).uniform(0.0, 0.1, (50, 40)), 0.02, (0.0, -0.4))
    for world in (RUBBLE, STAIRS, rough):
        points = near(world, 20_000, 0.5)
        quick, exact = looked_up(world.kernel(), points), looked_up(world.kernel(np.inf), points)
        differs = (quick != exact).any(axis=0)
        assert 0.01 < differs.mean() < 0.9
        assert (points[differs, 2] > world.height(points[differs, :2])).all()
        assert (quick[0, differs] > 0.0).mean() > 0.999


def test_waves_have_the_curvature_of_their_crests() -> None:
    """A k^2 on the crest of A cos(k x), 1/r of the osculating circle, and 1/(r + g) above it; the spline's to 1 %."""
    curvature, x = 0.01 * (2 * np.pi / 0.5) ** 2, 1.0
    for g in (0.0, 0.01):
        rows = looked_up(WAVES.kernel(1.0), np.array([[x, 0.0, 0.01 + g]]))[:, 0]
        assert_allclose(rows[0], g, rtol=0, atol=1e-5)
        assert_allclose(rows[4], 1.0 / (1.0 / curvature + g), rtol=1e-2)
        assert_allclose(rows[7], 0.0, rtol=0, atol=1e-9)


def test_what_is_not_finite_does_no_harm() -> None:
    rows = looked_up(RUBBLE.kernel(), np.array([[np.nan, 0.0, 0.0], [np.inf, -np.inf, 0.0], [0.0, 0.0, np.nan]]))
    assert not np.isfinite(rows[0]).all()


def test_a_level_field_is_the_plane() -> None:
    level = Heightfield(np.zeros((150, 80)), 0.02, (-1.0, -0.8))
    gait = TravellingWave(amplitude=0.3, bias=0.3)
    on_field, on_plane = (worm3d.simulate(Worm(), world, actuation=gait, duration=2.0) for world in (level, Plane()))
    assert_allclose(on_field.joints, on_plane.joints, rtol=0, atol=1e-9)


def test_grip_multiplies_friction() -> None:
    """Half of it everywhere is half the coefficients; by place, linear between nodes."""
    half = Heightfield(np.zeros((150, 80)), 0.02, (-1.0, -0.8), grip=0.5)
    runs = [
        worm3d.simulate(Worm(), world, friction, actuation=TravellingWave(), duration=1.0)
        for world, friction in ((half, Friction(0.06, 0.4, 0.4)), (Plane(), Friction(0.03, 0.2, 0.2)))
    ]
    assert_allclose(runs[0].com, runs[1].com, rtol=0, atol=1e-5)
    uneven = Heightfield(np.zeros((5, 5)), 0.1, grip=np.arange(5.0)[:, None] * np.ones(5))
    rows = looked_up(uneven.kernel(), np.array([[0.13, 0.2, 0.0], [0.3, 0.11, 0.0], [9.0, 0.0, 0.0]]))
    assert_allclose(rows[10], [1.3, 3.0, 4.0], rtol=1e-12)


@TERRAINS
def test_a_worm_rests_on_terrain_without_creep(world: Heightfield) -> None:
    """No joint moves by 1e-11 m in 60 s from the first row on, by 1e-12 m after 5 s; the contacts carry the weight."""
    worm, friction = Worm(), Friction(0.5, 0.5, 0.5)
    result = worm3d.simulate(worm, world, friction, state=State.straight(worm, world, START), duration=65.0)
    assert result.status is Status.DONE
    assert np.abs(result.joints - result.joints[0]).max() < 1e-11
    assert np.abs(result.joints[500:] - result.joints[500]).max() < 1e-12
    assert_array_equal(result.slip[501:], 0.0)
    assert_allclose(result.contact_force[-1].sum(axis=(0, 1)), [0.0, 0.0, worm.mass * 9.81], rtol=0, atol=1e-8)
    assert -world.distance(result.points[-1]).min() < 1e-4 * worm.l0, "resting penetration"


@TERRAINS
@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_the_ledger_closes_on_terrain(world: Heightfield, integrator: str) -> None:
    state, gait = State.straight(Worm(), world, START), TravellingWave(amplitude=0.3, bias=0.3)
    result = worm3d.simulate(Worm(), world, actuation=gait, duration=2.4, state=state, integrator=integrator)
    assert result.status is Status.DONE
    absolute = np.sum(
        [np.abs(getattr(result.energy, name)) for name in (*SUPPLIED_ENERGY, *STORED_ENERGY, *LOST_ENERGY)], axis=0
    )[1:]
    assert np.abs(result.energy.residual[1:] / absolute).max() < 1e-9
    assert result.energy.friction_loss.min() >= 0.0
    assert result.halved_steps == 0


def test_mirrored_commands_give_mirrored_paths_on_symmetric_terrain() -> None:
    state = State.straight(Worm(), WAVES, START)
    left, right = (
        worm3d.simulate(
            Worm(), WAVES, actuation=TravellingWave(amplitude=0.3, bias=bias), duration=2.0, state=state
        ).joints
        for bias in (0.3, -0.3)
    )
    assert np.abs(left[-1, :, 1]).max() > 1e-3, "it turns"
    assert_allclose(left, right * [1.0, -1.0, 1.0], rtol=0, atol=1e-9)


def test_a_worm_goes_down_a_hillside_faster_than_up() -> None:
    x = np.linspace(-1.5, 1.5, 151)
    hill = Heightfield(np.repeat(0.1 * np.abs(x)[:, None], 80, axis=1) * -1.0, 0.02, (-1.5, -0.8))
    up, down = (
        worm3d.simulate(Worm(), hill, actuation=TravellingWave(), duration=4.0, state=State.straight(Worm(), hill, at))
        for at in ((-1.3, 0.0), (0.2, 0.0))
    )
    assert up.status is down.status is Status.DONE
    assert 0.0 < up.distance < 0.8 * down.distance
    assert up.com[-1, 2] > up.com[0, 2]
    assert down.com[-1, 2] < down.com[0, 2]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("azimuth", [0.0, 0.8])
def test_a_worm_is_laid_on_rubble_from_above(seed: int, azimuth: float) -> None:
    """No apex starts inside; the line of its axis touches what holds it up, on both sides of its middle."""
    world = Heightfield.rubble(3.0, 2.0, 0.02, height=0.04, size=0.12, seed=seed)
    run = worm3d.simulate(Worm(), world, state=State.straight(Worm(), world, START, azimuth), duration=0.01)
    assert run.status is Status.DONE
    start = State.straight(Worm(), world, START, azimuth)
    assert start.joints[:, 2].max() < world.heights.max() + 0.1
    assert np.abs(run.joints[0] - start.joints).max() < 0.06, "it is let down, not thrown"


def test_terrain_is_made_as_it_says() -> None:
    assert RUBBLE.heights.min() >= 0.0
    assert 0.8 * 0.04 < RUBBLE.heights.max() <= 0.04
    again = Heightfield.rubble(3.0, 1.5, 0.02, height=0.04, size=0.12, seed=1)
    assert_array_equal(again.heights, RUBBLE.heights)
    assert (Heightfield.rubble(3.0, 1.5, 0.02, height=0.04, size=0.12, seed=2).heights != RUBBLE.heights).any()
    assert_allclose(STAIRS.height(np.array([[0.1, 0.0], [0.6, 0.0], [1.0, 0.3]])), [0.0, 0.02, 0.04], rtol=0, atol=1e-6)
    turned = Heightfield.sinusoid(1.0, 1.0, 0.02, amplitude=0.01, wavelength=0.5, azimuth=np.pi / 2)
    assert_allclose(turned.height(np.array([0.3, 0.25])), -0.01, rtol=0, atol=1e-5)


def test_an_image_is_a_map(tmp_path: Path) -> None:
    """Left is x = 0, up is y; black is low and white is high; 16 bits are stretched."""
    from PIL import Image

    grey = np.zeros((6, 8), dtype=np.uint8)
    grey[0, :] = 255  # the upper edge
    grey[5, 7] = 51  # right below
    Image.fromarray(grey).save(tmp_path / "map.png")
    world = Heightfield.from_image(tmp_path / "map.png", 0.1, 0.0, 0.5, origin=(1.0, 2.0))
    assert world.heights.shape == (8, 6)
    assert_allclose(world.heights[:, 5], 0.5)
    assert_allclose(world.heights[7, 0], 0.1)
    assert_allclose(world.height(np.array([1.7, 2.5])), 0.5, rtol=0, atol=1e-6)
    Image.fromarray(257 * grey.astype(np.uint16)).save(tmp_path / "deep.png")
    deep = Heightfield.from_image(tmp_path / "deep.png", 0.1, 0.0, 0.5, origin=(1.0, 2.0))
    assert_allclose(deep.heights, world.heights, rtol=0, atol=1e-12)


FLAT = np.zeros((9, 9))
WRONG: dict[str, tuple[Callable[[], object], str]] = {
    "NaN": (
        lambda: Heightfield(np.where(np.eye(9) > 0, np.nan, 0.0), 0.1),
        r"heights: got 9 values that are not finite, every one must be; fill the gaps first",
    ),
    "a row": (lambda: Heightfield(np.zeros(9), 0.1), r"heights: got shape \(9,\), must be \(A, B\) with at least 4"),
    "spacing": (lambda: Heightfield(FLAT, 0.0), r"spacing: got 0.0 m, must be finite and above 0"),
    "origin": (lambda: Heightfield(FLAT, 0.1, (0.0, np.inf)), r"origin: got inf, every value must be finite"),
    "grip": (lambda: Heightfield(FLAT, 0.1, grip=-1.0), r"grip: got shape \(\) and least value -1.0, must be at least"),
    "grips": (lambda: Heightfield(FLAT, 0.1, grip=np.ones(3)), r"grip: got shape \(3,\) .* as the heights, \(9, 9\)"),
    "size": (
        lambda: Heightfield.rubble(1.0, 1.0, 0.1, height=0.1, size=0.0),
        r"size: got 0.0, must be finite and above 0",
    ),
    "length": (
        lambda: Heightfield.sinusoid(-1.0, 1.0, 0.1, amplitude=0.1, wavelength=1.0),
        r"length: got -1.0 m, must be finite and above 0",
    ),
    "no image": (lambda: Heightfield.from_image("gone.png", 0.1, 0.0, 1.0), r"image 'gone.png': there is no such file"),
    "range": (lambda: Heightfield.from_image("gone.png", 0.1, 1.0, 0.0), r"low, high: got 1.0, 0.0 m, must be finite"),
    "off the grid": (
        lambda: State.straight(Worm(), RUBBLE, (2.5, 0.0)),
        r"the worm would reach to \[3.5, 0.0\] m, beyond the terrain, which spans \[0.0, -0.7",
    ),
    "too fine": (
        lambda: worm3d.simulate(Worm(), FINE, state=State(joints=ROW + np.array([0.0, 0.0, 0.2])), duration=0.1),
        r"finer than the worm's contact points: it has bumps of 0.0\d* m within 0.167 m, the distance of its feet",
    ),
    "inside": (
        lambda: worm3d.simulate(Worm(), RUBBLE, state=State(joints=ROW), duration=0.1),
        r"state: segment \d lies 0.0\d* m inside the world; lift or move the worm",
    ),
}
FINE = Heightfield.rubble(3.0, 1.5, 0.01, height=0.08, size=0.05)
ROW = np.column_stack([0.5 + np.arange(7) / 6, np.zeros(7), np.full(7, 0.02)])


@pytest.mark.parametrize("name", WRONG)
def test_mistakes_get_a_sentence(name: str) -> None:
    make, sentence = WRONG[name]
    with pytest.raises(ValueError, match=sentence):
        make()


def test_pictures_that_are_none(tmp_path: Path) -> None:
    from PIL import Image

    (tmp_path / "garbage.png").write_bytes(bytes(range(200)))
    with pytest.raises(ValueError, match=r"image 'garbage.png': cannot be read as a picture .*; save it again"):
        Heightfield.from_image(tmp_path / "garbage.png", 0.1, 0.0, 1.0)
    Image.fromarray(np.full((8, 8), 7, dtype=np.uint8)).save(tmp_path / "grey.png")
    with pytest.raises(ValueError, match=r"image 'grey.png': got one colour everywhere"):
        Heightfield.from_image(tmp_path / "grey.png", 0.1, 0.0, 1.0)
