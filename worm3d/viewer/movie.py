"""The worm from the side and from above as a movie: GIF, or MP4 where ffmpeg is found.

The parts that do not move are drawn once, as matplotlib spends most of the time on the lettering of axes.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from worm3d.values.arrays import FloatArray
from worm3d.viewer.figure import Stage
from worm3d.viewer.frames import Frames

Picture = NDArray[np.uint8]
"""Red, green, blue, shape (height, width, 3)."""


def write_movie(frames: Frames, path: str | Path, *, fps: float = 20.0) -> tuple[Figure, tuple[Axes, Axes]]:
    """Write the run in real time and return the last figure; `.gif` by Pillow, `.mp4` by ffmpeg.

    Raises
    ------
    ValueError
        A file name that does not end in .gif or .mp4, or frames per second that are not above 0.
    FileNotFoundError
        MP4 requested, but no ffmpeg on this machine.
    """
    if not (np.isfinite(fps) and fps > 0.0):
        raise ValueError(f"fps: got {fps!r}, must be a finite number above 0 of frames a second")
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
    indices = _indices(frames.time, interval)
    if suffix == ".gif":
        _write_gif(stage, indices, Path(path), interval)
    else:
        _write_mp4(pictures(stage, indices), Path(path), interval)
    return stage.figure, stage.axes


def _indices(time: FloatArray, interval: float) -> list[int]:
    """Return the frame to show in every interval; a frame that lasts is shown again."""
    instants = np.arange(time[0], time[-1] + 0.5 * interval, interval)
    return [int(np.abs(time - instant).argmin()) for instant in instants]


def pictures(stage: Stage, indices: Iterable[int]) -> Iterator[Picture]:
    """Draw some frames, each on top of the parts that do not move."""
    canvas: Any = stage.figure.canvas  # matplotlib has no types for it
    canvas.draw()  # only now does matplotlib know all sizes
    ground, view = None, None
    with stage.moving():
        for index in indices:
            stage.draw(index)
            if ground is None or view != stage.view:
                canvas.draw()
                ground, view = canvas.copy_from_bbox(stage.figure.bbox), stage.view
            canvas.restore_region(ground)
            for artist in stage.artists:
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


def _write_mp4(drawn: Iterator[Picture], path: Path, interval: float) -> None:
    first = next(drawn)
    height, width = first.shape[:2]
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{1.0 / interval:.6g}", "-i", "-"]
    command = ["ffmpeg", "-y", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for picture in (first, *drawn):
                process.stdin.write(picture.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # ffmpeg's message follows below
        trouble = process.stderr.read().decode(errors="replace")
    if process.returncode:
        raise OSError(f"ffmpeg could not write {path}: {trouble.strip()}")
