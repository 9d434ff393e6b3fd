"""Stand-ins for objects of Numba until the first compilation, so that Numba is imported only when it is needed.

Importing Numba takes half a second, which is longer than loading code from disk.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_waiting: list[tuple[Any, Callable[[], Any]]] = []
_made: list[Any] = []


def later(stand_in: Any, make: Callable[[], Any]) -> Any:
    """Replace `stand_in` in compiled code by the object of Numba that `make` returns. Return `stand_in`."""
    _waiting.append((stand_in, make))
    return stand_in


def placeholder(make: Callable[[], Any]) -> Any:
    """Return a function that stands for an object of Numba in compiled code."""

    def stand_in(*_: Any) -> Any:
        raise TypeError("this is for compiled code")

    return later(stand_in, make)


def ready() -> None:
    """Make all objects for which stand-ins wait."""
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()
    while _waiting:
        stand_in, make = _waiting.pop(0)
        _made.append(make())
        cpu_target.typing_context.refresh()
        stand_in._numba_type_ = cpu_target.typing_context.resolve_value_type(_made[-1])  # Numba reads types here


class _Utils:
    """Functions of Numba that help to write code. They need no stand-ins."""

    def __getattr__(self, name: str) -> Any:
        from numba.core import cgutils

        return getattr(cgutils, name)


utils: Any = _Utils()


def _carray() -> Any:
    import numba

    return numba.carray  # type: ignore[attr-defined]  # not listed in its __all__


carray: Any = placeholder(_carray)
"""`numba.carray` in compiled code."""
