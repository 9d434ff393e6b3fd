"""One process at a time writes to a folder.

The lock belongs to an open file, so that it ends with the process, however that ends; a file that a killed process left
behind locks nothing.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from scenes.language.errors import SceneError

PREFIX = ".worm3d-"
"""First letters of the names of files that are there while something is written."""
NAME = f"{PREFIX}lock"
BEHIND = 1 << 20
"""Byte that is locked on Windows, where others cannot read what is locked."""

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        os.lseek(handle, BEHIND, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes, and threads, from writing to a folder.

    Where no lock can be had, on a file system without locks or a folder that cannot be written, there is none.

    Raises
    ------
    SceneError
        Another one holds it.
    """
    handle = _acquired(folder)
    try:
        yield
    finally:
        if handle is not None:
            with suppress(OSError):
                (folder / NAME).unlink()
            os.close(handle)


def _acquired(folder: Path) -> int | None:
    """Return the handle of the locked file, or None where there are no locks."""
    while True:
        try:
            handle = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
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
            if _is_there(handle, folder / NAME):  # or the one that held it has just removed the file
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
