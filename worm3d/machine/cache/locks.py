"""One process at a time makes what is to be kept: the others wait, and find it on disk.

The lock belongs to an open file, so that it ends with the process, however that ends. It only saves work: where there
are no locks, or after `LONGEST`, nobody waits.
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

LONGEST = 300.0
"""Longest time that a process waits for another one [s]: more than anything takes to compile."""
POLL = 0.05
"""Time between two looks at a lock [s]."""
_OPEN = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)


@contextlib.contextmanager
def alone(folder: Path | None, key: str) -> Iterator[None]:
    """While entered, no other process or thread is, with the same folder and key; look again for what is kept then."""
    handle = None if folder is None or fcntl is None else _locked(folder, f".{key}.part", time.monotonic() + LONGEST)
    try:
        yield
    finally:
        if handle is not None and folder is not None:
            with contextlib.suppress(OSError):
                (folder / f".{key}.part").unlink()
            os.close(handle)


def _locked(folder: Path, name: str, end: float) -> int | None:
    """Return the handle of a locked file; None where it cannot be had."""
    while time.monotonic() < end:
        try:
            files.make(folder)
            with files.entered(folder) as place:
                handle = place.open(name, _OPEN)
        except (OSError, UntrustedError):
            return None
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle), (folder / name).stat()):  # its last owner may have removed it
                return handle
        os.close(handle)
        time.sleep(POLL)
    return None
