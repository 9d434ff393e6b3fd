"""Data of a page as short text: a list of byte strings, compressed."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable


def packed(parts: Iterable[bytes]) -> str:
    """Return byte strings as one text. It is the compressed result of `joined`."""
    return base64.b64encode(zlib.compress(joined(parts))).decode("ascii")


def joined(parts: Iterable[bytes]) -> bytes:
    """Return byte strings as one. Each string follows its length in four bytes (`u32`)."""
    return b"".join(len(part).to_bytes(4, "little") + part for part in parts)
