"""Stand-ins for Numba's objects until the first compilation: Numba is not imported earlier.

Importing Numba takes half a second, longer than loading code from disk.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_waiting: list[tuple[Any, Callable[[], Any]]] = []
_made: list[Any] = []


def later(stand_in: Any, make: Callable[[], Any]) -> Any:
    """Make compiled code use Numba's object returned by `make` in place of `stand_in`; return `stand_in`."""
    _waiting.append((stand_in, make))
    return stand_in


def placeholder(make: Callable[[], Any]) -> Any:
    """Return a stand-in for an object of Numba's in compiled code."""

    def stand_in(*_: Any) -> Any:
        raise TypeError("this is for compiled code")

    return later(stand_in, make)


def ready() -> None:
    """Make all waiting objects."""
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()
    while _waiting:
        stand_in, make = _waiting.pop(0)
        _made.append(make())
        cpu_target.typing_context.refresh()
        stand_in._numba_type_ = cpu_target.typing_context.resolve_value_type(_made[-1])  # Numba reads types here


class _Utils:
    """Numba's helpers for writing code, which have no types."""

    def __getattr__(self, name: str) -> Any:
        from numba.core import cgutils

        return getattr(cgutils, name)


utils: Any = _Utils()


def _carray() -> Any:
    import numba

    return numba.carray  # type: ignore[attr-defined]  # not listed in its __all__


carray: Any = placeholder(_carray)
"""`numba.carray`, for compiled code."""
