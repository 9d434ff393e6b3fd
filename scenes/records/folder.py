"""The folder of a run: its path, checks before writing, and writing of files.

Files are written completely or not at all. Only one process at a time can write to a folder, since it locks a file in
the folder. The operating system releases the lock when the process ends, even if the process is killed. Therefore a
lock file that a killed process has left behind does not block the folder.
"""

from __future__ import annotations

import itertools
import os
import secrets
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path

from scenes.language.errors import DiscError, SceneError

RUNS = Path("runs")
"""Folder where runs without the option --out create their folders."""

RESULT = "result.nc"
SUMMARY = "summary.json"
OVERVIEW = "overview.png"
ANIMATION = "animation.gif"
"""Animation, which runs of planar worms write. For 3D worms, `worm3d export --film` writes an animation."""
VIEWER = "viewer.html"
"""Page that plays the run in a browser without a network, which runs of 3D worms write."""

TEMPORARY_PREFIX = ".worm3d-"
"""Beginning of the names of temporary files."""
LOCK = f"{TEMPORARY_PREFIX}lock"

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        os.lseek(handle, 1 << 20, os.SEEK_SET)  # other processes cannot read locked bytes
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def prepared(out: Path | None, scene_name: str, *, force: bool) -> Iterator[Path]:
    """Yield the folder for a run. It is created, checked and locked, and unlocked at the end of the context.

    Raises
    ------
    SceneError
        If the path is a file, if the folder is not empty and `force` is false, or if another process writes to the
        folder.
    DiscError
        If the folder cannot be created or written.
    """
    folder = out if out is not None else _fresh(scene_name)
    _require_empty(folder, force=force)
    with locked(made(folder)):
        _require_empty(folder, force=force)  # another run may have finished in the meantime
        yield folder


def _require_empty(folder: Path, *, force: bool) -> None:
    if not force and is_used(folder):
        raise SceneError(f"{folder} exists and is not empty: choose another --out, or replace its results with --force")


def is_used(folder: Path) -> bool:
    """Return whether a folder contains files other than temporary files; raise DiscError if it cannot be read."""
    with disc_errors(folder):
        return folder.is_dir() and any(not path.name.startswith(TEMPORARY_PREFIX) for path in folder.iterdir())


@contextmanager
def disc_errors(path: Path) -> Iterator[None]:
    """Convert errors of the file system to a `DiscError` about a path."""
    try:
        yield
    except OSError as error:
        raise DiscError.writing(path, error) from error


def remove(path: Path) -> None:
    """Remove a file if it exists; raise DiscError if it cannot be removed."""
    with disc_errors(path):
        path.unlink(missing_ok=True)


def made(folder: Path) -> Path:
    """Create a folder if it does not exist, check that it can be written, and return it.

    Raises
    ------
    SceneError
        If the path is a file.
    DiscError
        If the folder cannot be created or written.
    """
    with disc_errors(folder):
        if folder.exists() and not folder.is_dir():
            raise SceneError(f"{folder} is a file: choose a folder for --out")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder


def require_free(targets: Sequence[Path], result: Path, *, force: bool) -> None:
    """Check that the files `targets` can be written without loss. `result` is the file or folder that is read.

    Raises
    ------
    SceneError
        If two targets are the same file, if a target is the file that is read, or if a target exists and `force` is
        false.
    """
    source = (result / RESULT if result.is_dir() else result).resolve()
    real = [target.resolve() for target in targets]
    for target, place in zip(targets, real, strict=True):
        if place == source:
            raise SceneError(f"{target} is the result itself: choose another name")
        if real.count(place) > 1:
            raise SceneError(f"{target} is named twice: choose two names")
        if target.exists() and not force:
            raise SceneError(f"{target} exists: choose another name, or replace it with --force")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file to write to. After success, the file is renamed to `path`.

    Raises
    ------
    DiscError
        If the file cannot be written. An existing file at `path` then stays as it is.
    """
    part = path.with_name(f"{TEMPORARY_PREFIX}{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        with disc_errors(path):
            yield part
            os.replace(part, path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file completely or not at all."""
    with written_whole(path) as part:
        part.write_bytes(content)


def _fresh(scene_name: str) -> Path:
    """Create a new folder for a run without --out."""
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


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder, so that no other process or thread that also locks it can write to it.

    If the file system does not support locks, or the folder is read-only, no lock is set.

    Raises
    ------
    SceneError
        If another process has locked the folder.
    """
    handle = _acquired(folder)
    try:
        yield
    finally:
        if handle is not None:
            with suppress(OSError):
                (folder / LOCK).unlink()
            os.close(handle)


def _acquired(folder: Path) -> int | None:
    """Return the handle of the locked file, or None if no lock can be set."""
    while True:
        try:
            handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError:
            return None
        with ExitStack() as undo:
            undo.callback(os.close, handle)
            try:
                _lock(handle)
            except (BlockingIOError, PermissionError) as error:
                raise SceneError(_explained(handle, folder)) from error
            except OSError:
                return None
            if _is_there(handle, folder / LOCK):  # otherwise the previous owner has just removed it
                os.ftruncate(handle, 0)
                os.write(handle, f"{os.getpid()}\n".encode())
                undo.pop_all()
                return handle


def _is_there(handle: int, path: Path) -> bool:
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False


def _explained(handle: int, folder: Path) -> str:
    text = os.pread(handle, 20, 0).decode("ascii", "replace") if hasattr(os, "pread") else ""
    process = f"process {text.strip()}" if text.strip().isdigit() else "another process"
    return f"{folder}: {process} is writing to it: wait until it ends, or choose another --out"
