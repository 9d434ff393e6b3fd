"""Time limit of a case: one that never ends keeps no others from being run.

A case is ended between two steps where it has taken longer. On a worker even a step that never ends is ended, by ending
the process, which Dask replaces: `faulthandler` does so in a thread that needs nothing of Python. What it writes before
tells the next try of the case that it has had its time. The time counts from the first step on, so that compiling is no
part of it.
"""

from __future__ import annotations

import faulthandler
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from scenes.language.errors import DiscError, SceneError
from scenes.language.sweep_section import CASE_LIMIT, LONGEST_CASE_LIMIT
from scenes.records.folder import PREFIX

LONGEST_START = 600.0
"""Time from the begin of a case to its first step after which a worker counts as stuck [s]: compiling all kernels takes
up to 120 s on a busy machine. With half of it slow machines fail, with double stuck cases hold up a worker longer."""
LONGEST_STEP = 5.0
"""Time beyond its limit that a case on a worker has to end its step and write its file [s]. With half of it large files
on a slow disc fail, with double a stuck case holds up a worker longer."""

_witness: IO[Any] | None = None
"""File of the case that this worker runs, to be written as the process is ended."""


class Clock:
    """Time of a case, from its first step on."""

    def __init__(self, limit_s: float) -> None:
        self._limit, self._begun = limit_s, 0.0

    @property
    def is_over(self) -> bool:
        """Whether the case has taken longer than its limit [s]."""
        return bool(self._begun) and time.monotonic() > self._begun + self._limit

    def looks(self) -> bool:
        """Take note of a step; return whether the case may go on."""
        if not self._begun:
            self._begun = time.monotonic()
            _end_process_after(self._limit + LONGEST_STEP)
        return not self.is_over


def told(limit_s: float) -> str:
    """Return why a case failed that took longer than its limit."""
    return f"took longer than {limit_s:g} s, the time limit of a case: give it longer by --case-limit-s"


def limit_of(sweep: Any, asked: float | None) -> float:
    """Return the time limit of the cases [s]: as asked for, or as the section [sweep] of the scene says.

    Raises
    ------
    SceneError
        It is not above 0, or too long.
    """
    limit = float(sweep.get("case_limit_s", CASE_LIMIT) if asked is None else asked)
    if not 0.0 < limit <= LONGEST_CASE_LIMIT:
        raise SceneError(f"--case-limit-s: got {limit:g} s, must be above 0 and at most {LONGEST_CASE_LIMIT:g} s")
    return limit


@contextmanager
def ended_when_stuck(path: Path, limit_s: float) -> Iterator[bool]:
    """Have this process ended if a case, of which the file is `path`, never ends; gives whether one was before.

    For processes of a worker only, in which one case is run at a time. DiscError where nothing can be written there.
    """
    global _witness
    witness = path.with_name(f"{PREFIX}{path.stem}.late.part")
    if witness.is_file() and witness.stat().st_size:
        yield True
        return
    try:
        _witness = witness.open("w")
    except OSError as error:
        raise DiscError.writing(path, error) from error
    try:
        with _witness:
            _end_process_after(LONGEST_START + limit_s)
            yield False
    finally:
        faulthandler.cancel_dump_traceback_later()
        _witness = None
        witness.unlink(missing_ok=True)


def _end_process_after(seconds: float) -> None:
    """Have a worker's process ended after some time from now, instead of what was said before."""
    if _witness is not None:
        faulthandler.dump_traceback_later(seconds, exit=True, file=_witness)
