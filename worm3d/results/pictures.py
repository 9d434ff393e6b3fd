"""Pictures of runs: a result is converted to plain arrays, and `worm3d.viewer` draws a page, figure, movie or mesh.

worm3d.draw(result, "viewer.html")  # or .png, .gif, .mp4, .glb
worm3d.show(result)                 # at the end of a notebook cell
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.physics.worm import Worm
from worm3d.recorded.finished import FinishedRun
from worm3d.recorded.series import Recorded
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import spelled
from worm3d.viewer import Frames
from worm3d.viewer.frames import instants
from worm3d.viewer.shapes import rings_mesh
from worm3d.viewer.world import WorldMesh
from worm3d.worlds import World
from worm3d.worlds.scenery import Window, on_ground, scenery

if TYPE_CHECKING:
    from worm3d.viewer.html import NotebookView


FPS = 25.0
"""Largest number of frames in a second of a page or a movie, and of the live view at speed 1."""

PATH_ABOVE, TRAIL_ABOVE = 0.004, 0.008
"""Heights above the ground at which the reference path and the trail of the centre of mass are drawn [body lengths]."""

SERIES = (
    *("time", "joints", "points", "directors", "chamber_length", "com", "contact_force"),
    *("normal_load", "slip", "joint_load", "joint_slip"),
)
"""Series of a result that pictures use."""

ENDINGS = (".html", ".png", ".gif", ".mp4", ".glb")


@spelled
def draw(
    result: FinishedRun,
    path: str | Path,
    *,
    at: float | None = None,
    fps: float | None = None,
    skin: bool = True,
    reference: ArrayLike | None = None,
    horizon: ArrayLike | None = None,
    title: str = "worm3d",
) -> None:
    """Write a picture of a run. The ending of the file name sets the format.

    An `.html` file is a page that plays the run in any browser, without a network. A `.png` file shows the worm from
    the side and from above at an instant. Files with the endings `.gif` and `.mp4` (needs ffmpeg) are movies of these
    views in real time. A `.glb` file is a mesh of worm and world at an instant.

    Parameters
    ----------
    result : Result
    path : str or Path
        File to write. An existing file is replaced.
    at : float, optional
        Time of a `.png` or `.glb` picture [s]. The default is the end of the run.
    fps : float, optional
        Frames per second of a page or movie. The default is 25, or fewer for long runs of worms with many segments.
    skin : bool
        Whether a page shows the worm with a smooth skin. Without the skin, a page shows chambers and links.
    reference : array_like, shape (P, 3), optional
        Path that the worm had to follow [m]. It is drawn on the ground below, if there is any.
    horizon : array_like, shape (T, H, 3), optional
        Points through which a controller expected the centre of mass to move, at each instant of the result [m]. The
        points are also drawn on the ground.
    title : str
        Title of a page.

    Raises
    ------
    ValueError
        The ending is unknown, or `at` is outside the run.
    FileNotFoundError
        The folder does not exist, or ffmpeg is missing for an MP4 file.
    """
    arguments.instance("result", result, Recorded, "a worm3d.Result")
    arguments.instance("path", path, str | PathLike, "the path of a file")
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"picture file: got {path.name!r}, the ending must be one of {', '.join(ENDINGS)}")
    shown = frames_of(result, fps=fps, at=at, reference=reference, horizon=horizon)
    write(shown, path, at=at, skin=skin, title=title)


@spelled
def show(
    result: FinishedRun,
    *,
    fps: float | None = None,
    skin: bool = True,
    reference: ArrayLike | None = None,
    horizon: ArrayLike | None = None,
    height: int = 520,
) -> NotebookView:
    """Return the page of a run as the value of a notebook cell. Its method `open` shows the page in a browser instead.

    Parameters
    ----------
    result : Result
    fps, skin, reference, horizon
        As in `draw`.
    height : int
        Height of the page in the notebook [pixels].
    """
    from worm3d.viewer.html import NotebookView, html

    frames = frames_of(result, fps=fps, reference=reference, horizon=horizon)
    return NotebookView(html(frames, skin=skin), height)


def write(frames: Frames, path: Path, *, at: float | None = None, skin: bool = True, title: str = "worm3d") -> None:
    """Write a picture in the format of the file ending, one of `ENDINGS`. Parameters and errors as in `draw`."""
    ending = path.suffix.lower()
    if ending == ".html":
        from worm3d.viewer import write_html

        write_html(frames, path, skin=skin, title=title)
    elif ending == ".png":
        from worm3d.viewer.figure import figure

        figure(frames, nearest(frames.time, at))[0].savefig(path, dpi=150)
    elif ending == ".glb":
        from worm3d.viewer.meshes import glb

        path.write_bytes(glb(frames, nearest(frames.time, at)))
    else:
        from worm3d.viewer.movie import write_movie

        fps = 1.0 / float(np.median(np.diff(frames.time))) if len(frames) > 1 else FPS
        write_movie(frames, path, fps=fps)


def nearest(time: FloatArray, at: float | None) -> int:
    """Return the index of the instant nearest to `at` [s]. If `at` is None, return the last index.

    Raises
    ------
    ValueError
        `at` is before the start or after the end of the run.
    """
    if at is None:
        return len(time) - 1
    slack = 1e-9 * max(1.0, abs(float(time[-1])))
    if not time[0] - slack <= at <= time[-1] + slack:
        raise ValueError(f"at: got {at:g} s, must be between {time[0]:g} and {time[-1]:g} s, where the run is known")
    return int(np.abs(time - at).argmin())


def frames_of(result: FinishedRun, **shown: Any) -> Frames:
    """Return a result as plain arrays for pictures. `shown` are further arguments of `arrays`."""
    series = {name: getattr(result, name) for name in SERIES}
    return arrays(series, result.worm, result.world, result.period, **shown)


def arrays(
    series: Mapping[str, FloatArray],
    worm: Worm,
    world: World | None,
    period: float | None,
    *,
    fps: float | None = None,
    at: float | None = None,
    reference: ArrayLike | None = None,
    horizon: ArrayLike | None = None,
    reference_speed: ArrayLike | None = None,
    obstacles: Sequence[FloatArray] = (),
) -> Frames:
    """Return the series of a finished or unfinished run as plain arrays for pictures.

    Parameters that are not listed here are the same as in `draw`.

    Parameters
    ----------
    series : mapping
        The arrays named in `SERIES`, as in `Result`.
    period : float or None
        Period over which the displayed speed is averaged [s].
    reference_speed : array_like, shape (T,), optional
        Speed that a controller had to keep, at each instant of the run [m/s].
    obstacles : sequence of ndarray, shape (P, 3)
        Outlines of obstacles that a controller had to avoid [m]. They are drawn on the ground below, if there is any.
    """
    rows = rows_shown(series["time"], worm.segments, fps, at)
    of = {name: series[name][rows] for name in SERIES}
    points, joints, com = of["points"], of["joints"], of["com"]
    places = np.concatenate([points[:, :, :6].reshape(-1, 3), joints.reshape(-1, 3)])
    trail = on_ground(world, com, worm.length, above=TRAIL_ABOVE * worm.length)
    around = scenery(world, Window(places, worm.length))

    def lowered(places: ArrayLike) -> FloatArray:
        return on_ground(world, np.asarray(places, dtype=float), worm.length, above=PATH_ABOVE * worm.length)

    return Frames(
        time=of["time"],
        joints=joints,
        apexes=points[:, :, :6],
        directors=of["directors"],
        chamber_strain=of["chamber_length"] / worm.l0 - 1.0,
        chamber_length=None if worm.segment.has_links else of["chamber_length"],
        faces=points[:, :, 6:],
        face_radius=worm.segment.face_radius(worm)[[0, -1]] if worm.end_faces else None,
        contact_force=of["contact_force"],
        anchored=anchored(of),
        com=com,
        trail=None if np.array_equal(trail, com) else trail,
        reference_speed=None if reference_speed is None else np.asarray(reference_speed, dtype=float)[rows],
        period=period,
        path=None if reference is None else lowered(reference),
        centreline=around.centreline,
        horizon=None if horizon is None else lowered(np.asarray(horizon, dtype=float)[rows]),
        world=(*around.meshes, *_prisms([lowered(each) for each in obstacles], worm)),
    )


def _prisms(feet: Sequence[FloatArray], worm: Worm) -> list[WorldMesh]:
    """Return obstacles as prisms over outlines of shape (P, 3) [m], as high as the worm at rest."""
    height = np.array([0.0, 0.0, 2.0 * float(np.max(worm.half_height))])
    meshes = [rings_mesh(np.array([foot, foot + height])) for foot in feet]
    return [WorldMesh(f"obstacle {k}", *mesh, colour=(1.0, 0.5, 0.05), opacity=0.5) for k, mesh in enumerate(meshes)]


def rows_shown(time: FloatArray, segments: int, fps: float | None, at: float | None) -> list[int]:
    """Return the indices of the instants to show, including the instant nearest to `at`."""
    if len(time) < 2:
        return list(range(len(time)))
    if fps is None:
        # A page has at most 12 000 segments in all frames together.
        fps = min(FPS, 12_000 / segments / float(time[-1] - time[0]))
    return sorted({*instants(time, fps), nearest(time, at)})


def anchored(series: Mapping[str, FloatArray]) -> NDArray[np.bool_]:
    """Return whether each contact point sticks, shape (T, N, 8).

    A contact point sticks if it carries load and has not slipped since the previous row.
    """
    of_apexes = (series["normal_load"] > 0.0) & (series["slip"] == 0.0)
    of_joints = (series["joint_load"] > 0.0) & (series["joint_slip"] == 0.0)
    faces = np.zeros((*of_apexes.shape[:2], 2), dtype=bool)
    faces[:, :, 0], faces[:, -1, 1] = of_joints[:, :-1], of_joints[:, -1]
    return np.concatenate([of_apexes, faces], axis=2)
