"""Worlds are drawn where the worm meets them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from worm3d.scenery import Window, scenery, tile_size
from worm3d.viewer import WorldMesh, banded_pipe, chequered, heightfield
from worm3d.worlds import World

WORM = np.array([[0.3, -0.2, 0.1], [1.7, 0.4, 0.3], [1.0, 1.1, 0.2]])
AROUND = Window(WORM, body_length=1.0)


class Waves:
    """A world that no picture knows: from above it is a landscape, upside down a ceiling."""

    def __init__(self, turned: float = 1.0) -> None:
        self.turned = turned

    def kernel(self) -> None:
        """Not needed for a picture."""

    def pressing(self, gravity: object) -> None:
        """Not needed for a picture."""

    def placed(self, *_: object) -> None:
        """Not needed for a picture."""

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
        middles = mesh.vertices.reshape(-1, 4, 3).mean(axis=1)
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
