"""Object code that comes with the package, for processors of a kind: who has it need not compile at the first start.

It is made by `python tests/worm3d/packing.py`. Code is found under the digest of its sources, as in the cache, and
verified by a checksum: of other sources it is ignored.
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

KINDS = ("x86-64-v4", "x86-64-v3")
"""Kinds of processors that there is code for, the best one first."""
FOLDER = Path(__file__).with_name("packed")
MADE_WITH = "made_with"
"""Entry of an archive that lists the versions it was made with, as `llvmlite 0.50.0`, a line each."""


def kind_of(host: native.Host) -> native.Host | None:
    """Return the best kind of processor for which a host's code may be made, None for another family."""
    known = set(host.features.split(","))
    for name in KINDS:
        if known.issuperset(f"+{each}" for each in native.FEATURES[name]) and sys.platform == "linux":
            return native.kind(name)
    return None


def load(key: str, kind: native.Host) -> bytes | None:
    """Return the code under a key, or None."""
    content = content_of(archive(kind.cpu)).get(f"{key}.kernel")
    try:
        return None if content is None else files.verified(key, content)
    except files.DamagedError:
        return None


def reason() -> str:
    """Return why nothing that comes with the package is used, as far as versions say it; else ""."""
    kind = kind_of(native.this_host())
    made = content_of(archive(kind.cpu)).get(MADE_WITH, b"").decode().splitlines() if kind else []
    others = [line for line in made if line.startswith("llvmlite ") and line != f"llvmlite {llvmlite.__version__}"]
    return f"; the compiled solver that comes with it is for {others[0]}, not {llvmlite.__version__}" if others else ""


def archive(kind: str) -> Path:
    """Return the place of the archive for a kind of processor."""
    return FOLDER / f"{kind}.tar.xz"


@cache
def content_of(place: Path) -> dict[str, bytes]:
    """Return the files of an archive by name, none where it cannot be read."""
    try:
        with tarfile.open(place) as opened:
            return {each.name: file.read() for each in opened if (file := opened.extractfile(each)) is not None}
    except (OSError, tarfile.TarError, EOFError, lzma.LZMAError):
        return {}
