"""Entry point of the command line `worm3d`. Errors of the user are printed as sentences, with an exit code.

Modules whose import takes long are imported only after the handler for Ctrl-C has been set.
"""

from __future__ import annotations

import atexit
import io
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from scenes.language.errors import SceneError

INTERRUPTED_CODE = 130
"""Exit code of a command that was stopped by Ctrl-C."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit. This is the entry point of the console script."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # tests replace the streams by other classes
            stream.reconfigure(errors="backslashreplace")  # characters that the terminal cannot show are escaped
    with _listening() as pressed:
        try:
            from scenes.running.packages import require_own_packages

            require_own_packages()
            from scenes.commands.app import app

            app(args=arguments)
        except KeyboardInterrupt:  # during the imports; later, typer handles Ctrl-C and uses the same exit code
            sys.exit(INTERRUPTED_CODE)
        except Exception as error:
            if pressed:  # compiled libraries, such as CasADi, turn Ctrl-C into a RuntimeError or SystemError
                sys.exit(INTERRUPTED_CODE)
            if not isinstance(error, SceneError):
                raise
            for line in error.lines:
                print(line, file=sys.stderr)  # noqa: T201 - typer may be missing
            sys.exit(error.exit_code)


@contextmanager
def _listening() -> Iterator[list[int]]:
    """Context where Ctrl-C raises KeyboardInterrupt, as usual, and also adds an item to the yielded list."""
    pressed: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        signal.default_int_handler(number, frame)

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield pressed  # the signal is ignored, or has another handler
        return
    signal.signal(signal.SIGINT, note)
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)  # a late Ctrl-C would change the exit code
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN if pressed else before)


if __name__ == "__main__":
    main()
