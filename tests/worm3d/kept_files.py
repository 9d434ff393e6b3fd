"""What tests of the cache share: two functions that it keeps, and what may happen to its files."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

import numpy as np

from worm3d.machine.functions import Function

AS_ROOT = os.geteuid() == 0
KINDS = ("flip", "cut", "empty", "zeros", "folder", "link", "fifo", "locked", "longer")


def damage(path: Path, random: np.random.Generator) -> str:
    """Do one of those things to a file that discs, crashes and people do."""
    content = path.read_bytes()
    kind = str(random.choice(KINDS))
    path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to("/dev/zero")
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        at = int(random.integers(len(content)))
        flipped = bytearray(content)
        flipped[at] ^= 1 << int(random.integers(8))
        changed = {
            "flip": bytes(flipped),
            "cut": content[:at],
            "empty": b"",
            "zeros": content[:at].ljust(2 * at, b"\0"),
        }
        changed |= {"longer": content + b"\0", "locked": content}
        path.write_bytes(changed[kind])
        path.chmod(0o000 if kind == "locked" else 0o600)
    return kind


def mend(path: Path, content: bytes) -> None:
    path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
    path.write_bytes(content)
    path.chmod(0o600)


def total(values: np.ndarray) -> float:
    found = 0.0
    for value in values:
        found += value * value
    return found


def double(value: float) -> float:
    return 2.0 * value


def fresh() -> tuple[float, float, int]:
    """Return what the two functions give as in a new process, and how many of them were compiled."""
    missed: list[int] = []
    array, number = (Function(each, lambda: "1", 1, lambda: missed.append(1)) for each in (total, double))
    call = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(number.address)
    return array(np.arange(4.0)), call(1.5), len(missed)
