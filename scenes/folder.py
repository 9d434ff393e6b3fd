"""The folder of a run: where it is, whether it may be written, and which files in it are ours."""

from __future__ import annotations

import tempfile
from datetime import datetime
from pathlib import Path
from typing import Any

from scenes.errors import DiscError, SceneError
from scenes.kinds.base import Kind
from scenes.store import FILE_NAME

SUMMARY = "summary.json"
ANIMATION = "animation.gif"
RUNS = Path("runs")


def prepared(out: Path | None, scene_name: str, *, force: bool) -> Path:
    """Return the folder to write to, made and found writable before anything is computed.

    Raises
    ------
    SceneError
        It is a file, or it has something in it and `force` is not set.
    DiscError
        It cannot be made or written.
    """
    folder = out if out is not None else _fresh(scene_name)
    try:
        if folder.exists() and not folder.is_dir():
            raise SceneError(f"{folder} is a file: choose a folder for --out")
        if not force and folder.is_dir() and any(folder.iterdir()):
            raise SceneError(
                f"{folder} exists and is not empty: choose another --out, or replace its results with --force"
            )
    except OSError as error:
        raise DiscError.writing(folder, error) from error
    return made(folder)


def made(folder: Path) -> Path:
    """Make a folder, if need be, and return it.

    Raises
    ------
    DiscError
        It cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise DiscError.writing(folder, error) from error


def clear(folder: Path, kind: Kind[Any]) -> None:
    """Remove what an earlier run wrote; files that are not ours stay."""
    for name in (FILE_NAME, SUMMARY, ANIMATION, *(f"{stem}.png" for stem in kind.figures)):
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise DiscError.writing(folder / name, error) from error


def _fresh(scene_name: str) -> Path:
    stem = f"{scene_name}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
    names = (stem, *(f"{stem}-{n}" for n in range(2, 1000)))
    return next(RUNS / name for name in names if not (RUNS / name).exists())
