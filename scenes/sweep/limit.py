"""Time limit of a case, so that a case that never ends does not block the other cases.

A case that exceeds the limit is ended between two steps. On a worker, even a step that never ends is ended, by ending
the process, which Dask replaces: `faulthandler` does this in a thread that works without Python. The file written
before shows the next try of the case that the time has been used up. The time counts from the first step on, so that
compilation is not included.
"""

from __future__ import annotations

import faulthandler
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from scenes.language.errors import SceneError
from scenes.language.sweep_section import CASE_LIMIT, LONGEST_CASE_LIMIT
from scenes.records.folder import TEMPORARY_PREFIX, disc_errors

LONGEST_START = 600.0
"""Time from the beginning of a case to the first step after which a worker counts as stuck [s]: compiling all kernels
takes up to 120 s on a busy machine. With half this time slow machines fail, with double stuck cases block a worker
longer."""
LONGEST_STEP = 5.0
"""Time beyond the limit for a case on a worker to finish a step and write the file [s]. With half this time large files
on a slow disc fail, with double a stuck case blocks a worker longer."""

_witness: IO[Any] | None = None
"""File of the case on this worker, to be written when the process is ended."""


class Clock:
    """Time of a case, counted from the first step."""

    def __init__(self, limit_s: float) -> None:
        self._limit, self._begun = limit_s, 0.0

    @property
    def is_over(self) -> bool:
        """Whether the time has exceeded the limit [s]."""
        return bool(self._begun) and time.monotonic() > self._begun + self._limit

    def looks(self) -> bool:
        """Record a step, and return whether the case may continue."""
        if not self._begun:
            self._begun = time.monotonic()
            _end_process_after(self._limit + LONGEST_STEP)
        return not self.is_over


def told(limit_s: float) -> str:
    """Return the reason for the failure of a case that exceeded the limit."""
    return f"took longer than {limit_s:g} s, the time limit of a case: give it longer by --case-limit-s"


def limit_of(sweep: Any, asked: float | None) -> float:
    """Return the time limit of the cases [s]: the given limit, or the limit in the section [sweep].

    Raises
    ------
    SceneError
        The limit is not above 0, or too long.
    """
    limit = float(sweep.get("case_limit_s", CASE_LIMIT) if asked is None else asked)
    if not 0.0 < limit <= LONGEST_CASE_LIMIT:
        raise SceneError(f"--case-limit-s: got {limit:g} s, must be above 0 and at most {LONGEST_CASE_LIMIT:g} s")
    return limit


@contextmanager
def ended_when_stuck(path: Path, limit_s: float) -> Iterator[bool]:
    """End this process if the case with the file `path` never ends; yield whether an earlier try was ended.

    Only for worker processes that run one case at a time. DiscError if the folder is not writable.
    """
    global _witness
    witness = path.with_name(f"{TEMPORARY_PREFIX}{path.stem}.late.part")
    if witness.is_file() and witness.stat().st_size:
        yield True
        return
    with disc_errors(path):
        _witness = witness.open("w")
    try:
        with _witness:
            _end_process_after(LONGEST_START + limit_s)
            yield False
    finally:
        faulthandler.cancel_dump_traceback_later()
        _witness = None
        witness.unlink(missing_ok=True)


def _end_process_after(seconds: float) -> None:
    """End the worker's process after a time, which replaces the time set before."""
    if _witness is not None:
        faulthandler.dump_traceback_later(seconds, exit=True, file=_witness)
