"""A groove: exact distances, normals and curvature; a worm at rest in it and crawling along it; its keys in a scene."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import TravellingWave
from scenes.models.loading import load_scene
from scenes.models.worlds.build import world_of
from worm3d import Groove, Plane, State, Status, Worm
from worm3d.worlds.kernels import looked_up

GROOVE = Groove(wall=0.6, bottom=0.15, heading=0.4, grip=0.7)
ALONG, LEFT = np.array([np.cos(0.4), np.sin(0.4)]), np.array([-np.sin(0.4), np.cos(0.4)])


def around(seed: int, height: tuple[float, float] = (-0.02, 0.12)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y, g = rng.uniform(-1, 1, 200), rng.uniform(-0.4, 0.4, 200), rng.uniform(*height, 200)
    places = x[:, None] * ALONG + y[:, None] * LEFT
    return np.column_stack([places, GROOVE.height(places) + g])


def test_distances_are_those_to_the_nearest_place_of_the_surface() -> None:
    y = np.linspace(-1.2, 1.2, 60_001)
    surface = np.column_stack([y, GROOVE.height(y[:, None] * LEFT)])
    points = around(1)
    across = np.column_stack([points[:, :2] @ LEFT, points[:, 2]])
    nearest = np.array([np.linalg.norm(surface - place, axis=1).min() for place in across])
    above = points[:, 2] > GROOVE.height(points[:, :2])
    assert_allclose(GROOVE.distance(points), np.where(above, nearest, -nearest), rtol=0, atol=1e-5)


def test_normals_and_curvature_are_its_derivatives() -> None:
    points, h = around(2), 1e-6
    rows = looked_up(GROOVE.kernel(), points)
    q = np.column_stack([np.abs(points[:, :2] @ LEFT), points[:, 2] - GROOVE.bottom])
    edge = np.abs(q @ [np.cos(0.6), np.sin(0.6)]) < 1e-4  # there the curvature jumps
    moved = np.array(
        [[looked_up(GROOVE.kernel(), points[~edge] + side * h * axis) for side in (1, -1)] for axis in np.eye(3)]
    )
    slopes = (moved[:, 0] - moved[:, 1]) / (2.0 * h)
    assert_allclose(rows[1:4, ~edge], slopes[:, 0], rtol=0, atol=1e-7)
    H = rows[[[4, 5, 6], [5, 7, 8], [6, 8, 9]]][:, :, ~edge]
    assert_allclose(H, slopes[:, 1:4], rtol=0, atol=1e-5)
    assert_allclose(rows[10], 0.7)


def test_a_flat_one_is_a_plane() -> None:
    points = np.random.default_rng(3).uniform(-1, 1, (100, 3))
    assert_allclose(looked_up(Groove(wall=0.0).kernel(), points), looked_up(Plane().kernel(), points), atol=1e-12)


def test_a_worm_rests_in_it_and_crawls_along_it() -> None:
    world = Groove(wall=0.8, bottom=0.09, heading=0.4)
    state = State.straight(Worm(), world, (0.1, 0.0), 0.4)
    run = worm3d.simulate(Worm(), world, actuation=TravellingWave(), state=state, duration=8.0)
    assert run.status is Status.DONE
    assert run.distance > 0.1
    assert_allclose(run.com[:, :2] @ LEFT, run.com[0, :2] @ LEFT, atol=0.01, err_msg="it keeps to the bottom")
    aside = State.straight(Worm(), world, tuple(0.05 * LEFT), 0.4)
    slid = worm3d.simulate(Worm(), world, actuation=TravellingWave(), state=aside, duration=0.1)
    assert np.abs(slid.com[0, :2] @ LEFT) < 0.02, "before the run it slides down to the bottom"


def test_a_scene_has_it_by_name() -> None:
    keys = ["kind=groove", "wall_deg=30", "bottom_m=0.2", "heading_deg=90", "grip=0.5"]
    scene = load_scene("flat", [f"world.{key}" for key in keys])
    assert world_of(scene.settings.world) == Groove(np.deg2rad(30.0), 0.2, np.deg2rad(90.0), 0.5)


def test_bad_values_are_refused() -> None:
    with pytest.raises(ValueError, match=r"wall: got 2\.0 rad"):
        Groove(wall=2.0)
    with pytest.raises(ValueError, match=r"bottom: got 0\.0 m"):
        Groove(bottom=0.0)


def test_no_other_world_takes_its_name() -> None:
    with pytest.raises(ValueError, match=r"name: got 'groove', must be another than those of the worlds"):
        type("Ditch", (worm3d.World,), {}, name="groove")
    assert worm3d.WORLDS["groove"] is Groove
