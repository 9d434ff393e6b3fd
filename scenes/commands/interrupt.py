"""Ctrl-C asks a run to stop after the step at hand; a second one stops it at once."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """While entered, the first SIGINT or SIGTERM only sets `requested`; after it the old behaviour is back.

    Attributes
    ----------
    requested : bool
        Whether the user wants the run to stop.
    """

    def __init__(self) -> None:
        self.requested = False
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._previous = {s: signal.signal(s, self._note) for s in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._restore()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.requested = True
        self._restore()

    def _restore(self) -> None:
        # An ignored SIGINT (a background job) would make the second Ctrl-C powerless.
        for number, handler in self._previous.items():
            ignored = number == signal.SIGINT and handler in (signal.SIG_IGN, None)
            signal.signal(number, signal.default_int_handler if ignored else handler or signal.SIG_DFL)
        self._previous = {}
