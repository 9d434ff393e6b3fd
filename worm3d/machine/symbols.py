"""Names that object code takes from the loading process: a process without a name would call address 0.

A compiling Numba registers additional names, such as `numba_attempt_nocopy_reshape`. A fresh process reads the code
from disk, never imports Numba, and does not have these names.
"""

from __future__ import annotations

import ctypes
import functools
import struct
import sys
from collections.abc import Iterable, Iterator
from typing import Any

_ELF = b"\x7fELF\2\1"
"""Beginning of a 64-bit object for Linux, with the least byte first."""
_SYMBOL_TABLE = 2
_UNDEFINED = 0


def missing(objects: Iterable[bytes], named: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the names that objects need, and that neither the objects nor a fresh process have.

    Parameters
    ----------
    objects : iterable of bytes
        Objects that are loaded together. The tables of names are read if the format is ELF, as on Linux.
    named : iterable of str
        Other names that the objects need.
    """
    found = [each for code in objects if code.startswith(_ELF) for each in _symbols(code)]
    needed = {name for name, section in found if section == _UNDEFINED} | set(named)
    own = {name for name, section in found if section != _UNDEFINED}
    return tuple(sorted(name for name in needed - own if not hasattr(c_library(), name)))


@functools.cache
def c_library() -> Any:
    """Return the C library, on Linux and macOS with all other names of a fresh process."""
    return ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)


def _symbols(code: bytes) -> Iterator[tuple[str, int]]:
    """Yield each name of an object's table, with the number of the section that defines it."""
    (at,), (count,) = struct.unpack_from("<Q", code, 40), struct.unpack_from("<H", code, 60)
    sections = [struct.unpack_from("<IIQQQQIIQQ", code, at + 64 * k) for k in range(count)]
    for _, kind, _, _, begin, size, link, *_ in sections:
        if kind == _SYMBOL_TABLE:
            for offset, _, _, section, _, _ in struct.iter_unpack("<IBBHQQ", code[begin : begin + size]):
                first = sections[link][4] + offset
                if offset:
                    yield code[first : code.index(b"\0", first)].decode(), section
