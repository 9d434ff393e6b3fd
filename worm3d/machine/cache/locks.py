"""Only one process at a time makes a file of the cache: the other processes wait, and find the file on disk.

The lock belongs to an open file, so that the lock ends with the process, however the process ends. The lock only saves
work: without locks, or after `MAX_LOCK_WAIT`, no process waits.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

from worm3d.machine.cache import files
from worm3d.machine.cache.trust import UntrustedError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

MAX_LOCK_WAIT = 300.0
"""Longest time that a process waits for another process [s]: longer than any compilation."""
POLL = 0.05
"""Time between two checks of a lock [s]."""
_OPEN = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)


@contextlib.contextmanager
def alone(folder: Path | None, key: str) -> Iterator[None]:
    """Exclude other processes and threads with the same folder and key; the caller checks the cache again inside."""
    handle = (
        None if folder is None or fcntl is None else _locked(folder, f".{key}.part", time.monotonic() + MAX_LOCK_WAIT)
    )
    try:
        yield
    finally:
        if handle is not None and folder is not None:
            with contextlib.suppress(OSError):
                (folder / f".{key}.part").unlink()
            os.close(handle)


def _locked(folder: Path, name: str, end: float) -> int | None:
    """Return the handle of a locked file; None if the lock is not available."""
    while time.monotonic() < end:
        try:
            files.make(folder)
            with files.entered(folder) as place:
                handle = place.open(name, _OPEN)
        except (OSError, UntrustedError):
            return None
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle), (folder / name).stat()):  # the last owner may have removed the file
                return handle
        os.close(handle)
        time.sleep(POLL)
    return None
