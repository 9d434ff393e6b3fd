"""Object code that comes with the package: who has it compiles nothing, and whatever is wrong with it is ignored."""

import io
import subprocess
import sys
import tarfile
from pathlib import Path

import numpy as np
import pytest
from kept_files import double, fresh, total

from worm3d.machine import packed
from worm3d.machine.codegen import Host, native
from worm3d.machine.functions import Function

V4 = ",".join(f"+{each}" for each in packed.KINDS["x86-64-v4"])
V3 = ",".join(f"+{each}" for each in packed.KINDS["x86-64-v3"])
HERE = packed.kind_of(native.this_host())


@pytest.fixture
def archive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The archive of this processor's kind, with what `fresh` calls, beside an empty cache."""
    if HERE is None:
        pytest.skip("nothing is packed for this processor")
    monkeypatch.setattr(packed, "FOLDER", tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "one"))
    packed._content.cache_clear()
    with monkeypatch.context() as compiling:
        compiling.setattr(native, "this_host", lambda: HERE)
        assert fresh() == (14.0, 3.0, 2)
    place = tmp_path / f"{HERE.cpu}.tar.xz"
    with tarfile.open(place, "w:xz") as made:
        for path in (tmp_path / "one/worm3d/compiled").glob("*.kernel"):
            entry, content = tarfile.TarInfo(path.name), path.read_bytes()
            entry.size = len(content)
            made.addfile(entry, io.BytesIO(content))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    packed._content.cache_clear()
    yield place
    packed._content.cache_clear()


def test_what_is_packed_is_not_compiled(archive: Path) -> None:
    assert fresh() == (14.0, 3.0, 0)
    assert len(list((archive.parent / "other/worm3d/compiled").glob("*.kernel"))) == 2, (
        "the next process has it at hand"
    )
    missed: list[int] = []
    other = Function(total, lambda: "2", 1, lambda: missed.append(1))
    assert (other(np.arange(3.0)), len(missed)) == (5.0, 1), "of other sources it is another function"
    assert double(1.0) == 2.0


@pytest.mark.parametrize("damage", [lambda content: content[:100], lambda content: b"", lambda content: content[::-1]])
def test_a_damaged_archive_is_ignored(damage, archive: Path) -> None:
    archive.write_bytes(damage(archive.read_bytes()))
    assert fresh() == (14.0, 3.0, 2)


def test_a_changed_entry_is_ignored(archive: Path) -> None:
    with tarfile.open(archive) as old:
        held = {each.name: old.extractfile(each).read() for each in old}
    with tarfile.open(archive, "w:xz") as made:
        for name, content in held.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            made.addfile(entry, io.BytesIO(content[:-1] + bytes([content[-1] ^ 1])))
    assert fresh() == (14.0, 3.0, 2)


@pytest.mark.parametrize(("features", "kind"), [(V4, "x86-64-v4"), (V3, "x86-64-v3"), ("+avx2,+fma", None), ("", None)])
def test_a_processor_gets_code_that_it_can_run(features: str, kind: str | None, monkeypatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    found = packed.kind_of(Host("any", features, 4, True))
    assert (found and found.cpu) == kind


def test_a_warm_start_imports_no_compiler() -> None:
    code = "import sys, worm3d; worm3d.simulate(worm3d.Worm(), worm3d.Plane(), duration=0.01); print(*sys.modules)"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "numba" not in done.stdout.split()


def test_code_that_asks_for_memory_finds_it_without_the_compiler() -> None:
    code = "import sys; from control.gaits.larva_ei.network import crawling; crawling(1.0); print(*sys.modules)"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "numba" not in done.stdout.split()
