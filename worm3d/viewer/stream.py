"""A run that goes on, as messages for its page: a scene, the surroundings, and a row of numbers for each frame.

The page of a finished run gets the motion of all pieces at once. Here it gets the same scene with the poses of one
frame, and then a row of `float32` for each frame. The scene says where each field of a row begins (`Stream.fields`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray
from worm3d.viewer import camera, colours, html, pieces, recorder
from worm3d.viewer.frames import Frames
from worm3d.viewer.packed import joined
from worm3d.viewer.piece import HIDDEN, Group, Piece
from worm3d.viewer.pieces import TRAIL_SIDES, Scales
from worm3d.viewer.shapes import ball, tube
from worm3d.viewer.skin import Skin
from worm3d.viewer.world import WorldMesh

HORIZON_POINTS = 16
"""Number of points that show the path that a controller expects. Half as many leave gaps of a fifth of the body
length, and double this number makes the row of a frame a tenth longer."""

TURN_TIME = 2.0
"""Time over which the heading for the cameras is averaged if the run has no period [s]. With half this value, the
picture sways with a wave of the default gait. With double, the camera turns visibly late."""


NO_GROUND = WorldMesh("ground", np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
"""A mesh that gives the scene a layer for the surroundings, which come later."""


class Stream:
    """The scene of a live page, and the rows of its frames.

    Parameters
    ----------
    frames : Frames
        The first frame. Its world and path are not part of the scene, but of `surroundings`.
    scales : Scales
        Scales of colours and of force arrows.
    values : mapping
        Further values of a row by name, each a sequence of numbers, as in `row`. The page plots them.
    controls : mapping, optional
        Controls of the page, as `worm3d.viewer.live.LiveView` describes.
    """

    def __init__(
        self, frames: Frames, scales: Scales, values: Mapping[str, ArrayLike], controls: Mapping[str, Any] | None = None
    ) -> None:
        self._scales, self._values, self._controls = scales, values, controls
        self._begin = replace(frames.take([0]), world=(), path=None)
        self._ahead = float(np.arctan2(*frames.heading[1::-1]))
        self._azimuth, self._time = self._ahead, float(frames.time[0])
        self._trail = self._place = np.asarray(frames.way[0] if frames.way is not None else frames.centre[0])
        self.fields: dict[str, tuple[int, int]] = {}
        """First place and number of values of each field of a row, by name."""
        for name, value in self._row(self._begin, values).items():
            first = sum(next(reversed(self.fields.values()), (0, 0)))
            self.fields[name] = first, value.size

    def scene(self) -> bytes:
        """Return the message with the scene."""
        frames, cover = self._begin, Skin.of(self._begin, self._scales.strain)
        point = np.stack([self._trail, self._trail + 1e-6])
        trail = Piece(path="trail/com", mesh=tube(point, 1e-6, sides=TRAIL_SIDES, capped=False), colour=colours.TRAIL)
        groups = self._moving(frames)
        parts = [*(part for group in groups for part in group.pieces()), trail, cover.piece()]
        marks = [*pieces.world((NO_GROUND,)), Piece(path="path/reference", mesh=ball(), colour=colours.REFERENCE_PATH)]
        scene = html.scene(frames, [*parts, *marks], self._scales, cover, recorder.ALL_BITS)
        live = {
            "fields": self.fields,
            "paths": {group.layer: group.paths for group in groups},
            "trail": {"ring": 0.005 * frames.body_length},
            "plots": [plot for plot in html.PLOTS if plot["name"] in self.fields],
            "controls": self._controls,
        }
        commands = [command for part in parts for command in recorder.place(part)]
        return _message(scene | live, [*recorder.stage(), *commands])

    def surroundings(self, world: Sequence[WorldMesh], path: FloatArray | None = None) -> bytes:
        """Return the message with the surroundings of the worm: the world, and the path of shape (P, 3) [m] to keep."""
        size = self._begin.body_length
        parts = pieces.world(tuple(world))
        if path is not None:
            mesh = tube(path, 0.005 * size)
            parts.append(Piece(path="path/reference", mesh=mesh, colour=colours.REFERENCE_PATH))
        commands = [command for part in parts for command in recorder.place(part)]
        ground = camera.floor(tuple(world))
        places = np.concatenate([mesh.vertices for mesh in world] or [np.zeros((1, 3))]) @ self._begin.axes.T
        about = {"floor": None if ground is None else ground.tolist(), "low": places.min(axis=0).tolist()}
        return _message(about | {"high": places.max(axis=0).tolist()}, commands)

    def row(self, frames: Frames, values: Mapping[str, ArrayLike]) -> bytes:
        """Return the row of the first frame of `frames`, with further values of the same names as at the start."""
        frames = frames if len(frames) == 1 else frames.take([0])
        chord, wait = frames.joints[0, -1] - frames.joints[0, 0], float(frames.time[0]) - self._time
        turned = np.remainder(np.arctan2(chord[1], chord[0]) - self._azimuth + np.pi, 2.0 * np.pi) - np.pi
        if np.hypot(*chord[:2]) > 0.05 * np.linalg.norm(chord):
            self._azimuth += turned * (1.0 - np.exp(-max(wait, 0.0) / (frames.period or TURN_TIME)))
        self._time = float(frames.time[0])
        parts = self._row(frames, values)
        if {name: part.size for name, part in parts.items()} != {name: size for name, (_, size) in self.fields.items()}:
            raise ValueError("live view: got a worm with other parts than at the start: open a new view")
        return np.concatenate(list(parts.values())).astype("<f4").tobytes()

    def _row(self, frames: Frames, values: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
        """Return the fields of a row, each as an array of one axis."""
        eye, look = camera.inside(frames)
        skin, speed = Skin.of(frames, self._scales.strain), frames.reference_speed
        fields: dict[str, ArrayLike] = {
            "time": frames.time,
            "centre": frames.centre,
            "eye": eye,
            "look": look,
            "azimuth": self._azimuth - self._ahead,
            "sections": skin.sections,
            "tint": skin.tint,
            "ring": self._ring(frames),
            **{name: value[0] for name, value in html.plotted(frames).items()},
            **({} if speed is None else {"reference_speed": speed}),
            **values,
        }
        for group in self._moving(frames):
            fields |= {f"{group.layer}.{name}": values[0] for name, values in group.poses.items() if name != "turn"}
            if "turn" in group.poses:
                fields[f"{group.layer}.quaternion"] = recorder.quaternions(group.poses["turn"][0])
        return {name: np.asarray(value, dtype=float).ravel() for name, value in fields.items()}

    def _ring(self, frames: Frames) -> FloatArray:
        """Return the corners of the trail's section at the present place, shape (TRAIL_SIDES, 3) [m]."""
        size = frames.body_length
        self._place = np.asarray(frames.way[0] if frames.way is not None else frames.centre[0])
        if np.linalg.norm(self._place - self._trail) > 0.01 * size:
            self._trail = self._place + (self._trail - self._place) * 0.3
        ahead = self._place - self._trail
        points = np.array([self._place - (ahead if ahead.any() else frames.axes[0]), self._place])
        return tube(points, 0.004 * size, sides=TRAIL_SIDES, capped=False).vertices[-TRAIL_SIDES:]

    def _moving(self, frames: Frames) -> list[Group]:
        """Return the pieces that move, the same in each frame."""
        return [*pieces.moving(frames, self._scales), _horizon(frames)]


def _horizon(frames: Frames) -> Group:
    """Return the points of the horizon, always the same number. They are hidden if there is no horizon."""
    known, size = frames.horizon, 0.009 * frames.body_length
    line = frames.centre if known is None else known[0]
    along = np.linspace(0.0, len(line) - 1.0, HORIZON_POINTS)
    places = np.stack([np.interp(along, np.arange(len(line)), x) for x in line.T], axis=1)
    scale = np.full((1, HORIZON_POINTS, 3), HIDDEN if known is None else size)
    meshes = dict.fromkeys((f"{k:03d}" for k in range(HORIZON_POINTS)), ball(rings=5, sides=8))
    return pieces.group("horizon", meshes, position=places[None], scale=scale)


def _message(about: Mapping[str, Any], commands: Iterable[recorder.Content]) -> bytes:
    """Return data, as by `html.with_arrays`, and commands of meshcat as one message."""
    return joined([joined(html.with_arrays(about)), joined(map(recorder.packed, commands))])
