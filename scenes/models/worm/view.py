"""Pictures of stored runs of the 3D worm: the browser page, the movie, a side and a top view, and a mesh."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scenes import models
from scenes.language import own
from scenes.language.errors import SceneError
from scenes.language.mistakes import report, schema_mistakes
from scenes.language.reading import trusted
from scenes.language.schema import with_own_defaults
from scenes.language.toml import key_lines
from scenes.models.base import MOVIE_S
from scenes.models.worlds.build import world_of
from scenes.models.worm.build import worm_of
from scenes.models.worm.schema import AnyWormScene
from scenes.records.record import Record
from worm3d.results import pictures
from worm3d.values.named import is_own
from worm3d.worlds import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from worm3d.viewer import Frames


SEEN = ("model", "worm", "world")
"""Sections that are needed to draw a worm. Of the other sections, only the period of the gait is needed."""

SHOWN_SECTIONS = ("world", "gait", "reference")
"""Sections that are kept although they name a user's own part, since the record contains the data to draw the part."""


def scene_of(record: Record) -> AnyWormScene:
    """Return the scene of a record without the parameters of the user's own parts, which pictures do not need.

    No module of the user is imported. Sections with parts that are unknown without such an import get the defaults.

    Raises
    ------
    SceneError
        If a section that must be drawn has an unknown part.
    """
    schema = models.get(record.model).schema
    written = own.without(schema, tomllib.loads(record.scene), but=SHOWN_SECTIONS)
    if mistakes := schema_mistakes(schema, written):
        unknown = {mistake.path[0] for mistake in mistakes}
        if unknown & {*SEEN}:
            reason = "made with parts that are not known here; modules of one's own are to be imported before"
            raise SceneError(f"{record.name}: {reason}", *report(mistakes, key_lines(record.scene), []))
        period = {key: value for key, value in written.get("gait", {}).items() if key == "period_s"}
        written = {name: value for name, value in written.items() if name not in unknown}
        written = with_own_defaults(schema, {**written, "gait": period} if "gait" in unknown else written)
    scene: AnyWormScene = trusted(schema, written)
    return scene


def world_seen(record: Record, scene: AnyWormScene) -> World | None:
    """Return the world of a stored run, or None without a world.

    A user's own world is read from the record, so that the user's module is not imported.
    """
    from worm3d.results.files import world_of as stored  # imports the libraries of files

    if not is_own(scene.world.kind):
        return world_of(scene.world)
    world: World | None = stored(record.run, record.parts)
    return world


def frames_of(
    record: Record, *, fps: float | None = None, at: float | None = None, until: float | None = None
) -> Frames:
    """Return the run of a record as plain arrays for pictures.

    Parameters
    ----------
    fps, at : float, optional
        The same as in `worm3d.results.pictures.frames_of`.
    until : float, optional
        The run is left out after this time [s].
    """
    scene = scene_of(record)
    rows = slice(None) if until is None else record["time"] <= until
    series = {name: record[name][rows] for name in pictures.SERIES}
    worm, world = worm_of(scene), world_seen(record, scene)
    beside = models.get(record.model).beside
    assert beside is not None
    return pictures.arrays(series, worm, world, fps=fps, at=at, **beside(scene, record, rows))


def view(record: Record, path: Path, *, skin: bool = True) -> None:
    """Write the page that plays a record in a browser.

    With `skin`, the worm has a smooth skin; otherwise its chambers and links are drawn.
    """
    from worm3d.viewer import write_html

    write_html(frames_of(record), path, skin=skin, title=record.title)


def side_and_top(record: Record) -> tuple[Figure, Axes]:
    """Draw the worm at the end of the run from the side and from above, with the trail of its centre of mass."""
    from worm3d.viewer.figure import figure

    drawn, (_, top) = figure(frames_of(record), -1)
    return drawn, top


def mesh(record: Record, at: float | None) -> bytes:
    """Return the content of a GLB file with the worm and the world at a time [s].

    None means the end of the run. Raise ValueError for a time outside the run.
    """
    from worm3d.viewer.meshes import glb

    frames = frames_of(record, at=at)
    return glb(frames, pictures.nearest(frames.time, at))


@dataclass(frozen=True)
class RunMovie:
    """A movie of a record."""

    record: Record

    def save(self, path: Path, fps: int = 20) -> None:
        """Write a GIF or MP4 file; raise FileNotFoundError if ffmpeg is needed and missing."""
        from worm3d.viewer.movie import write_movie

        write_movie(frames_of(self.record, fps=fps, until=MOVIE_S), path, fps=fps)
