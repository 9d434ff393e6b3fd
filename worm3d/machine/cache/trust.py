"""Which files of the cache are trusted. Code from the cache runs, so that nobody else may be able to write such files.

A checksum reveals damage, but does not show who wrote the file and the checksum. Owner and mode show this. A file is
trusted under three conditions. The file belongs to this process's user or to root, and nobody else may write to it. The
same holds for its folder. Nobody else can replace a folder on the path to it. On Windows all files are trusted, since a
user's folders are private by default and Python does not see the permissions.
"""

from __future__ import annotations

import os
import stat
from functools import cache
from pathlib import Path

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
HAS_OWNERS = hasattr(os, "geteuid")


class UntrustedError(Exception):
    """Raised if another user owns a file or folder, or may write to it; the message names the file and the user."""


def require_own(status: os.stat_result, place: object) -> None:
    """Raise UntrustedError unless a file or folder belongs to this user or root, and nobody else may write to it."""
    _require_owner(status, place)
    if HAS_OWNERS and status.st_mode & OTHERS_WRITE:
        raise UntrustedError(f"others may write to {place} (mode {stat.S_IMODE(status.st_mode):03o})")


def require_safe_way(folder: Path, links: int = 0) -> None:
    """Raise UntrustedError if others can replace a folder or one of its parent folders.

    A folder that does not exist is safe. A folder with the sticky bit, such as /tmp, is safe. A folder that the owner's
    private group may write to (the default for a home folder on some systems) is safe unless it is the direct parent.
    An OSError means that the path cannot be followed.
    """
    if not HAS_OWNERS:
        return
    if links > 40:  # the limit of Linux
        raise UntrustedError(f"{folder} is reached by more than 40 symbolic links")
    whole = Path(os.path.abspath(folder))
    for place in reversed(whole.parents):
        try:
            status = place.lstat()
        except FileNotFoundError:
            return
        _require_owner(status, place)
        if stat.S_ISLNK(status.st_mode):
            require_safe_way(place.parent / place.readlink() / whole.name, links + 1)
        elif _is_open(status, private_allowed=place != whole.parent):
            raise UntrustedError(f"others may write to {place} (mode {stat.S_IMODE(status.st_mode):03o})")


def _require_owner(status: os.stat_result, place: object) -> None:
    if HAS_OWNERS and status.st_uid not in (0, os.geteuid()):
        raise UntrustedError(f"{place} belongs to another user ({_name(status.st_uid)})")


def _is_open(status: os.stat_result, *, private_allowed: bool) -> bool:
    """Return whether others may rename the entries of a folder."""
    if status.st_mode & stat.S_ISVTX:
        return False
    private = private_allowed and not status.st_mode & stat.S_IWOTH and _is_private(status.st_gid)
    return bool(status.st_mode & OTHERS_WRITE) and not private


@cache
def _is_private(group: int) -> bool:
    """Return whether a group is root's, or contains only this user: by convention such a group has the user's name."""
    import grp
    import pwd

    if group == 0:
        return True
    try:
        user = pwd.getpwuid(os.geteuid())
        return group == user.pw_gid and grp.getgrgid(group).gr_name == user.pw_name
    except KeyError:
        return False


def _name(user: int) -> str:
    import pwd

    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)
