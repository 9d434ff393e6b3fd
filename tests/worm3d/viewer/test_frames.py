"""Frames take plain arrays and refuse what cannot be shown, in one clear sentence."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d.viewer import Frames, WorldMesh, heightfield, pipe, plane
from worm3d.viewer.frames import instants


def test_arrays_are_copies_that_nobody_can_change(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=1.0)
    time = np.array(frames.time)
    again = replace(frames, time=time)
    time[0] = -1.0
    assert again.time[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        again.joints[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    ("name", "shape", "sentence"),
    [
        ("joints", (3, 6, 3), r"joints: got shape \(3, 6, 3\), must be \(11, 7, 3\)"),
        ("directors", (11, 3), r"directors: got shape \(11, 3\), must be \(11, N, 3\)"),
        ("apexes", (11, 6, 3, 6), r"apexes: got shape \(11, 6, 3, 6\), must be \(11, 6, 6, 3\)"),
        ("chamber_strain", (11, 6), r"chamber_strain: got shape"),
        ("contact_force", (11, 6, 3), r"contact_force: got shape"),
        ("com", (11, 2), r"com: got shape \(11, 2\), must be \(11, 3\)"),
        ("horizon", (10, 4, 3), r"horizon: got shape \(10, 4, 3\), must be \(11, H, 3\)"),
        ("path", (4, 2), r"path: got shape \(4, 2\), must be \(P, 3\)"),
        ("path", (1, 3), r"path: got shape \(1, 3\), must be \(P, 3\) with P of at least 2"),
        ("faces", (11, 6, 3), r"faces: got shape \(11, 6, 3\), must be \(11, 6, 2, 3\)"),
        ("faces", (11, 6, 2, 3), r"contact_force: got shape \(11, 6, 6, 3\), must be \(11, 6, 8, 3\)"),
        ("centreline", (1, 3), r"centreline: got shape \(1, 3\), must be \(C, 3\) with C of at least 2"),
    ],
)
def test_a_wrong_shape_is_named(
    make_crawl: Callable[..., Frames], name: str, shape: tuple[int, ...], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        make_crawl(duration=1.0, fps=10.0, **{name: np.zeros(shape)})


@pytest.mark.parametrize("name", ["time", "joints", "apexes", "directors", "chamber_strain", "contact_force", "com"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(make_crawl: Callable[..., Frames], name: str, bad: float) -> None:
    frames = make_crawl(duration=1.0, fps=10.0)
    array = np.array(getattr(frames, name))
    array.reshape(11, -1)[7, -1] = bad
    with pytest.raises(ValueError, match=rf"{name}: got {bad}, every value must be finite"):
        replace(frames, **{name: array})


def test_what_is_not_numbers_is_refused(make_crawl: Callable[..., Frames]) -> None:
    with pytest.raises(ValueError, match=r"com: got 'here', must be numbers"):
        make_crawl(duration=1.0, com="here")


def test_a_period_is_above_0(make_crawl: Callable[..., Frames]) -> None:
    with pytest.raises(ValueError, match=r"period: got 0.0 s, must be finite and above 0"):
        make_crawl(duration=1.0, period=0.0)


def test_the_planar_worm_has_coinciding_sides(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=1.0, turn=0.0, offset=0.0)
    assert_allclose(frames.apexes[:, :, 0], frames.apexes[:, :, 3])


def test_speed_is_averaged_over_the_period(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=8.0, period=2.0)
    assert frames.speed is not None
    assert_allclose(frames.speed[50:-50], 0.05, rtol=1e-6)
    rocking = replace(frames, period=None).speed
    assert rocking is not None
    assert np.ptp(rocking) > 0.02
    assert replace(frames, com=None).speed is None


def test_heading_is_horizontal_and_left_is_left(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=1.0, turn=0.0, heading=np.pi / 2)
    assert_allclose(frames.axes, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_taken_frames_are_spread_evenly_and_keep_both_ends(make_crawl: Callable[..., Frames]) -> None:
    time = make_crawl(duration=2.0, fps=100.0).time
    assert_allclose(np.diff(time[instants(time, 25.0)]), 0.04)
    assert len(instants(time, 1e6)) == len(time)
    assert instants(np.array([0.0, 0.5, 0.6]), 1.0) == [0, 2]
    assert instants(np.array([1.0]), 25.0) == [0]
    for fps in (0.0, np.nan):
        with pytest.raises(ValueError, match=r"fps: got .*, must be a finite number above 0"):
            instants(time, fps)


def test_a_bad_world_mesh_is_named() -> None:
    with pytest.raises(ValueError, match=r"world mesh 'a': vertices: got nan"):
        WorldMesh("a", np.eye(3) * np.nan, np.array([[0, 1, 2]]))


def test_a_plane_lies_where_it_should_and_faces_up() -> None:
    normal = np.array([-1.0, 0.0, 2.0]) / np.sqrt(5.0)
    tiles = plane(np.array([0.0, 0.0, 0.3]), normal, length=1.0, width=0.5, tile=0.1)
    assert sum(len(mesh.faces) for mesh in tiles) == 2 * 10 * 5
    for mesh in tiles:
        assert_allclose((mesh.vertices - [0.0, 0.0, 0.3]) @ normal, 0.0, atol=1e-12)
        corners = mesh.vertices[mesh.faces]
        assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal > 0.0).all()
    assert_allclose(plane(np.zeros(3), np.array([1.0, 0, 0]), length=1, width=1, tile=1)[0].vertices[:, 0], 0.0)


def test_a_pipe_keeps_its_radius_and_a_heightfield_its_heights() -> None:
    s = np.linspace(0.0, 1.0, 20)
    line = np.stack([np.sin(s), 1.0 - np.cos(s), 0.0 * s], axis=1)
    wall = pipe(line, 0.1 + 0.05 * s, sides=16)
    away = np.linalg.norm(wall.vertices.reshape(20, 16, 3) - line[:, None], axis=2)
    assert_allclose(away, np.repeat(0.1 + 0.05 * s[:, None], 16, axis=1))
    x, y = np.linspace(0, 1, 5), np.linspace(0, 2, 4)
    z = x[:, None] + y**2
    assert_allclose(heightfield(x, y, z).vertices[:, 2], z.ravel())
    with pytest.raises(ValueError, match=r"heightfield: z: got shape \(4, 5\), must be \(5, 4\)"):
        heightfield(x, y, z.T)
