"""Object code in the package for some kinds of processors, so that these need not compile at the first start.

`python tests/worm3d/packing.py` makes this code. As in the cache, the key of the code contains the digest of the
sources, and a checksum verifies it. Code that belongs to other sources is ignored.
"""

from __future__ import annotations

import lzma
import sys
import tarfile
from functools import cache
from pathlib import Path

import llvmlite

from worm3d.machine.cache import files
from worm3d.machine.codegen import native

PACKED_PROCESSORS = ("x86-64-v4", "x86-64-v3")
"""Kinds of processors with packed code, the best kind first."""
PACKED_FOLDER = Path(__file__).with_name("packed")
MADE_WITH = "made_with"
"""Entry of an archive that lists the versions of the tools, one per line, such as `llvmlite 0.50.0`."""


def kind_of(host: native.Host) -> native.Host | None:
    """Return the best kind of processor whose code runs on a host; None for another family of processors."""
    known = set(host.features.split(","))
    for name in PACKED_PROCESSORS:
        if known.issuperset(f"+{each}" for each in native.FEATURES[name]) and sys.platform == "linux":
            return native.kind(name)
    return None


def load(key: str, kind: native.Host) -> bytes | None:
    """Return the code under a key, or None if there is none or it is damaged."""
    content = content_of(archive(kind.cpu)).get(f"{key}.kernel")
    try:
        return None if content is None else files.verified(key, content)
    except files.DamagedError:
        return None


def reason() -> str:
    """Return the reason why packed code is not used, if this is another version of llvmlite; otherwise ""."""
    kind = kind_of(native.this_host())
    made = content_of(archive(kind.cpu)).get(MADE_WITH, b"").decode().splitlines() if kind else []
    others = [line for line in made if line.startswith("llvmlite ") and line != f"llvmlite {llvmlite.__version__}"]
    return f"; the compiled solver that comes with it is for {others[0]}, not {llvmlite.__version__}" if others else ""


def archive(kind: str) -> Path:
    """Return the path of the archive for a kind of processor."""
    return PACKED_FOLDER / f"{kind}.tar.xz"


@cache
def content_of(place: Path) -> dict[str, bytes]:
    """Return the files of an archive by name; empty if the archive cannot be read."""
    try:
        with tarfile.open(place) as opened:
            return {each.name: file.read() for each in opened if (file := opened.extractfile(each)) is not None}
    except (OSError, tarfile.TarError, EOFError, lzma.LZMAError):
        return {}
