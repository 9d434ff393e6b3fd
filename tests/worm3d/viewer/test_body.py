"""Linkages, chambers and skin are drawn where the joints and apexes say."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from worm3d.viewer import Frames, piece, pieces, plane, shapes
from worm3d.viewer.body import Body
from worm3d.viewer.camera import azimuths, floor, inside
from worm3d.viewer.piece import HIDDEN
from worm3d.viewer.pieces import Scales
from worm3d.viewer.shapes import tube
from worm3d.viewer.skin import RING_CORNERS, RINGS, Skin

LINK = np.sqrt(0.05**2 + (1.0 / 12.0) ** 2)


def test_links_are_rigid_and_meet_the_apexes(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl()
    bars = Body.of(frames).links(frames)
    assert len(bars.names) == 12 * 6 + 7
    assert len(set(bars.names)) == len(bars.names)
    links = [k for k, name in enumerate(bars.names) if "joint" not in name]
    assert_allclose(np.linalg.norm(bars.end - bars.start, axis=2)[:, links], LINK, rtol=1e-12)
    where = bars.names.index("03-R-above-head")
    assert_allclose(bars.end[:, where], frames.apexes[:, 3, 4])
    rods = [k for k, name in enumerate(bars.names) if "joint" in name]
    assert_allclose(0.5 * (bars.start + bars.end)[:, rods], frames.joints, atol=1e-12)
    assert_allclose(bars.length[rods], 2 * 0.03)


def test_lengths_of_the_chambers_follow_from_their_heights(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=2.0)
    length = Body.of(frames).length
    assert_allclose(length, (1.0 + frames.chamber_strain) / 6.0, rtol=1e-12)
    assert (length[..., 0] < length[..., 1]).all(), "a worm that turns left is shorter on the left"


def test_a_planar_worm_has_no_crossbars(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=1.0, turn=0.0, offset=0.0, segments=3)
    assert len(Body.of(frames).links(frames).names) == 36


def test_bars_and_arrows_point_along_their_direction() -> None:
    rng = np.random.default_rng(6)
    direction = np.concatenate([rng.normal(size=(50, 3)), np.eye(3), -np.eye(3)])
    turn = piece.y_onto(direction, piece.any_normal(direction))
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    assert_allclose(turn[..., 1], unit, atol=1e-12)
    assert_allclose(np.linalg.det(turn), 1.0)


def test_pieces_lie_where_the_body_is(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=1.0)
    parts = {part.path: part for part in pieces.worm(frames, Scales.of(frames))}
    bar = parts["links/02-L-below-tail"]
    end = bar.matrix(10) @ [0.0, 0.5 * LINK, 0.0, 1.0]
    assert_allclose(end[:3], frames.apexes[10, 2, 0], atol=1e-12)
    ball = parts["chambers/02-R"]
    matrix = ball.matrix(10)
    along = matrix[:3, 1] / np.linalg.norm(matrix[:3, 1])
    tangent = frames.joints[10, 3] - frames.joints[10, 2]
    assert_allclose(along, tangent / np.linalg.norm(tangent), atol=1e-12)
    assert_allclose(matrix[:3, 3], frames.apexes[10, 2, 3:5].mean(axis=0), atol=1e-12)
    red, _, blue = ball.colour_at(10)
    assert red > blue, "a shorter chamber is red"


def test_arrows_have_the_length_of_their_force(make_crawl: Callable[..., Frames]) -> None:
    force = np.zeros((26, 6, 6, 3))
    force[:, 1, 3] = [0.0, 0.0, 0.05]
    force[:, 2, 0] = [0.1, 0.0, 0.0]
    force[3:, 2, 0] = 0.0
    frames = make_crawl(duration=1.0, contact_force=force, anchored=None)
    scales = Scales.of(frames)
    assert scales.force == 0.1
    arrows = {part.path: part for part in pieces.contact(frames, scales)}
    assert list(arrows) == ["forces/009", "forces/012"], "what never pushes has no arrow"
    tip = arrows["forces/012"].matrix(0) @ [0.0, 1.0, 0.0, 1.0]
    assert_allclose(tip[:3] - frames.apexes[0, 2, 0], [0.2, 0.0, 0.0], atol=1e-12)
    lower = arrows["forces/009"].matrix(0) @ [0.0, 1.0, 0.0, 1.0]
    assert_allclose(lower[:3] - frames.apexes[0, 1, 3], [0.0, 0.0, 0.1], atol=1e-12)
    assert arrows["forces/012"].scale is not None
    assert (arrows["forces/012"].scale[3:] == HIDDEN).all()


def test_the_trail_is_drawn_where_it_is_said_to_be(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=4.0)
    (free,) = pieces.way(frames)
    assert_allclose(free.mesh.vertices[:, 2], 0.09, atol=0.005)
    assert frames.com is not None
    (lowered,) = pieces.way(replace(frames, trail=frames.com * [1.0, 1.0, 0.0]))
    assert_allclose(lowered.mesh.vertices[:, 2], 0.0, atol=0.005)


def test_the_trail_counts_what_it_has_passed(make_crawl: Callable[..., Frames]) -> None:
    com = np.zeros((26, 3))
    com[10:, 0] = 0.1
    com[20:, 0] = 0.3
    kept, passed = pieces.trail_rings(com, 1.0)
    assert kept == [0, 10, 20]
    assert passed[9:21] == [1, *[2] * 10, 3]
    at_rest = make_crawl(duration=1.0, com=np.zeros((26, 3)))
    assert not pieces.way(at_rest), "no trail without motion"


def test_meshes_are_closed_and_seen_from_outside(make_crawl: Callable[..., Frames]) -> None:
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    cover = skin(make_crawl(duration=1.0)).piece(3)
    disc = shapes.disc(0.1, 0.01)
    solids = [shapes.ball(), shapes.capsule(1.0, 0.1), shapes.arrow(), disc, tube(line, 0.1), cover.mesh]
    for mesh in solids:
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight
        assert solid.volume > 0.0
    assert_allclose(trimesh.Trimesh(*shapes.ball(rings=60, sides=80)).volume, 4.0 / 3.0 * np.pi, rtol=0.01)


def skin(frames: Frames) -> Skin:
    return Skin.of(frames, Scales.of(frames).strain)


def test_the_skin_goes_through_the_apexes_and_the_rims_of_the_end_faces(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=2.0, face_radius=[0.05, 0.04])
    cover = skin(frames)
    for frame in (0, 20, 50):
        vertices = cover.vertices(frame)
        rings = vertices[:-2].reshape(-1, RING_CORNERS, 3)
        assert len(rings) == 12 * RINGS + 1
        outlines = rings[RINGS :: 2 * RINGS]
        apexes = frames.apexes[frame]
        half = RING_CORNERS // 2
        for corner, apex in ((0, 0), (half - 1, 1), (half, 4), (RING_CORNERS - 1, 3)):
            assert_allclose(outlines[:, corner], apexes[:, apex], atol=1e-12)
        away = np.linalg.norm(outlines[:, :, None] - apexes[:, None], axis=3).min(axis=1)
        assert away.max() < 0.01, "outward apexes lie between corners"
        for ring, end, radius, middle in ((0, 0, 0.05, -2), (-1, -1, 0.04, -1)):
            rim = rings[ring] - frames.joints[frame, end]
            assert_allclose(np.linalg.norm(rim, axis=1), radius, rtol=1e-12)
            assert_allclose(rim @ np.diff(frames.joints[frame], axis=0)[end], 0.0, atol=1e-12)
            assert_allclose(vertices[middle], frames.joints[frame, end], atol=1e-12)
        assert vertices[:, 2].min() >= apexes[..., 2].min() - 1e-12, "nothing is below what touches the ground"


def test_a_contracted_segment_is_wider_and_red_and_a_longer_chamber_is_blue(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=2.0, turn=0.0)
    cover, frame = skin(frames), 10
    most, least = (int(pick(frames.chamber_strain[frame, :, 0])) for pick in (np.argmin, np.argmax))
    rings = cover.vertices(frame)[:-2].reshape(-1, RING_CORNERS, 3)[RINGS :: 2 * RINGS]
    paint = cover.paint(frame)[:-2].reshape(-1, RING_CORNERS, 3)[RINGS :: 2 * RINGS]
    tall, wide = np.ptp(rings[..., 2], axis=1), np.ptp(rings[..., 1], axis=1)
    assert tall[most] > 1.2 * tall[least]
    assert wide[most] > 1.15 * wide[least]
    assert (paint[most, :, 0] - paint[most, :, 2] > 0.5).all()
    strain = np.array(frames.chamber_strain)
    strain[:, 2] = 0.4, -0.4
    left, right = np.split(
        skin(replace(frames, chamber_strain=strain)).paint(0)[5 * RINGS * RING_CORNERS :][:RING_CORNERS], 2
    )
    assert (left[:, 2] > left[:, 0]).all()
    assert (right[:, 0] > right[:, 2]).all()


def test_the_discs_stand_where_the_worm_ends(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=1.0, face_radius=[0.05, 0.04])
    parts = {part.path: part for part in pieces.worm(frames, Scales.of(frames))}
    for name, end, radius, outwards in (("tail", 0, 0.05, -1.0), ("head", -1, 0.04, 1.0)):
        disc = parts[f"faces/{name}"]
        matrix = disc.matrix(7)
        assert_allclose(matrix[:3, 3], frames.joints[7, end])
        tangent = np.diff(frames.joints[7], axis=0)[end]
        assert_allclose(matrix[:3, 1], outwards * tangent / np.linalg.norm(tangent), atol=1e-12)
        assert_allclose(np.linalg.norm(disc.mesh.vertices[:, [0, 2]], axis=1).max(), radius)
        assert_allclose(disc.mesh.vertices[:, 1].min(), 0.0, atol=1e-15)
    assert not [
        path for path in {p.path for p in pieces.worm(make_crawl(duration=1.0), Scales(0.1, 1.0))} if "faces" in path
    ]


def test_the_skin_encloses_the_chambers_and_moves_with_them(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=2.0)
    cover = skin(frames)
    last = cover.vertices(len(frames) - 1)[cover.faces]
    chambers = frames.apexes[-1].reshape(6, 2, 3, 3)[:, :, :2].mean(axis=2).reshape(-1, 3)
    assert_allclose(windings(last, chambers), 1.0, atol=1e-9)
    assert_allclose(windings(last, chambers + np.array([0.0, 0.0, 0.3])), 0.0, atol=1e-9)


def windings(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how often a closed surface goes around each point, by solid angles."""
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    sizes = [np.linalg.norm(x, axis=2) for x in (a, b, c)]
    volume = np.sum(a * np.cross(b, c), axis=2)
    below = sizes[0] * sizes[1] * sizes[2]
    for (x, y), size in zip(((a, b), (b, c), (c, a)), (sizes[2], sizes[0], sizes[1]), strict=True):
        below = below + np.sum(x * y, axis=2) * size
    return np.asarray(2.0 * np.arctan2(volume, below).sum(axis=1) / (4.0 * np.pi))


