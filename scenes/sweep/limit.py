"""Time limit of a case, so that a case that never ends does not block the other cases.

A case that exceeds the limit is ended after its current step. If the step does not end, a worker process ends itself,
and Dask starts a new one. This is done by a thread of `faulthandler`, which works even if the Python interpreter is
blocked. Before the process ends, the thread writes a file, from which the next try of the case learns that the case has
used up its time. The time is counted from the first step, so that it does not include compilation.
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
"""Longest time from the beginning of a case to its first step on a worker [s]. After this time the worker counts as
stuck. Compiling all functions takes up to 120 s on a busy machine. With half this time, cases could fail on slow
machines. With twice this time, a stuck case would block a worker longer."""
LONGEST_STEP = 5.0
"""Time after the limit for a case on a worker to finish its step and write its file [s]. With half this time, a
case with a large file on a slow disc could fail. With twice this time, a stuck case would block a worker longer."""

_witness: IO[Any] | None = None
"""Open file of the current case on this worker. `faulthandler` writes to this file if it ends the process."""


class Clock:
    """Time of a case, counted from the first step."""

    def __init__(self, limit_s: float) -> None:
        self._limit, self._begun = limit_s, 0.0

    @property
    def is_over(self) -> bool:
        """Whether the time has exceeded the limit."""
        return bool(self._begun) and time.monotonic() > self._begun + self._limit

    def looks(self) -> bool:
        """Return whether the case may continue. Call it after each step; the first call starts the clock."""
        if not self._begun:
            self._begun = time.monotonic()
            _end_process_after(self._limit + LONGEST_STEP)
        return not self.is_over


def told(limit_s: float) -> str:
    """Return the reason for the failure of a case that exceeded the limit."""
    return f"took longer than {limit_s:g} s, the time limit of a case: give cases more time by --case-limit-s"


def limit_of(sweep: Any, asked: float | None) -> float:
    """Return the time limit of the cases [s]: `asked` if given, otherwise the limit in the section [sweep].

    Raises
    ------
    SceneError
        If the limit is not positive, or is too long.
    """
    limit = float(sweep.get("case_limit_s", CASE_LIMIT) if asked is None else asked)
    if not 0.0 < limit <= LONGEST_CASE_LIMIT:
        raise SceneError(f"--case-limit-s: got {limit:g} s, must be above 0 and at most {LONGEST_CASE_LIMIT:g} s")
    return limit


@contextmanager
def ended_when_stuck(path: Path, limit_s: float) -> Iterator[bool]:
    """Context that ends this process if the case in it never ends; yield whether an earlier try was ended.

    `path` is the file of the case. The context may only be used in worker processes that run a single case at a time.
    Raise DiscError if the folder is not writable.
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
    """Set the time after which the worker process is ended [s]. A later call replaces this time."""
    if _witness is not None:
        faulthandler.dump_traceback_later(seconds, exit=True, file=_witness)
