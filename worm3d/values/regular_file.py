"""Reading of regular files up to a largest size. Pipes and devices, which might block or never end, are refused."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def content(path: str | os.PathLike[str], most: int, what: str, refusal: type[ValueError] = ValueError) -> bytes:
    """Return the content of a file of at most `most` bytes.

    The error message names the file as a `what`, for example as a "mesh".

    Raises
    ------
    ValueError
        The file cannot be read. The class of the error is `refusal`.
    """
    file = Path(path)
    try:
        return read(path, most)
    except FileNotFoundError:
        raise refusal(f"{what} {file.name!r}: there is no such file in {str(file.parent)!r}; check the path") from None
    except OSError as error:
        why = f"cannot be read ({error.strerror}); check the path and its permissions"
        raise refusal(f"{what} {file.name!r}: {why}") from None


def read(path: str | os.PathLike[str], most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes.

    Raises
    ------
    OSError
        The file cannot be opened, is not a regular file (but a folder, pipe, socket or device), or is larger. The
        attribute `strerror` names the reason, also for a path that no file system accepts.
    """
    try:
        # Without O_NONBLOCK, opening a pipe would wait until another process writes to it.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError as error:  # a null character
        raise OSError(errno.EINVAL, str(error), os.fspath(path)) from error
    with os.fdopen(handle, "rb") as file:
        mode = os.fstat(handle).st_mode
        if stat.S_ISDIR(mode):
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "not a regular file but a pipe, socket or device", os.fspath(path))
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"larger than {most / 1e6:g} MB", os.fspath(path))
    return data