def test_headings_are_those_of_the_chord_without_its_sway(make_crawl: Callable[..., Frames]) -> None:
    straight = make_crawl(duration=6.0, turn=0.0, heading=0.4)
    assert_allclose(azimuths(straight), 0.4, atol=1e-12)
    swaying = make_crawl(duration=6.0, heading=0.4)
    chord = swaying.joints[:, -1] - swaying.joints[:, 0]
    sway = np.arctan2(chord[:, 1], chord[:, 0])
    assert np.ptp(sway) > 0.01
    assert np.ptp(azimuths(swaying)[30:-30]) < 0.05 * np.ptp(sway)
    around = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    left = {name: getattr(straight, name) @ around for name in ("joints", "apexes", "directors")}
    assert_allclose(azimuths(replace(straight, com=None, **left)), 0.4 + np.pi / 2, atol=1e-12)
    upright = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    level = make_crawl(duration=6.0, turn=0.0)
    up = {name: getattr(level, name) @ upright for name in ("joints", "apexes", "directors")}
    assert_allclose(azimuths(replace(level, com=None, **up)), 0.0, atol=1e-12)


def test_the_floor_is_the_plane_through_what_one_cannot_see_through() -> None:
    tilted = plane(np.array([0.0, 0.0, 0.3]), np.array([-0.1, 0.2, 1.0]), length=2.0, width=1.0, tile=0.1)
    assert_allclose(floor(tilted), [0.3, 0.1, -0.2], atol=1e-12)
    clear = plane(np.zeros(3), np.array([0.0, 0.0, 1.0]), length=2.0, width=1.0, tile=0.1, opacity=0.4)
    assert floor(clear) is None
    assert floor(()) is None


def test_the_camera_inside_the_pipe_stays_on_its_centre_line(make_crawl: Callable[..., Frames]) -> None:
    s = np.linspace(-0.5, 1.2, 100)
    line = np.stack([s, 0.0 * s, 0.09 + 0.0 * s], axis=1)
    frames = make_crawl(duration=2.0, turn=0.0, centreline=line)
    eye, look = inside(frames)
    assert_allclose(look, frames.joints[:, -1])
    assert_allclose(
        eye[:, 0] - look[:, 0], 0.4 * frames.body_length, atol=1e-9, err_msg="beyond the end of the line, too"
    )
    assert_allclose(eye[:, 1], 0.0, atol=1e-9)
    elsewhere = make_crawl(duration=2.0, turn=0.0, centreline=line + np.array([0.0, 5.0, 0.0]))
    in_the_open = make_crawl(duration=2.0, turn=0.0)
    ahead = frames.body_length * np.array([0.9, 0.0, 0.3])
    assert_allclose(inside(in_the_open)[0], look + ahead, atol=1e-9)
    assert_allclose(inside(elsewhere)[0], look + ahead, atol=1e-9, err_msg="the worm is not in this pipe")
