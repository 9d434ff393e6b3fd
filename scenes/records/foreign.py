"""Results that other programs wrote anew, or that are damaged at their end: read where they can do no harm.

A few wrong bytes let the HDF5 library loop for ever, ask for all memory or crash. So such a file is first read by a
process with little time and memory, which hands it on as worm3d writes it: `python -m scenes.records.foreign RESULT`.
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from scenes.language.errors import SceneError
from worm3d.values.memory import MOST_MEMORY

PATIENCE = 60
"""Longest time to read a file [s]."""
MEMORY = 3 * int(MOST_MEMORY)
"""A run's arrays, another copy of them, and programs [byte]."""


def checked(path: Path) -> bytes:
    """Return a result as worm3d writes it.

    Raises
    ------
    SceneError
        It is not one, it is damaged, or it cannot be read in time.
    """
    command = [sys.executable, "-P", "-m", "scenes.records.foreign", str(path.resolve()), str(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False, stdin=subprocess.DEVNULL)
    except subprocess.TimeoutExpired as error:
        raise SceneError(f"{path}: not a result of worm3d, or damaged: not read after {PATIENCE} s") from error
    if done.returncode == 0:
        return done.stdout
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    if done.returncode == SceneError.exit_code and said:
        raise SceneError(*said)
    raise SceneError(f"{path}: not a result of worm3d, or damaged: the HDF5 library fails on it")


def main() -> None:
    """Read the file that the first argument names, and write it to standard output."""
    from scenes.records.store import as_bytes, read

    _restrict()
    try:
        record, verified = read(Path(sys.argv[1]), sys.argv[2])
    except SceneError as error:
        sys.stderr.write("\n".join(error.lines))
        sys.exit(error.exit_code)
    sys.stdout.buffer.write(as_bytes(record, verified=verified))


def _restrict() -> None:
    """Limit the memory and time of this process, where the system can."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        for limit, value in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CPU, PATIENCE), (resource.RLIMIT_CORE, 0)):
            resource.setrlimit(limit, (value, value))


if __name__ == "__main__":
    main()
