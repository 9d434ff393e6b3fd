"""Worlds are drawn where the worm meets them."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from worm3d.viewer import WorldMesh, banded_pipe, chequered, heightfield
from worm3d.worlds import World
from worm3d.worlds.scenery import Window, on_ground, scenery, tile_size

WORM = np.array([[0.3, -0.2, 0.1], [1.7, 0.4, 0.3], [1.0, 1.1, 0.2]])
AROUND = Window(WORM, body_length=1.0)


class Waves(World):
    """A world that no picture knows: from above it is a landscape, upside down a ceiling."""

    def __init__(self, turned: float = 1.0) -> None:
        self.turned = turned

    def distance(self, points: np.ndarray) -> np.ndarray:
        return self.turned * (points[..., 2] - 0.1 * np.sin(3.0 * points[..., 0]) * np.cos(2.0 * points[..., 1]))


def corners(meshes: tuple[WorldMesh, ...]) -> np.ndarray:
    return np.concatenate([mesh.vertices for mesh in meshes])


@pytest.mark.parametrize("world", [worm3d.Plane(), worm3d.Plane(slope=0.5, heading=2.0)])
def test_the_tiles_of_a_plane_lie_in_it_around_the_worm(world: worm3d.Plane) -> None:
    tiles = scenery(world, AROUND).meshes
    assert_allclose(world.distance(corners(tiles)), 0.0, atol=1e-12)
    along = corners(tiles) @ world.axes[:2].T
    worm = WORM @ world.axes[:2].T
    assert (along.min(axis=0) <= worm.min(axis=0) - 1.0).all()
    assert (along.max(axis=0) >= worm.max(axis=0) + 1.0).all()
    assert_allclose(along / 0.1, np.round(along / 0.1), atol=1e-9, err_msg="the origin is a corner")
    for mesh in tiles:
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a) @ world.axes[2] > 0.0).all(), "seen from above"


def test_tiles_stay_where_they_are_wherever_the_worm_is() -> None:
    def dark(window: Window) -> set[tuple[float, ...]]:
        mesh = scenery(worm3d.Plane(), window).meshes[1]
        middles = mesh.vertices[mesh.faces].reshape(-1, 6, 3).mean(axis=1)
        return {tuple(np.round(middle, 6)) for middle in middles}

    one, other = dark(AROUND), dark(Window(WORM + np.array([0.37, 0.11, 0.0]), 1.0))
    assert len(one & other) > 0.7 * len(one)


def test_tiles_have_a_round_size_and_are_not_too_many() -> None:
    assert tile_size(1.0, np.array([3.0, 2.0])) == pytest.approx(0.1)
    assert tile_size(0.3, np.array([1.0, 1.0])) == pytest.approx(0.05)
    assert tile_size(1.0, np.array([500.0, 3.0])) == pytest.approx(1.0)


def test_patches_lie_just_above_the_ground_where_they_are_in_sight() -> None:
    patches = (
        worm3d.Patch(0.2, along=(0.5, 1.0)),
        worm3d.Patch(2.0, (0.8, 1.2), (0.0, 0.5)),
        worm3d.Patch(2.0, (90, 91)),
    )
    world = worm3d.Plane(slope=0.3, patches=patches)
    *_, ice, rough = scenery(world, AROUND).meshes
    assert (ice.name, rough.name) == ("friction x 0.2", "friction x 2")
    along = ice.vertices @ world.axes[:2].T
    assert_allclose([along[:, 0].min(), along[:, 0].max()], [0.5, 1.0])
    assert_allclose(world.distance(ice.vertices), 0.001)
    assert_allclose(world.distance(rough.vertices), 0.002)
    assert ice.colour[2] > ice.colour[0] > 0.0
    assert rough.colour[0] > rough.colour[2]


def test_nothing_is_drawn_of_nothing_and_the_clamped_ground_can_be_seen_through() -> None:
    assert scenery(None, AROUND).meshes == ()
    ground = scenery(worm3d.ClampedGround(), AROUND).meshes
    assert {mesh.opacity for mesh in ground} == {0.35}
    assert_allclose(corners(ground)[:, 2], 0.0, atol=1e-12)


def test_a_world_that_pictures_do_not_know_is_drawn_from_its_distance() -> None:
    world = Waves()
    assert isinstance(world, World)
    terrain = scenery(world, AROUND).meshes
    assert {mesh.opacity for mesh in terrain} == {1.0}
    used = np.concatenate([mesh.vertices[mesh.faces].reshape(-1, 3) for mesh in terrain])
    assert np.abs(world.distance(used)).max() < 0.002
    assert len(terrain[0].faces) == pytest.approx(len(terrain[1].faces), rel=0.3)
    (ceiling,) = scenery(Waves(-1.0), AROUND).meshes
    assert ceiling.opacity < 0.5, "it would hide the worm"


def test_a_world_out_of_sight_is_not_drawn() -> None:
    assert scenery(Waves(), Window(WORM + np.array([0.0, 0.0, 9.0]), 1.0)).meshes == ()


def test_bands_and_squares_share_the_faces_of_a_mesh() -> None:
    line = np.stack([np.linspace(0.0, 1.0, 41), np.zeros(41), np.zeros(41)], axis=1)
    light, dark = banded_pipe(line, 0.1, band=0.25)
    assert len(light.faces) == len(dark.faces)
    for mesh, bands in ((light, ((0.0, 0.25), (0.5, 0.75))), (dark, ((0.25, 0.5), (0.75, 1.0)))):
        x = mesh.vertices[mesh.faces].mean(axis=1)[:, 0]
        assert all(any(low < place < high for low, high in bands) for place in x)
    side = np.linspace(0.0, 1.0, 11)
    light, dark = chequered(heightfield(side, side, np.zeros((11, 11))), 0.2, together=2)
    squares = np.floor(dark.vertices[dark.faces].mean(axis=1)[:, :2] / 0.2).sum(axis=1)
    assert (squares % 2 == 1).all()
    assert len(light.faces) + len(dark.faces) == 200


def triangles(meshes: tuple[WorldMesh, ...]) -> np.ndarray:
    return np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])


BENT = (worm3d.Straight(1.0), worm3d.Bend(np.pi / 2.0, 0.5, "left"), worm3d.Straight(1.0))


def test_a_pipe_is_drawn_around_the_worm_in_bands_that_one_can_see_through() -> None:
    world = worm3d.Pipe(worm3d.Centreline.of(BENT), 0.1)
    around = Window(world.centreline.at(np.linspace(0.2, 1.2, 30))[0], 1.0)
    seen = scenery(world, around)
    assert {mesh.opacity for mesh in seen.meshes} == {0.3}
    assert seen.centreline is not None
    assert_allclose(world.distance(seen.centreline), 0.1, atol=1e-9)
    away = np.abs(world.distance(triangles(seen.meshes).reshape(-1, 3)))
    # Where a bend begins a ring leans by a quarter of the angle between two rings, 0.01.
    assert away.max() < 0.1 * 0.01
    assert np.median(away) < 1e-9, "elsewhere corners lie on the wall"
    along = world.along(seen.centreline)
    assert along[0] <= 0.2 - 1.0
    assert along[-1] >= 1.2 + 1.0


def test_walls_that_close_a_pipe_are_drawn() -> None:
    world = worm3d.Pipe(worm3d.Centreline.of(BENT), 0.1, start_wall=True)
    seen = scenery(world, Window(world.centreline.at(np.linspace(0.2, 1.2, 30))[0], 1.0))
    *_, wall = seen.meshes
    assert wall.name == "end of the pipe"
    assert_allclose(world.distance(wall.vertices), 0.0, atol=1e-12)
    assert_allclose(corners(seen.meshes)[:, 0].min(), 0.0, atol=1e-12)


def test_of_worlds_that_meet_only_the_common_walls_are_drawn() -> None:
    world = worm3d.slope_into_pipe(0.4, 1.0, [worm3d.Straight(2.0)], 0.1)
    seen = scenery(world, AROUND)
    middles = triangles(seen.meshes).mean(axis=1)
    assert np.abs(world.distance(middles)).max() < 0.01
    for part in world.worlds:
        assert part.distance(middles).max() < 0.01, "nothing stands in free space"
    assert seen.centreline is not None
    areas = [len(mesh.faces) for mesh in seen.meshes]
    assert min(areas) > 0
    assert len(areas) == 4


def test_terrain_is_drawn_as_it_is() -> None:
    world = worm3d.Heightfield.rubble(3.0, 2.0, 0.05, height=0.04, size=0.1, seed=3)
    seen = scenery(world, AROUND).meshes
    assert_allclose(corners(seen)[:, 2], world.height(corners(seen)[:, :2]), atol=1e-12)
    assert corners(seen)[:, 0].max() >= 2.7


@pytest.mark.parametrize(("solid", "opacity", "count"), [("inside", 1.0, 2), ("outside", 0.35, 1)])
def test_a_mesh_is_drawn_by_its_own_triangles(tmp_path: Path, solid: str, opacity: float, count: int) -> None:
    box = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    box.export(tmp_path / "box.stl")
    world = worm3d.Mesh(tmp_path / "box.stl", units="m", solid=solid, cell=0.1)  # type: ignore[arg-type]
    seen = scenery(world, AROUND).meshes
    assert len(seen) == count
    assert {mesh.opacity for mesh in seen} == {opacity}
    assert sum(len(mesh.faces) for mesh in seen) == 12


def test_a_mesh_of_too_many_triangles_is_drawn_from_its_distance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trimesh.creation.box(extents=(1.0, 1.0, 0.4)).export(tmp_path / "box.stl")
    world = worm3d.Mesh(tmp_path / "box.stl", units="m", cell=0.05)
    monkeypatch.setattr("worm3d.worlds.scenery.MOST_FACES", 10)
    seen = scenery(world, AROUND).meshes
    assert [mesh.name for mesh in seen] == ["terrain", "terrain, dark"]
    assert np.abs(world.distance(triangles(seen).reshape(-1, 3))).max() < 0.01


def test_lines_are_drawn_on_the_ground_below_them() -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform([0.2, -0.5, 0.0], [1.5, 0.5, 0.1], (50, 3))
    for slope in (0.0, 0.3, 1.0):
        world = worm3d.Plane(slope=slope, heading=0.4)
        above = places + np.outer(np.tan(slope) * (places[:, :2] @ [np.cos(0.4), np.sin(0.4)]), [0.0, 0.0, 1.0])
        lowered = on_ground(world, above, 1.0)
        assert_allclose(lowered[:, :2], above[:, :2], atol=0.0)
        assert_allclose(world.distance(lowered), 0.0, atol=1e-4)
        raised = on_ground(world, above - [0.0, 0.0, 0.2], 1.0, above=0.01)
        assert_allclose(raised[:, 2] - lowered[:, 2], 0.01, atol=1e-3, err_msg="what is below comes up")


def test_lines_in_a_pipe_lie_on_its_bottom_and_stay_where_there_is_none() -> None:
    line = worm3d.Centreline.through([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    along = np.column_stack([np.linspace(0.2, 1.8, 9), np.full(9, 0.03), np.full(9, -0.02)])
    lowered = on_ground(worm3d.Pipe(line, radius=0.1), along, 1.0)
    assert_allclose(lowered[:, 2], -np.sqrt(0.1**2 - 0.03**2), atol=2e-4)
    upright = worm3d.Centreline.through([(0.0, 0.0, 0.0), (0.0, 0.0, 2.0)])
    climbing = np.column_stack([np.full(9, 0.03), np.zeros(9), np.linspace(0.2, 1.8, 9)])
    assert_array_equal(on_ground(worm3d.Pipe(upright, radius=0.1), climbing, 1.0), climbing)
    assert_array_equal(on_ground(None, climbing, 1.0), climbing)
    far = climbing + np.array([0.0, 0.0, 5.0])
    assert_array_equal(on_ground(worm3d.Plane(), far, 1.0), far)


def test_lines_on_rubble_follow_the_stones() -> None:
    field = worm3d.Heightfield.rubble(2.0, 1.0, 0.02, height=0.02, size=0.15)
    places = np.column_stack([np.linspace(0.4, 1.6, 30), np.full(30, 0.1), np.full(30, 0.08)])
    lowered = on_ground(field, places, 1.0)
    assert_allclose(lowered[:, 2], field.height(lowered[:, :2]), atol=2e-4)
    assert np.ptp(lowered[:, 2]) > 0.002
