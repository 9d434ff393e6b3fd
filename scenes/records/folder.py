"""The folder of a run: where it is, whether it may be written, and which files in it are ours.

It holds `result.nc`, `summary.json`, `overview.png` (by `worm3d plot` all figures), and what moves: `viewer.html` of 3D
worms, a page that plays in any browser without a network, or `animation.gif` of planar ones (of 3D worms by `worm3d
animate`).
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from scenes import models
from scenes.language.errors import DiscError, SceneError
from scenes.records import lock
from scenes.records.overview import FILE_NAME as OVERVIEW
from scenes.records.store import FILE_NAME

SUMMARY = "summary.json"
ANIMATION = "animation.gif"
VIEWER = "viewer.html"
RUNS = Path("runs")


@contextmanager
def prepared(out: Path | None, scene_name: str, *, force: bool) -> Iterator[Path]:
    """Give the folder to write to, made and found writable before anything is computed; nobody else writes to it.

    Raises
    ------
    SceneError
        It is a file, it has something in it and `force` is not set, or another process writes to it.
    DiscError
        It cannot be made or written.
    """
    folder = out if out is not None else _fresh(scene_name)
    _require_empty(folder, force=force)
    with lock.held(made(folder)):
        _require_empty(folder, force=force)  # or else another run has come to its end meanwhile
        yield folder


def _require_empty(folder: Path, *, force: bool) -> None:
    try:
        if not force and folder.is_dir() and any(not path.name.startswith(lock.PREFIX) for path in folder.iterdir()):
            raise SceneError(
                f"{folder} exists and is not empty: choose another --out, or replace its results with --force"
            )
    except OSError as error:
        raise DiscError.writing(folder, error) from error


def made(folder: Path) -> Path:
    """Make a folder, if need be, and return it.

    Raises
    ------
    SceneError
        It is a file.
    DiscError
        It cannot be made or written.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise SceneError(f"{folder} is a file: choose a folder for --out")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise DiscError.writing(folder, error) from error


def clear_pictures(folder: Path) -> None:
    """Remove the summary and pictures of an earlier run, of whatever model, and unfinished files; others stay.

    Raises
    ------
    DiscError
        A file cannot be removed.
    """
    found = {path.name for path in folder.glob("*.png")} - {OVERVIEW}
    # Only where there are pictures: it imports every model.
    stems = {stem for name in models.names() for stem in models.get(name).figures} if found else set()
    unfinished = [path.name for path in folder.glob(f"{lock.PREFIX}*.part*")]
    for name in (SUMMARY, ANIMATION, VIEWER, OVERVIEW, *unfinished, *sorted(found & {f"{stem}.png" for stem in stems})):
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise DiscError.writing(folder / name, error) from error


def require_free(targets: Sequence[Path], result: Path, *, force: bool) -> None:
    """Check that files may be written, before anything is computed.

    Raises
    ------
    SceneError
        Two of them are one file, one is the result itself, or one exists and `force` is not set.
    """
    source = (result / FILE_NAME if result.is_dir() else result).resolve()
    real = [target.resolve() for target in targets]
    for target, place in zip(targets, real, strict=True):
        if place == source:
            raise SceneError(f"{target} is the result itself: choose another name")
        if real.count(place) > 1:
            raise SceneError(f"{target} is named twice: choose two names")
        if target.exists() and not force:
            raise SceneError(f"{target} exists: choose another name, or replace it with --force")


def _fresh(scene_name: str) -> Path:
    """Make a folder of its own for a run without --out."""
    stem = f"{scene_name}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
    for n in itertools.count(1):
        name = stem if n == 1 else f"{stem}-{n}"
        try:
            (RUNS / name).mkdir(parents=True)
        except FileExistsError:
            if RUNS.is_dir():
                continue
            raise DiscError(f"cannot write {RUNS}: it is a file") from None
        except OSError as error:
            raise DiscError.writing(RUNS / name, error) from error
        return RUNS / name
    raise AssertionError("unreachable")
