"""Movies of the worm from the side and from above, as GIF, or as MP4 if ffmpeg is installed."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from subprocess import CalledProcessError
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from worm3d.values import arguments
from worm3d.viewer.figure import DPI, Stage
from worm3d.viewer.frames import Frames

Picture = NDArray[np.uint8]
"""A picture as red, green and blue values, shape (height, width, 3)."""


def write_movie(frames: Frames, path: str | Path, *, fps: float = 20.0) -> tuple[Figure, tuple[Axes, Axes]]:
    """Write a movie of the run in real time, and return the figure with the last frame and its axes.

    Pillow writes `.gif` files, and ffmpeg writes `.mp4` files.

    Raises
    ------
    ValueError
        The file name does not end in .gif or .mp4, or `fps` is not above 0.
    FileNotFoundError
        ffmpeg is missing for an MP4 file.
    """
    arguments.number("fps", fps, gt=0.0, allowed="a finite number above 0 of frames a second")
    suffix = Path(path).suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise ValueError(f"movie file: got {Path(path).name!r}, the ending must be .gif or .mp4")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise FileNotFoundError(
            "MP4 needs the program ffmpeg, which was not found: install it, or take a name that ends in .gif"
        )
    # A GIF counts delays in hundredths of a second.
    interval = max(round(100 / fps), 2) / 100 if suffix == ".gif" else 1.0 / fps
    stage = Stage(frames)
    instants = np.arange(frames.time[0], frames.time[-1] + 0.5 * interval, interval)
    indices = [int(np.abs(frames.time - instant).argmin()) for instant in instants]  # a frame may be repeated
    write = _write_gif if suffix == ".gif" else _write_mp4
    write(stage, indices, Path(path), interval)
    return stage.figure, stage.axes


def pictures(stage: Stage, indices: Iterable[int]) -> Iterator[Picture]:
    """Draw some frames, and yield their pictures.

    Drawing the axes takes most of the time. They are drawn again only if their limits have changed.
    """
    canvas: Any = stage.figure.canvas  # matplotlib has no types for it
    still, limits = None, None
    for index in indices:
        stage.draw(index)
        if stage.limits != limits:
            for artist in stage.moving:
                artist.set_animated(True)  # canvas.draw leaves these out
            canvas.draw()
            stage.figure.set_layout_engine("none")  # later frames have the axes of the first
            still, limits = canvas.copy_from_bbox(stage.figure.bbox), stage.limits
        canvas.restore_region(still)
        for artist in stage.moving:
            stage.figure.draw_artist(artist)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _write_gif(stage: Stage, indices: list[int], path: Path, interval: float) -> None:
    sample = np.concatenate(list(pictures(stage, sorted({indices[0], indices[len(indices) // 2], indices[-1]}))))
    palette = Image.fromarray(sample).quantize(255)
    drawn = (
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in pictures(stage, indices)
    )
    first = next(drawn)
    first.save(path, save_all=True, append_images=drawn, duration=round(1000 * interval), loop=0)


def _write_mp4(stage: Stage, indices: list[int], path: Path, interval: float) -> None:
    writer: Any = FFMpegWriter(fps=1.0 / interval)  # type: ignore[arg-type]  # takes fractions too
    next(pictures(stage, indices[:1]))  # lays the axes out
    try:
        with mpl.rc_context({"animation.frame_format": "rgba"}), writer.saving(stage.figure, str(path), dpi=DPI):
            for index in indices:
                stage.draw(index)
                writer.grab_frame()
    except CalledProcessError as error:
        raise OSError(f"ffmpeg could not write {path}: {error.stderr.decode().strip()}") from error
