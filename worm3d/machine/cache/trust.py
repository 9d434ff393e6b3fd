"""Trust in files of the cache: what is loaded from it runs, so nobody else may be able to write it.

A checksum tells damage, not who wrote file and checksum; that is for owner and mode to tell. Believed is what belongs
to this process's user or to root and what nobody else may write, in a folder for which the same holds, at the end of
a way on which nobody else can put another folder in its place. On Windows, where folders of a user are the user's own
by default and Python does not see their permissions, everything is believed.
"""

from __future__ import annotations

import os
import stat
from functools import cache
from pathlib import Path

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
MOST_LINKS = 40
"""Symbolic links on the way to a folder, as many as Linux follows."""
HAS_OWNERS = hasattr(os, "geteuid")


class UntrustedError(Exception):
    """Somebody else owns a file or folder or may write to it; the text says which and who."""


def require_own(status: os.stat_result, place: object) -> None:
    """Raise UntrustedError unless a file or folder belongs to this user or to root, and nobody else may write to it."""
    _require_owner(status, place)
    if HAS_OWNERS and status.st_mode & OTHERS_WRITE:
        raise UntrustedError(f"others may write to {place} (mode {stat.S_IMODE(status.st_mode):03o})")


def require_safe_way(folder: Path, links: int = 0) -> None:
    """Raise UntrustedError if others can put something in the place of a folder, or of one above it.

    Those that do not exist are safe; OSError says that the way cannot be followed. A folder with the sticky bit, as
    /tmp, is safe; so is one that its owner's private group may write to, which is what some systems begin a home with,
    unless it is the one just above.
    """
    if not HAS_OWNERS:
        return
    if links > MOST_LINKS:
        raise UntrustedError(f"{folder} is reached by more than {MOST_LINKS} symbolic links")
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
    """Return whether others may rename what is in a folder."""
    if status.st_mode & stat.S_ISVTX:
        return False
    private = private_allowed and not status.st_mode & stat.S_IWOTH and _is_private(status.st_gid)
    return bool(status.st_mode & OTHERS_WRITE) and not private


@cache
def _is_private(group: int) -> bool:
    """Return whether a group is root's, or this user's alone: by convention it is named after the user."""
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
