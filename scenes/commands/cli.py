"""Entry point of the command line `worm3d`: what goes wrong becomes a sentence and an exit code.

Imports nothing slow before it listens for Ctrl-C.
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

INTERRUPTED = 130
"""What a command ends with that was stopped by Ctrl-C."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: the entry point of the console script."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # and not what a test put in its place
            stream.reconfigure(errors="backslashreplace")  # what the terminal's encoding lacks is shown as an escape
    with _listening() as pressed:
        try:
            from scenes.running.packages import require_own_packages

            require_own_packages()
            from scenes.commands.app import app

            app(args=arguments)
        except KeyboardInterrupt:  # during the imports; while a command runs, typer ends with the same code
            sys.exit(INTERRUPTED)
        except Exception as error:
            if pressed:  # in compiled libraries: CasADi, for one, makes a RuntimeError or a SystemError of it
                sys.exit(INTERRUPTED)
            if not isinstance(error, SceneError):
                raise
            for line in error.lines:
                print(line, file=sys.stderr)  # noqa: T201 - typer may not be there
            sys.exit(error.exit_code)


@contextmanager
def _listening() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt at Ctrl-C, as Python does, and note it in the list that is given."""
    pressed: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        signal.default_int_handler(number, frame)

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield pressed  # it is ignored, or somebody else's
        return
    signal.signal(signal.SIGINT, note)
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)  # Ctrl-C as Python ends would change the exit code
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN if pressed else before)


if __name__ == "__main__":
    main()
