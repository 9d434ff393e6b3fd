"""Object code that comes with the package, for processors of a kind: who has it need not compile at the first start.

    python -m worm3d.machine.packed

makes it anew, for the kinds that the processor can run: two files of less than 100 kB. Code is found under the digest
of its sources, as in the cache, and verified by a checksum: of other sources it is ignored. The command makes the
same bytes from the same sources.
"""

from __future__ import annotations

import io
import lzma
import os
import subprocess
import sys
import tarfile
import tempfile
from functools import cache
from pathlib import Path

from worm3d.machine.cache import files
from worm3d.machine.codegen import native

_V3 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
KINDS = {"x86-64-v4": (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"), "x86-64-v3": _V3}
"""Features of the processors of each kind, the best first."""
FOLDER = Path(__file__).with_name("packed")
RUNS = """
import sys
import worm3d
from worm3d.machine.codegen import native
kind = native.Host(sys.argv[1], "", int(sys.argv[2]), True)
native.this_host = lambda: kind
command = lambda t: worm3d.Command(contraction=[[0.1, 0.1]] * 6)
for more in ({}, {"observer": lambda t, view: view.com, "every": 1, "record_every": 2}, {"accuracy": 0.05}):
    worm3d.simulate(worm3d.Worm(), worm3d.Plane(0.1), duration=0.02, actuation=command, **more)
"""
"""Runs that call what is packed."""


def kind_of(host: native.Host) -> native.Host | None:
    """Return the best kind of processor for which a host's code may be made, None for another family."""
    known = set(host.features.split(","))
    for name, needed in KINDS.items():
        if known.issuperset(f"+{each}" for each in needed) and sys.platform == "linux":
            return _host(name)
    return None


def _host(name: str) -> native.Host:
    return native.Host(name, "", 8 if name.endswith("4") else 4, True)


def load(key: str, kind: native.Host) -> bytes | None:
    """Return the code under a key, or None."""
    content = _content(kind.cpu).get(f"{key}.kernel")
    try:
        return None if content is None else files.verified(key, content)
    except files.DamagedError:
        return None


@cache
def _content(name: str) -> dict[str, bytes]:
    try:
        with tarfile.open(FOLDER / f"{name}.tar.xz") as archive:
            return {each.name: file.read() for each in archive if (file := archive.extractfile(each)) is not None}
    except (OSError, tarfile.TarError, EOFError, lzma.LZMAError):
        return {}


def make() -> None:
    """Compile what is packed for each kind, and write its archive."""
    FOLDER.mkdir(exist_ok=True)
    for name in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            chosen = {"XDG_CACHE_HOME": folder, "NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""}
            command = [sys.executable, "-c", RUNS, name, str(_host(name).width)]
            (FOLDER / f"{name}.tar.xz").unlink(missing_ok=True)
            subprocess.run(command, env=os.environ | chosen, check=True)
            with tarfile.open(FOLDER / f"{name}.tar.xz", "w:xz") as archive:
                for path in sorted((Path(folder) / "worm3d" / "compiled").glob("*.kernel")):
                    content = path.read_bytes()
                    entry = tarfile.TarInfo(path.name)
                    entry.size = len(content)
                    archive.addfile(entry, io.BytesIO(content))


if __name__ == "__main__":
    make()
