"""Mistakes of the user and failures of the machine, as sentences; nobody sees a traceback for one of these."""

from __future__ import annotations

LONGEST = 1000
"""Largest number of characters of a line of output; a longer one loses its middle."""


def printable(text: str) -> str:
    """Return a text of one line as a terminal may show it: control characters and the like as escapes, not too long."""
    shown = "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)
    return shown if len(shown) <= LONGEST else f"{shown[: LONGEST // 2]} ... {shown[-LONGEST // 2 :]}"


class SceneError(Exception):
    """A mistake that the user can mend: a bad scene, a bad argument, a file that is not a result."""

    exit_code = 2
    """Exit code of the command line."""

    def __init__(self, *lines: str) -> None:
        self.lines = tuple(map(printable, lines))
        """Sentences to print, `printable` whatever of a file's content is in them."""
        super().__init__("\n".join(self.lines))


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
