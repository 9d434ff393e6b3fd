"""Mistakes of the user and failures of the machine, as sentences; nobody sees a traceback for one of these."""

from __future__ import annotations


class SceneError(Exception):
    """A mistake that the user can mend: a bad scene, a bad argument, a file that is not a result.

    Attributes
    ----------
    lines : tuple of str
        What to print, a sentence each.
    exit_code : int
        What the command line ends with.
    """

    exit_code = 2

    def __init__(self, *lines: str) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


class DiscError(SceneError):
    """A file or folder cannot be written (or read): no space, no permission."""

    exit_code = 1

    @classmethod
    def writing(cls, path: object, error: OSError) -> DiscError:
        """Return the error for a failed attempt to write `path`."""
        return cls(f"cannot write {path}: {(error.strerror or str(error)).lower()}")


class MissingPartError(SceneError):
    """An optional program or package is missing; the sentence says how to get it."""

    exit_code = 4
