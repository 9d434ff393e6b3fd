"""Bytes on disk under a key, verified before use; doubtful files count as absent.

A file consists of a SHA-256 of the key and the content, followed by the content. Each file is written under a temporary
name and then renamed, so that any number of processes may write the same file. Files and folders that others could have
written are not read (`worm3d.machine.cache.trust`). The next process makes everything again that cannot be kept. A
message on stderr tells the user the reason, once.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import secrets
import stat
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from worm3d.machine.cache.trust import HAS_OWNERS, UntrustedError, require_own, require_safe_way

MAX_FILES = 400
"""Largest number of files in a folder; the oldest files beyond this number are removed."""
MAX_FILE_BYTES = 2**32
"""Largest size of a file that is read [byte]."""
ABANDONED = 3600.0
"""Age at which an unfinished file counts as abandoned by a process that has ended [s]."""
_DIGEST = hashlib.sha256().digest_size
_READ = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_WRITE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
_told: set[str] = set()


class DamagedError(Exception):
    """The content of a file differs from the written content."""


def folder(name: str) -> Path | None:
    """Return the folder `name` in $XDG_CACHE_HOME/worm3d or ~/.cache/worm3d; None for a user without a home."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):
        return Path(base) / "worm3d" / name
    try:
        return Path.home() / ".cache" / "worm3d" / name
    except RuntimeError:
        return None


def load(folder: Path | None, key: str, suffix: str = ".kernel") -> bytes | None:
    """Return the content kept under `key`, or None."""
    if folder is None:
        return None
    try:
        with entered(folder) as place:
            return verified(key, _content(place, key + suffix))
    except FileNotFoundError:
        pass
    except UntrustedError as error:
        _tell_untrusted(folder, error)
    except (DamagedError, OSError, MemoryError) as error:
        sentence = f"the cache {folder} has files that cannot be used ({_reason(error)}); what they kept is made anew"
        _tell(sentence, f"damaged {folder}")
    return None


def store(folder: Path | None, key: str, content: bytes, suffix: str = ".kernel", most: int | None = None) -> bool:
    """Keep the content under `key`, as one of `most` files (`MAX_FILES`); return whether this was possible."""
    if folder is None:
        return False
    try:
        make(folder)
        with entered(folder) as place:
            _write_whole(place, key + suffix, signed(key, content))
        _prune(folder, suffix, MAX_FILES if most is None else most)
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
        with entered(folder) as place:
            _write_whole(place, f"probe-{secrets.token_hex(8)}", b"\0", remove=True)
    except UntrustedError as error:
        return str(error)
    except OSError as error:
        return f"{folder}: {_reason(error)}"
    return None


@contextlib.contextmanager
def entered(folder: Path) -> Iterator[_Place]:
    """Open a folder of this user; all further operations act on the checked folder.

    Raises
    ------
    UntrustedError
        Others can write to the folder.
    OSError
        The folder does not exist, or cannot be opened.
    """
    if not HAS_OWNERS:
        yield _Place(folder, None)
        return
    require_safe_way(folder)
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        require_own(os.fstat(handle), folder)
        yield _Place(folder, handle)
    finally:
        os.close(handle)


class _Place:
    """A folder and, if the system has such handles, the handle of the open folder."""

    def __init__(self, folder: Path, handle: int | None) -> None:
        self.folder, self.handle = folder, handle

    def name(self, name: str) -> str:
        return name if self.handle is not None else str(self.folder / name)

    def open(self, name: str, flags: int) -> int:
        return os.open(self.name(name), flags, 0o600, dir_fd=self.handle)


def make(folder: Path) -> None:
    """Make a folder and the folders above, for this user alone."""
    require_safe_way(folder)
    for place in (*reversed(folder.parents), folder):
        if not place.is_dir():
            place.mkdir(mode=0o700, exist_ok=True)


def _content(place: _Place, name: str) -> bytes:
    with os.fdopen(place.open(name, _READ), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_FILE_BYTES:
            raise DamagedError(f"{name} is not a file of the cache")
        require_own(status, place.folder / name)
        return file.read()


def signed(key: str, content: bytes) -> bytes:
    """Return the content kept under a key, with a checksum."""
    return _digest(key, content) + content


def verified(key: str, content: bytes) -> bytes:
    """Return the content kept under a key, without the checksum; raise DamagedError if the checksum is wrong."""
    digest, rest = content[:_DIGEST], content[_DIGEST:]
    if digest != _digest(key, rest):
        raise DamagedError(f"{key[:16]}... is damaged: its checksum is wrong")
    return rest


def _digest(key: str, content: bytes) -> bytes:
    digest = hashlib.sha256(key.encode() + b"\0")
    digest.update(content)
    return digest.digest()


def _write_whole(place: _Place, name: str, content: bytes, *, remove: bool = False) -> None:
    aside = f".{os.getpid()}-{secrets.token_hex(8)}.part"
    try:
        with os.fdopen(place.open(aside, _WRITE), "wb") as file:
            file.write(content)
        if not remove:
            os.replace(place.name(aside), place.name(name), src_dir_fd=place.handle, dst_dir_fd=place.handle)
    finally:
        with contextlib.suppress(OSError):
            os.unlink(place.name(aside), dir_fd=place.handle)


def _prune(folder: Path, suffix: str, most: int) -> None:
    """Remove the oldest files beyond `most`, and abandoned files; another process may have been quicker."""
    dated = []
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            dated.append((path.stat().st_mtime, path))
    kept = sorted(item for item in dated if item[1].suffix == suffix)
    unfinished = [item for item in dated if item[1].suffix == ".part" and item[0] < time.time() - ABANDONED]
    for _, path in kept[: max(0, len(kept) - most)] + unfinished:
        with contextlib.suppress(OSError):
            path.unlink()


def _tell_untrusted(folder: Path, error: UntrustedError) -> None:
    _tell(
        f"the cache {folder} is not used, everything is made anew each time: {error}; make it your own "
        f"('chmod -R go-w {folder.parent}'), remove it, or set XDG_CACHE_HOME to another folder"
    )


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.errno == errno.ELOOP:
        return "a symbolic link"
    return (isinstance(error, OSError) and error.strerror) or str(error) or type(error).__name__


def _tell(sentence: str, about: str = "") -> None:
    """Print a sentence on stderr, once per process."""
    about = about or sentence
    if about not in _told:
        _told.add(about)
        sys.stderr.write(f"worm3d: {sentence}\n")
        sys.stderr.flush()
