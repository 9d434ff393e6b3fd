"""Entry point of the command line `worm3d`: what goes wrong becomes a sentence and an exit code.

Imports nothing slow before it listens for Ctrl-C.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence

from scenes.language.errors import SceneError

INTERRUPTED = 130
"""What a command ends with that was stopped by Ctrl-C."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: the entry point of the console script."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # and not what a test put in its place
            stream.reconfigure(errors="backslashreplace")  # what the terminal's encoding lacks is shown as an escape
    try:
        from scenes.commands.packages import require_own_packages

        require_own_packages()
        from scenes.commands.app import app

        app(args=arguments)
    except SceneError as error:
        for line in error.lines:
            print(line, file=sys.stderr)  # noqa: T201 - typer may not be there
        sys.exit(error.exit_code)
    except KeyboardInterrupt:  # during the imports; while a command runs, typer ends with the same code
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
