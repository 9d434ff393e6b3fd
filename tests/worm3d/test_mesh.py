"""Worlds from mesh files: distances against trimesh's exact ones, normals, and worms on and inside meshes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Mesh, Plane, State, Status, Worm
from worm3d.recorded.energy import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from worm3d.worlds import mesh as module
from worm3d.worlds.kernels import looked_up

TURN = np.eye(4)
TURN[:3, :3] = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
SHAPES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "sphere": lambda: trimesh.creation.icosphere(subdivisions=4, radius=0.5),
    "box": lambda: trimesh.creation.box((1.0, 0.7, 0.5)),
    "turned box": lambda: trimesh.creation.box((1.0, 0.7, 0.5), TURN),
    "ring": lambda: trimesh.creation.annulus(0.2, 0.4, 1.0, sections=64),
}
CELL = 0.02


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_folder", lambda: tmp_path / "grids")


def saved(solid: trimesh.Trimesh, folder: Path, name: str = "solid.stl") -> Path:
    path = folder / name
    data = solid.export(file_type=path.suffix[1:])
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def winding(solid: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Return winding numbers: the solid angles of all triangles over 4 pi (van Oosterom and Strackee), shape (M,)."""
    corners = solid.triangles[None] - points[:, None, None]
    a, b, c = np.moveaxis(corners, 2, 0)
    size_a, size_b, size_c = (np.linalg.norm(each, axis=2) for each in (a, b, c))
    over = np.einsum("mki,mki->mk", a, np.cross(b, c))
    under = size_a * size_b * size_c + np.sum(a * b, 2) * size_c + np.sum(b * c, 2) * size_a + np.sum(c * a, 2) * size_b
    angle: np.ndarray = np.arctan2(over, under).sum(axis=1) / (2 * np.pi)
    return angle


