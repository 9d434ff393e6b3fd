"""Compiled kernels on disk: one file each, named by a key of everything they depend on, safe to share.

A file is the SHA-256 of the object code and then the object code. Files appear whole (written aside and renamed), so
that any number of processes may write the same one; what cannot be read or does not match its checksum counts as
absent, and what cannot be written is not kept.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path

KEPT = 200
"""Files beyond this number are removed, the oldest first."""
_DIGEST = hashlib.sha256().digest_size


def default_folder() -> Path | None:
    """Return $XDG_CACHE_HOME/worm3d/kernels or ~/.cache/worm3d/kernels; None for a user without a home."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):
        return Path(base) / "worm3d" / "kernels"
    try:
        return Path.home() / ".cache" / "worm3d" / "kernels"
    except RuntimeError:
        return None


def load(folder: Path | None, key: str) -> bytes | None:
    """Return the object code kept under `key`, or None."""
    if folder is None:
        return None
    try:
        content = _file(folder, key).read_bytes()
    except OSError:
        return None
    digest, code = content[:_DIGEST], content[_DIGEST:]
    return code if hashlib.sha256(code).digest() == digest else None


def store(folder: Path | None, key: str, code: bytes) -> bool:
    """Keep the object code under `key`; return whether that was possible."""
    if folder is None:
        return False
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _write_whole(_file(folder, key), hashlib.sha256(code).digest() + code)
        _prune(folder)
    except OSError:
        return False
    return True


def _file(folder: Path, key: str) -> Path:
    return folder / f"{key}.kernel"


def _write_whole(path: Path, content: bytes) -> None:
    handle, aside = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.replace(aside, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(aside)
        raise


def _prune(folder: Path) -> None:
    """Remove the oldest files beyond `KEPT`; another process may have been quicker."""
    dated = []
    for path in folder.glob("*.kernel"):
        with contextlib.suppress(OSError):
            dated.append((path.stat().st_mtime, path))
    for _, path in sorted(dated)[:-KEPT]:
        path.unlink(missing_ok=True)
