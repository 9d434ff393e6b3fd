"""Writing the figures, the animation, the page and the mesh of a record to files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes import models
from scenes.language.errors import MissingPartError, SceneError
from scenes.language.sweep_section import SWEEP
from scenes.models.base import MOVIE_S, Model, Movie, Pictures
from scenes.records import measured
from scenes.records.folder import (
    ANIMATION,
    OVERVIEW,
    SUMMARY,
    TEMPORARY_PREFIX,
    VIEWER,
    remove,
    write_bytes,
    written_whole,
)
from scenes.records.record import Record
from scenes.running.overlays import measured_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def model_of(record: Record) -> Model[Any]:
    """Return the model that made a record.

    Raises
    ------
    SceneError
        If this version of the program does not have the model, or if the record is not the run of a scene.
    """
    if measured.is_measured(record):
        raise SceneError(f"{record.name}: a measurement, not a run; 'worm3d plot' and 'worm3d compare' draw it")
    if record.model == SWEEP:
        raise SceneError(f"{record.name}: a sweep; its figures are beside it, 'worm3d plot' draws a case ('--results')")
    if not record.scene:
        raise SceneError(f"{record.name}: saved by Python, not by a scene: worm3d.load reads it, worm3d.draw draws it")
    if record.model not in models.names():
        known = ", ".join(models.names())
        raise SceneError(f"{record.name}: made by the model '{record.model}', this worm3d knows only {known}")
    return models.get(record.model)


def pictures_of(record: Record) -> Pictures:
    """Return the pictures that can be drawn of a record. The errors are the same as in `model_of`."""
    if measured.is_measured(record):
        return measured_pictures(record)
    return model_of(record)


def is_drawable(record: Record) -> bool:
    """Return whether a record can be drawn: it is a measurement, or at least one step was finished."""
    return record.sizes.get("step", 0) > 0 or measured.is_measured(record)


def plot(record: Record, model: Pictures, folder: Path) -> list[Path]:
    """Write the overview, if there is one, and all figures of a record as PNG files, and return their paths.

    Raises
    ------
    SceneError
        If no step was finished.
    DiscError
        If the folder cannot be written.
    """
    _require_steps(record)
    paths = [] if model.overview is None else [draw_overview(record, model, folder)]
    for stem, draw in model.figures.items():
        path = folder / f"{stem}.png"
        figure, _ = draw(record)
        save_figure(figure, path)
        paths.append(path)
    return paths


def draw_overview(record: Record, model: Pictures, folder: Path) -> Path:
    """Write the overview of a record into a folder, and return its path. The errors are the same as in `plot`."""
    _require_steps(record)
    assert model.overview is not None
    path = folder / OVERVIEW
    with written_whole(path) as part:
        model.overview(record).save(part, format="png")
    return path


def animate(record: Record, model: Pictures, path: Path, fps: int = 20) -> Path:
    """Write the animation of a record to `path`, a GIF or MP4 file according to the ending, and return the path.

    Raises
    ------
    MissingPartError
        If `path` is an MP4 file and ffmpeg is missing.
    SceneError
        If the name has another ending, no step was finished, or the model has no animation.
    DiscError
        If the file cannot be written.
    """
    _require_steps(record)
    if model.animate is None:
        raise SceneError(f"{record.name}: the model '{model.name}' has no animation; 'worm3d plot' draws its figures")
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise SceneError(f"{path}: the name of an animation must end in .gif or .mp4")
    save_movie(model.animate(record), path, fps)
    return path


def view(record: Record, model: Pictures, path: Path, *, skin: bool = True) -> Path:
    """Write the page that plays a record in a browser, completely or not at all, and return the path.

    Raises
    ------
    SceneError
        If the model has no page, or no step was finished.
    DiscError
        If the file cannot be written.
    """
    if model.view is None:
        instead = "'worm3d plot' draws its figures" if model.animate is None else "'worm3d export' makes a film"
        raise SceneError(f"{record.name}: the model '{model.name}' has no page; {instead}")
    _require_steps(record)
    with written_whole(path) as part:
        model.view(record, part, skin=skin)
    return path


def mesh(record: Record, model: Pictures, at: float | None, path: Path) -> Path:
    """Write the worm and the world at an instant [s] as a GLB file, and return the path.

    If `at` is None, the instant is the end of the run.

    Raises
    ------
    SceneError
        If the name does not end in .glb, the instant is outside the run, no step was finished, or the model has no
        mesh.
    DiscError
        If the file cannot be written.
    """
    _require_steps(record)
    if model.mesh is None:
        raise SceneError(f"{record.name}: the model '{model.name}' has no mesh")
    if path.suffix.lower() != ".glb":
        raise SceneError(f"{path}: the name of a mesh must end in .glb")
    try:
        content = model.mesh(record, at)
    except ValueError as error:
        raise SceneError(f"--{error}") from error
    write_bytes(path, content)
    return path


def clear_pictures(folder: Path) -> None:
    """Remove the files of an earlier run of any model: summary, pictures and unfinished files.

    The result and other files are kept.

    Raises
    ------
    DiscError
        If a file cannot be removed.
    """
    found = {path.name for path in folder.glob("*.png")} - {OVERVIEW}
    # The names of the figures are needed only if there are PNG files. Finding them imports every model.
    stems = {stem for name in models.names() for stem in models.get(name).figures} if found else set()
    unfinished = [path.name for path in folder.glob(f"{TEMPORARY_PREFIX}*.part*")]
    for name in (SUMMARY, ANIMATION, VIEWER, OVERVIEW, *unfinished, *sorted(found & {f"{stem}.png" for stem in stems})):
        remove(folder / name)


def cut_short(record: Record) -> str | None:
    """Return a line for the user if the animation does not show the whole run, else None."""
    simulated = float(record["time"][-1])
    if not is_drawable(record) or pictures_of(record).animate is None or simulated <= MOVIE_S * (1.0 + 1e-9):
        return None
    return f"the animation shows the first {MOVIE_S:g} s of {simulated:g} s"


def save_figure(figure: Picture, path: Path) -> None:
    """Write a figure as PNG, completely or not at all."""
    for title in (*figure.texts, *(axes.title for axes in figure.axes)):
        title.set_wrap(True)  # the names of scenes can be long
    with written_whole(path) as part:
        # The version of matplotlib is left out, so that the file does not depend on it.
        figure.savefig(part, format="png", metadata={"Software": None})


def save_movie(movie: Movie, path: Path, fps: int = 20) -> None:
    """Write a movie in the format given by the ending of `path`, completely or not at all.

    Raises
    ------
    MissingPartError
        If `path` is an MP4 file and ffmpeg is missing.
    DiscError
        If the file cannot be written.
    """
    # The writers choose the format by the ending of the name. Therefore the unfinished file has the same ending.
    with written_whole(path) as part:
        unfinished = part.with_name(f"{part.name}{path.suffix}")
        try:
            movie.save(unfinished, fps=fps)
            unfinished.replace(part)
        except FileNotFoundError as error:
            if error.errno is not None:  # a missing folder
                raise
            raise MissingPartError(str(error)) from error
        finally:
            unfinished.unlink(missing_ok=True)


def _require_steps(record: Record) -> None:
    if not is_drawable(record):
        raise SceneError(f"{record.name}: no step was finished, there is nothing to draw")