def exact(solid: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Return trimesh's exact distances, negative inside, shape (M,)."""
    parts = np.array_split(points, max(1, len(points) * len(solid.faces) // 400_000))
    distance = np.concatenate([trimesh.proximity.closest_point_naive(solid, part)[1] for part in parts])
    inside = np.concatenate([winding(solid, part) for part in parts]) > 0.5
    return np.where(inside, -distance, distance)


def about(solid: trimesh.Trimesh, count: int, reach: float) -> np.ndarray:
    """Return points within reach of the surface along each axis, shape (count, 3)."""
    points, _ = trimesh.sample.sample_surface(solid, count, seed=1)
    offset: np.ndarray = points + np.random.default_rng(2).uniform(-reach, reach, points.shape)
    return offset


def about_edges(solid: trimesh.Trimesh, count: int, reach: float) -> np.ndarray:
    """Return points within reach of the edges along each axis, a tenth of them of a corner, shape (count, 3)."""
    rng = np.random.default_rng(6)
    edges = solid.vertices[solid.face_adjacency_edges[solid.face_adjacency_angles > 0.5]]
    ends = edges[rng.integers(len(edges), size=count if len(edges) else 0)]
    share = rng.uniform(size=(len(ends), 1)) * (rng.uniform(size=(len(ends), 1)) > 0.1)
    points: np.ndarray = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    return points + rng.uniform(-reach, reach, points.shape)


@pytest.mark.parametrize("name", [pytest.param(each, marks=[pytest.mark.slow] * (each == "sphere")) for each in SHAPES])
def test_distances_are_those_of_trimesh(name: str, tmp_path: Path) -> None:
    """Within 0.2 of a cell, at edges and corners of 90 degrees too."""
    path = saved(SHAPES[name](), tmp_path)
    solid, world = trimesh.load(path, force="mesh"), Mesh(path, units="m", cell=CELL)
    points = np.concatenate([about(solid, 1500, CELL), about_edges(solid, 1500, CELL)])
    error = np.abs(world.distance(points) - exact(solid, points)) / CELL
    assert error.max() < (0.05 if name == "sphere" else 0.2)
    assert np.quantile(error, 0.9) < 0.11
    everywhere = np.random.default_rng(3).uniform(-0.6, 0.6, (300, 3))
    far = exact(solid, everywhere)
    assert (np.abs(world.distance(everywhere) - far) < CELL + 0.1 * np.abs(far)).all(), "it tells how far it is"


@pytest.mark.parametrize("name", SHAPES)
def test_normals_are_the_derivatives_of_the_distance(name: str, tmp_path: Path) -> None:
    solid = SHAPES[name]()
    world = Mesh(saved(solid, tmp_path), units="m", cell=CELL)
    points, h, kernel = about(solid, 1000, 0.5 * CELL), 1e-6, world.kernel(np.inf)
    rows = looked_up(kernel, points)
    pairs = [[looked_up(kernel, points + sign * h * axis)[0] for sign in (1, -1)] for axis in np.eye(3)]
    assert_allclose(rows[1:4], [(up - down) / (2 * h) for up, down in pairs], rtol=0, atol=1e-7)
    for _ in range(6):  # along the normal to the surface itself
        points -= (rows[0] * rows[1:4]).T
        rows = looked_up(kernel, points)
    on = np.abs(rows[0]) < 1e-12
    assert np.count_nonzero(on) > 0.9 * len(points)
    assert_allclose(np.linalg.norm(rows[1:4, on], axis=0), 1.0, rtol=0, atol=1e-9)
    assert_array_equal(looked_up(world.kernel(), points), rows)  # what a simulation sees


def test_curvature_is_that_of_the_sphere(tmp_path: Path) -> None:
    """(I - n n')/R on the surface of a ball, all but the facets."""
    world = Mesh(saved(trimesh.creation.icosphere(subdivisions=5, radius=0.5), tmp_path), units="m", cell=0.04)
    n = np.random.default_rng(4).normal(size=(50, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    rows = looked_up(world.kernel(), 0.5 * n)
    xx, xy, xz, yy, yz, zz = rows[4:10]
    hessian = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    expected = (np.eye(3) - n[:, :, None] * n[:, None, :]) / 0.5
    assert np.abs(hessian - expected).max() < 0.15 * 2.0


def test_the_other_side_can_be_solid(tmp_path: Path) -> None:
    path = saved(SHAPES["ring"](), tmp_path)
    inside, outside = (Mesh(path, units="m", cell=0.04, solid=side) for side in ("inside", "outside"))
    points = np.random.default_rng(5).uniform(-3.0, 3.0, (200, 3))
    assert_array_equal(inside.distance(points), -outside.distance(points))
    assert inside.distance(np.array([0.3, 0.0, 0.0])) < 0.0 < inside.distance(np.zeros(3))
    assert_allclose(inside.distance(np.array([0.0, 0.0, 100.0])), 99.5, rtol=1e-3)


def test_files_of_all_kinds_give_the_same_world(tmp_path: Path) -> None:
    solid = SHAPES["turned box"]()
    points = about(solid, 200, CELL)
    reference = Mesh(saved(solid, tmp_path), units="m", cell=0.04).distance(points)
    for kind in ("obj", "ply", "glb"):
        world = Mesh(saved(solid, tmp_path, f"solid.{kind}"), units="m", cell=0.04)
        assert_allclose(world.distance(points), reference, rtol=0, atol=1e-5)
    without = Mesh(tmp_path / "solid.glb", cell=0.04)  # glTF is in metres
    assert_allclose(without.distance(points), reference, rtol=0, atol=1e-5)


def test_units_axes_and_position(tmp_path: Path) -> None:
    solid = trimesh.creation.box((400.0, 200.0, 100.0))
    world = Mesh(saved(solid, tmp_path), units="mm", cell=0.01, position=(1.0, 2.0, 3.0), grip=0.5)
    rows = looked_up(world.kernel(), np.array([[1.22, 2.0, 3.0], [1.0, 2.12, 3.0], [1.0, 2.0, 3.07]]))
    assert_allclose(rows[0], 0.02, rtol=0, atol=1e-6)
    assert_allclose(rows[1:4], np.eye(3), rtol=0, atol=0.01)
    assert_array_equal(rows[10], 0.5)
    lying = Mesh(tmp_path / "solid.stl", units="mm", cell=0.01, up="y")
    assert_allclose(lying.distance(np.array([0.0, 0.0, 0.12])), 0.02, rtol=0, atol=1e-6)
    vertices, faces = world.triangles()
    assert_allclose(vertices.mean(axis=0), [1.0, 2.0, 3.0], rtol=1e-12)
    assert faces.shape == (12, 3)


def test_a_grid_is_computed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, points = saved(SHAPES["box"](), tmp_path), np.random.default_rng(7).uniform(-1.0, 1.0, (50, 3))
    first = Mesh(path, units="m").distance(points)

    def never(*_: object) -> None:
        raise AssertionError("computed again")

    with monkeypatch.context() as context:
        context.setattr("worm3d.worlds.mesh_distance.filled", never)
        assert_array_equal(Mesh(path, units="m").distance(points), first)
        with pytest.raises(AssertionError, match="computed again"):
            Mesh(path, units="m", cell=0.05)
    kept = next((tmp_path / "grids").iterdir())
    kept.write_bytes(kept.read_bytes()[:1000])  # spoilt on disk: computed again
    assert_array_equal(Mesh(path, units="m").distance(points), first)


@pytest.fixture
def slab(tmp_path: Path) -> Mesh:
    """A floor of which the top is z = 0."""
    solid = trimesh.creation.box((3.0, 1.5, 0.2))
    solid.apply_translation((1.0, 0.0, -0.1))
    return Mesh(saved(solid, tmp_path), units="m")


@pytest.fixture
def tunnel(tmp_path: Path) -> Mesh:
    """A tunnel of 12 cm radius and 2.4 m length that rises by 5 degrees; the mesh is its air."""
    air = trimesh.creation.cylinder(0.12, 2.4, sections=64)
    along = np.eye(4)
    along[:3, :3] = Rotation.from_euler("y", 85.0, degrees=True).as_matrix()
    air.apply_transform(along)
    return Mesh(saved(air, tmp_path), units="m", cell=0.015, solid="outside")


def test_a_worm_crawls_on_a_slab_as_on_the_plane(slab: Mesh) -> None:
    """As fast within 3 %: it comes to rest in its own way on a world that is not known to be level."""
    on_slab, on_plane = (
        worm3d.simulate(Worm(), world, actuation=TravellingWave(), duration=6.0) for world in (slab, Plane())
    )
    assert on_slab.status is Status.DONE
    assert_allclose(on_slab.distance, on_plane.distance, rtol=0.03)
    assert np.abs(on_slab.com[:, 1]).max() < 1e-6
    fewer = on_plane.newton_iterations.mean()
    assert on_slab.newton_iterations.mean() < 1.2 * fewer


@pytest.mark.parametrize("where", ["slab", "tunnel"])
def test_a_worm_rests_on_a_mesh_without_creep(where: str, request: pytest.FixtureRequest) -> None:
    """No joint moves by 1e-11 m in 60 s from the first row on, by 1e-12 m after 5 s; the contacts carry the weight."""
    world: Mesh = request.getfixturevalue(where)
    worm, friction, at = Worm(), Friction(0.5, 0.5, 0.5), (-0.8, 0.0) if where == "tunnel" else (0.2, 0.0)
    result = worm3d.simulate(worm, world, friction, state=State.straight(worm, world, at), duration=65.0)
    assert result.status is Status.DONE
    assert np.abs(result.joints - result.joints[0]).max() < 1e-11
    assert np.abs(result.joints[500:] - result.joints[500]).max() < 1e-12
    assert_array_equal(result.slip[501:], 0.0)
    assert_allclose(result.contact_force[-1].sum(axis=(0, 1)), [0.0, 0.0, worm.mass * 9.81], rtol=0, atol=1e-8)
    if where == "slab":
        assert_allclose(result.normal_load[-1].sum() + result.joint_load[-1].sum(), worm.mass * 9.81, rtol=1e-6)


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_the_ledger_closes_in_a_tunnel(tunnel: Mesh, integrator: str) -> None:
    state, gait = State.straight(Worm(), tunnel, (-0.8, 0.0)), TravellingWave()
    result = worm3d.simulate(Worm(), tunnel, actuation=gait, duration=4.0, state=state, integrator=integrator)
    assert result.status is Status.DONE
    absolute = np.sum(
        [np.abs(getattr(result.energy, name)) for name in (*SUPPLIED_ENERGY, *STORED_ENERGY, *LOST_ENERGY)], axis=0
    )[1:]
    assert np.abs(result.energy.residual[1:] / absolute).max() < 1e-9
    assert result.com[-1, 0] > result.com[0, 0] + 0.05, "it climbs"
    assert result.com[-1, 2] > result.com[0, 2]


def test_worms_side_by_side_on_one_mesh_do_not_meet(slab: Mesh) -> None:
    """Threads share the grid and nothing else: bit for bit the single runs."""
    gaits = [TravellingWave(amplitude=0.2 + 0.02 * k, bias=0.1 * k) for k in range(4)]
    together = worm3d.simulate_batch(Worm(), slab, actuation=gaits, duration=1.0, threads=2)
    for gait, result in zip(gaits, together, strict=True):
        assert_array_equal(worm3d.simulate(Worm(), slab, actuation=gait, duration=1.0).joints, result.joints)


@pytest.mark.slow
def test_where_there_is_no_ground_or_no_room(slab: Mesh, tunnel: Mesh) -> None:
    with pytest.raises(
        ValueError, match=r"position: got \[2.0, 0.0\] m: the world has no ground under the worm at x = 2."
    ):
        State.straight(Worm(), slab, (2.0, 0.0))
    with pytest.raises(ValueError, match=r"inside the world; lift or move the worm|no ground under the worm"):
        worm3d.simulate(Worm(), tunnel, state=State.straight(Worm(), tunnel, (-0.5, 0.0), 0.8), duration=0.1)
    wide = Worm(half_height=0.14, chamber_offset=0.05)
    with pytest.raises(ValueError, match=r"state: "):
        worm3d.simulate(wide, tunnel, state=State.straight(wide, tunnel, (-0.8, 0.0)), duration=0.1)
