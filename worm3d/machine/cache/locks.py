"""Locks, so that only one process makes a file of the cache. Other processes wait and then find the file on disk.

The lock belongs to an open file. It therefore ends with the process, even if the process crashes. The lock only saves
work. Without locks no process waits, and with locks no process waits longer than a compilation may take.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from worm3d.machine.cache import files
from worm3d.machine.cache.trust import UntrustedError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_OPEN = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)


def load_or_make(folder: Path | None, key: str, make: Callable[[], tuple[bytes, bool]]) -> bytes:
    """Return the content stored under `key`. If there is none, store and return the result of `make`.

    `make` returns the content, and whether to store it.
    """
    content = files.load(folder, key)
    if content is None:
        with alone(folder, key):
            content = files.load(folder, key)  # another process may have made it
            if content is None:
                content, keep = make()
                if keep:
                    files.store(folder, key, content)
    return content


@contextlib.contextmanager
def alone(folder: Path | None, key: str, wait: float = 300.0) -> Iterator[None]:
    """Exclude other processes and threads with the same folder and key. Wait for them for at most `wait` [s]."""
    path = None if folder is None or fcntl is None else folder / f".{key}.part"
    handle = None if path is None else _locked(path, time.monotonic() + wait)
    try:
        yield
    finally:
        if path is not None and handle is not None:
            with contextlib.suppress(OSError):
                path.unlink()
            os.close(handle)


def _locked(path: Path, end: float) -> int | None:
    """Return the handle of a locked file; None if the lock is not available."""
    while time.monotonic() < end:
        try:
            files.make(path.parent)
            handle = os.open(path, _OPEN, 0o600)
        except (OSError, UntrustedError):
            return None
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle), path.stat()):  # the last owner may have removed the file
                return handle
        os.close(handle)
        time.sleep(0.05)
    return None
