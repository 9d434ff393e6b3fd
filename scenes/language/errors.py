"""Mistakes of the user and failures of the machine, reported as sentences without a traceback."""

from __future__ import annotations


def printable(text: str, most: int = 1000) -> str:
    """Return a line of text that is safe to print on a terminal.

    Control characters are escaped. If the text has more than `most` characters, its middle is left out.
    """
    shown = "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)
    return shown if len(shown) <= most else f"{shown[: most // 2]} ... {shown[-(most // 2) :]}"


class SceneError(Exception):
    """A mistake that the user can correct: a bad scene, a bad argument, or a file that is not a result."""

    exit_code = 2
    """Exit code of the command line."""

    def __init__(self, *lines: str) -> None:
        self.lines = tuple(map(printable, lines))
        """Sentences to print. They may quote the content of files; `printable` has made them safe to print."""
        super().__init__("\n".join(self.lines))


class DiscError(SceneError):
    """A file or folder cannot be written or read, for example for lack of space or permission."""

    exit_code = 1

    @classmethod
    def writing(cls, path: object, error: OSError) -> DiscError:
        """Return the error for a failed attempt to write `path`."""
        return cls(f"cannot write {path}: {(error.strerror or str(error)).lower()}")


class MissingPartError(SceneError):
    """An optional program or package is missing; the sentence tells the user how to install it."""

    exit_code = 4
