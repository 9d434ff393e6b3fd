"""Bytes that are stored on disk under a key and verified before use. A file that fails the check counts as missing.

A file consists of a SHA-256 checksum of the key and the content, followed by the content. Each file is written under a
temporary name and then renamed, so that any number of processes may write the same file. Files and folders to which
others could have written are not read (`worm3d.machine.cache.trust`). If something cannot be stored, the next process
makes it again. A message on stderr states the reason once.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import stat
import sys
import time
from pathlib import Path

from worm3d.machine.cache.trust import UntrustedError, require_own, require_safe_way

_DIGEST = hashlib.sha256().digest_size
_READ = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_WRITE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
_told: set[str] = set()


class DamagedError(Exception):
    """Raised if the content of a file differs from the content that was written."""


def folder(name: str) -> Path | None:
    """Return the folder `name` in $XDG_CACHE_HOME/worm3d or ~/.cache/worm3d; None if the user has no home folder."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):
        return Path(base) / "worm3d" / name
    try:
        return Path.home() / ".cache" / "worm3d" / name
    except RuntimeError:
        return None


def load(folder: Path | None, key: str, suffix: str = ".kernel") -> bytes | None:
    """Return the content stored under `key`, or None."""
    if folder is None:
        return None
    try:
        require_trusted(folder)
        return verified(key, _content(folder / f"{key}{suffix}"))
    except FileNotFoundError:
        pass
    except UntrustedError as error:
        _tell_untrusted(folder, error)
    except (DamagedError, OSError, MemoryError) as error:
        sentence = f"the cache {folder} has files that cannot be used ({_reason(error)}); what they kept is made anew"
        _tell(sentence, f"damaged {folder}")
    return None


def store(folder: Path | None, key: str, content: bytes, suffix: str = ".kernel", most: int = 400) -> bool:
    """Store the content under `key`; return whether this was possible. The oldest files beyond `most` are removed."""
    if folder is None:
        return False
    try:
        make(folder)
        _write_whole(folder, key + suffix, signed(key, content))
        _prune(folder, suffix, most)
    except UntrustedError as error:
        _tell_untrusted(folder, error)
        return False
    except OSError as error:
        _tell(
            f"nothing can be kept in the cache {folder} ({_reason(error)}); what it would keep is made anew each time"
        )
        return False
    return True


def obstacle(folder: Path | None) -> str | None:
    """Return the reason why nothing can be kept in a folder; None if files can be kept."""
    if folder is None:
        return "there is no folder for a cache: set HOME or XDG_CACHE_HOME"
    try:
        make(folder)
    except UntrustedError as error:
        return str(error)
    except OSError as error:
        return f"{folder}: {_reason(error)}"
    return None if os.access(folder, os.W_OK) else f"{folder}: not writeable"


def require_trusted(folder: Path) -> None:
    """Raise an error unless a folder exists, and nobody else can write to it or replace it.

    Since nobody else can replace a part of the path either, later operations by the path act on the same folder.

    Raises
    ------
    UntrustedError
        Others can write to the folder.
    OSError
        The folder does not exist, or is not a folder.
    """
    require_safe_way(folder)
    status = folder.lstat()
    if stat.S_ISLNK(status.st_mode):
        raise OSError("a symbolic link")
    require_own(status, folder)


def make(folder: Path) -> None:
    """Make a folder and its parent folders, to which only this user has access. Raises as `require_trusted`."""
    require_safe_way(folder)
    for place in (*reversed(folder.parents), folder):
        if not place.is_dir():
            place.mkdir(mode=0o700, exist_ok=True)
    require_trusted(folder)


def _content(path: Path) -> bytes:
    with os.fdopen(os.open(path, _READ), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise DamagedError(f"{path.name} is not a file of the cache")
        require_own(status, path)
        return file.read()


def signed(key: str, content: bytes) -> bytes:
    """Return a checksum of key and content, followed by the content."""
    return _digest(key, content) + content


def verified(key: str, content: bytes) -> bytes:
    """Return the content without the checksum in front; raise DamagedError if the checksum is wrong."""
    digest, rest = content[:_DIGEST], content[_DIGEST:]
    if digest != _digest(key, rest):
        raise DamagedError(f"{key[:16]}... is damaged: its checksum is wrong")
    return rest


def _digest(key: str, content: bytes) -> bytes:
    digest = hashlib.sha256(key.encode() + b"\0")
    digest.update(content)
    return digest.digest()


def _write_whole(folder: Path, name: str, content: bytes) -> None:
    aside = folder / f".{os.getpid()}-{secrets.token_hex(8)}.part"
    try:
        with os.fdopen(os.open(aside, _WRITE, 0o600), "wb") as file:
            file.write(content)
        aside.replace(folder / name)
    finally:
        with contextlib.suppress(OSError):
            aside.unlink()


def _prune(folder: Path, suffix: str, most: int) -> None:
    """Remove the oldest files beyond `most`, and files unfinished for an hour, unless another process does so first."""
    dated = []
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            dated.append((path.stat().st_mtime, path))
    kept = sorted(item for item in dated if item[1].suffix == suffix)
    unfinished = [item for item in dated if item[1].suffix == ".part" and item[0] < time.time() - 3600.0]
    for _, path in kept[: max(0, len(kept) - most)] + unfinished:
        with contextlib.suppress(OSError):
            path.unlink()


def _tell_untrusted(folder: Path, error: UntrustedError) -> None:
    _tell(
        f"the cache {folder} is not used, everything is made anew each time: {error}; make it your own "
        f"('chmod -R go-w {folder.parent}'), remove it, or set XDG_CACHE_HOME to another folder"
    )


def _reason(error: Exception) -> str:
    return (isinstance(error, OSError) and error.strerror) or str(error) or type(error).__name__


def _tell(sentence: str, about: str = "") -> None:
    """Print a sentence on stderr, once per process."""
    about = about or sentence
    if about not in _told:
        _told.add(about)
        sys.stderr.write(f"worm3d: {sentence}\n")
        sys.stderr.flush()
