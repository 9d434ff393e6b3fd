"""Makes the object code that comes with the package (`worm3d.machine.packed`).

    python tests/worm3d/packing.py

makes it for all kinds of processors, on any Linux machine of their family: two files of less than 200 kB. `--check`
makes it too, and compares it with what is there, byte for byte: the same sources and versions make the same bytes.
`--keys` takes seconds: the keys, which are digests of the sources, have to be those of the archives.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import io
import multiprocessing
import platform
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

from worm3d.machine import packed
from worm3d.machine.cache import files
from worm3d.machine.codegen import native
from worm3d.machine.functions import Function, joined

RUNS = """
import worm3d
command = lambda t: worm3d.Command(contraction=[[0.1, 0.1]] * 6)
for more in ({}, {"observer": lambda t, view: view.com, "every": 1, "record_every": 2}, {"accuracy": 0.05}):
    worm3d.simulate(worm3d.Worm(), worm3d.Plane(0.1), duration=0.02, actuation=command, **more)
problem = worm3d.Problem(worm=worm3d.Worm(), world=worm3d.Plane(0.1), duration=0.02)
worm3d.sensitivities(problem, lambda p: lambda t: worm3d.Command(contraction=[[p[0], p[0]]] * 6), [0.1])
"""
"""Runs that call every function of the archives."""
Call = tuple[Function, Any, Any]
"""A function with the arguments and the result that it is built for."""


def make(folder: Path) -> None:
    """Write an archive of each kind into a folder.

    The functions are those that the runs call on this processor. The code that is made is not run.
    """
    subprocess.run([sys.executable, "-c", RUNS], check=True)  # compiles, so that Numba is fresh in what is forked below
    calls = _called()
    forks = multiprocessing.get_context("fork")
    makers = [
        forks.Process(target=_make, args=(folder / packed.archive(name).name, name, calls))
        for name in packed.PACKED_PROCESSORS
    ]
    for each in makers:
        each.start()
    for each in makers:
        each.join()
    if any(each.exitcode for each in makers):
        raise RuntimeError("object code could not be made, for the reason above")


def _called() -> list[Call]:
    calls: list[Call] = []
    built = Function._built

    def noted(self: Function, args: Any, result: Any = None) -> int:
        calls.append((self, args, result))
        return built(self, args, result)

    Function._built = noted  # type: ignore[method-assign]
    exec(RUNS, {})
    Function._built = built  # type: ignore[method-assign]
    if "numba" in sys.modules:
        raise RuntimeError(
            "the runs compile: the object code is not of these sources (run 'python tests/worm3d/packing.py'), or the "
            "cache does not keep what is compiled (set XDG_CACHE_HOME to a folder of your own)"
        )
    return calls


def _make(place: Path, kind: str, calls: list[Call]) -> None:
    host, made = native.kind(kind), {packed.MADE_WITH: _versions().encode()}
    for function, args, result in calls:
        key = function.key(args, result, host)
        if f"{key}.kernel" not in made:
            objects, lacking = function.compiled(args, result, host)
            if lacking:
                raise RuntimeError(f"{function} calls {', '.join(lacking)}, which only a compiling Numba has")
            made[f"{key}.kernel"] = files.signed(key, joined(objects))
    with tarfile.open(place, "w:xz") as opened:
        for name, content in sorted(made.items()):
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            opened.addfile(entry, io.BytesIO(content))


def _versions() -> str:
    """Return the versions that the bytes depend on besides the sources, a line each."""
    known = {name: importlib.metadata.version(name) for name in ("llvmlite", "numba", "numpy")}
    known["Python"] = ".".join(platform.python_version_tuple()[:2])
    return "\n".join(f"{name} {version}" for name, version in known.items())


def compare(there: Path, anew: Path) -> tuple[bool, str]:
    """Return whether an archive may be as it is, and a sentence on how it compares with one that was made anew."""
    old, new = packed.content_of(there), packed.content_of(anew)
    versions = old.get(packed.MADE_WITH, b"").decode()
    if old == new:
        return True, f"all {len(new) - 1} objects are the same when made anew, byte for byte"
    if versions != _versions() and old.keys() == new.keys():
        return True, f"not compared, for it was made with {', '.join(versions.splitlines())}; the keys are the same"
    different = sum(old.get(name) != content for name, content in new.items())
    return False, f"{different} of {len(new)} entries differ: run 'python tests/worm3d/packing.py'"


def compare_keys(name: str, calls: list[Call]) -> tuple[bool, str]:
    """Return whether an archive has the functions of some calls, for the sources as they are, and a sentence."""
    host, there = native.kind(name), packed.content_of(packed.archive(name))
    keys = {f"{function.key(args, result, host)}.kernel" for function, args, result in calls}
    if keys == there.keys() - {packed.MADE_WITH}:
        return True, f"all {len(keys)} objects are of these sources"
    return False, f"{len(keys - there.keys())} of {len(keys)} objects lack: run 'python tests/worm3d/packing.py'"


def main() -> int:
    """Make the archives, or compare those that are there; return 1 where they differ."""
    parser = argparse.ArgumentParser(description="Makes the object code that comes with the package.")
    parser.add_argument("--check", action="store_true", help="compare what is there, write nothing")
    parser.add_argument("--keys", action="store_true", help="compare the keys alone")
    given = parser.parse_args()
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        sys.stdout.write(f"skipped: code for {' and '.join(packed.PACKED_PROCESSORS)} is made on Linux on x86-64\n")
        return 0
    if given.keys:
        subprocess.run([sys.executable, "-c", RUNS], check=True)  # whatever the archives lack is compiled here
        calls = _called()
        found = {name: compare_keys(name, calls) for name in packed.PACKED_PROCESSORS}
    elif given.check:
        with tempfile.TemporaryDirectory() as anew:
            make(Path(anew))
            found = {
                name: compare(packed.archive(name), Path(anew) / packed.archive(name).name)
                for name in packed.PACKED_PROCESSORS
            }
    else:
        make(packed.PACKED_FOLDER)
        return 0
    sys.stdout.writelines(f"{name}: {sentence}\n" for name, (_, sentence) in found.items())
    return int(not all(same for same, _ in found.values()))


if __name__ == "__main__":
    sys.exit(main())
