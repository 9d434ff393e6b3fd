"""Object code that comes with the package: who has it compiles nothing, and whatever is wrong with it is ignored."""

import io
import os
import re
import subprocess
import sys
import tarfile
from pathlib import Path

import llvmlite
import numpy as np
import packing
import pytest
from kept_files import double, fresh, total

from worm3d.machine import packed
from worm3d.machine.codegen import Host, native
from worm3d.machine.compiled import announce
from worm3d.machine.functions import Function

V4 = ",".join(f"+{each}" for each in native.FEATURES["x86-64-v4"])
V3 = ",".join(f"+{each}" for each in native.FEATURES["x86-64-v3"])
HERE = packed.kind_of(native.this_host())
MAKE = """
import sys
from pathlib import Path
import numpy as np, kept_files
import packing
from worm3d.machine.functions import Function
calls = [(Function(kept_files.double, lambda: "1", 1, None), [1.0], float)]  # in the order of `fresh`
calls += [(Function(kept_files.total, lambda: "1", 1, None), (np.zeros(2),), None)]
packing._make(Path(sys.argv[1]), sys.argv[2], calls)
"""


@pytest.fixture
def archive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The archive of this processor's kind, with what `fresh` calls, beside an empty cache."""
    if HERE is None:
        pytest.skip("nothing is packed for this processor")
    monkeypatch.setattr(packed, "PACKED_FOLDER", tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "one"))
    packed.content_of.cache_clear()
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
    packed.content_of.cache_clear()
    yield place
    packed.content_of.cache_clear()


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


@pytest.mark.slow
def test_code_that_asks_for_memory_finds_it_without_the_compiler() -> None:
    code = "import sys; from control.gaits.larva_ei.network import crawling; crawling(1.0); print(*sys.modules)"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "numba" not in done.stdout.split()


def test_a_processor_s_own_code_is_compiled_where_a_switch_asks_for_it(archive: Path) -> None:
    ask = "import os, kept_files; from worm3d.machine.codegen import this_host; print(this_host(), kept_files.fresh())"
    for name, width, fused in (("x86-64-v2", 2, False), ("host", native.this_host().width, native.this_host().fused)):
        switch = {native.SWITCH: name, "PYTHONPATH": str(Path(__file__).parent)}
        done = subprocess.run([sys.executable, "-c", ask], env=os.environ | switch, capture_output=True, text=True)
        assert f"width={width}, fused={fused}" in done.stdout, done.stderr
        assert "(14.0, 3.0, 2)" in done.stdout, "both are compiled"


@pytest.mark.parametrize("name", ["x86-64-v9", "zen"])
def test_a_kind_that_does_not_exist_is_refused(name: str, monkeypatch) -> None:
    monkeypatch.setenv(native.SWITCH, name)
    native.this_host.cache_clear()
    with pytest.raises(ValueError, match=rf"WORM3D_COMPILE_FOR is '{name}', on this processor it must be one of host"):
        native.this_host()
    monkeypatch.undo()
    native.this_host.cache_clear()


def test_code_made_for_a_kind_is_the_same_wherever_it_is_made(tmp_path: Path) -> None:
    if HERE is None:
        pytest.skip("nothing is packed for this processor")
    asked = {native.SWITCH: HERE.cpu, "XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(Path(__file__).parent)}
    subprocess.run([sys.executable, "-c", "import kept_files; kept_files.fresh()"], env=os.environ | asked, check=True)
    kept = {path.name: path.read_bytes() for path in tmp_path.rglob("*.kernel")}
    for kind in packed.PACKED_PROCESSORS:
        made = tmp_path / packed.archive(kind).name
        environment = os.environ | asked | {native.SWITCH: ""}
        subprocess.run([sys.executable, "-c", MAKE, str(made), kind], env=environment, check=True)
        content = packed.content_of(made)
        assert content.pop(packed.MADE_WITH).startswith(b"llvmlite ")
        assert len(content) == 2
        assert (content == kept) == (kind == HERE.cpu), "this kind's is what the processor makes for itself"


def test_archives_are_compared_by_what_they_hold(tmp_path: Path) -> None:
    def archive_of(name: str, **content: bytes) -> Path:
        with tarfile.open(tmp_path / name, "w:xz") as made:
            for key, value in content.items():
                entry = tarfile.TarInfo(key)
                entry.size = len(value)
                made.addfile(entry, io.BytesIO(value))
        return tmp_path / name

    here, other = packing._versions().encode(), b"llvmlite 0.0.1"
    anew = archive_of("anew", made_with=here, a=b"1", b=b"2")
    same = archive_of("same", made_with=here, b=b"2", a=b"1")
    assert packing.compare(same, anew) == (True, "all 2 objects are the same when made anew, byte for byte")
    changed = archive_of("changed", made_with=here, a=b"1", b=b"3")
    assert packing.compare(changed, anew)[0] is False
    assert packing.compare(archive_of("stale", made_with=here, a=b"1", c=b"2"), anew)[0] is False
    assert packing.compare(tmp_path / "none", anew)[0] is False
    assert packing.compare(archive_of("old", made_with=other, a=b"1", b=b"3"), anew)[1].startswith("not compared, for ")
    assert packing.compare(archive_of("older", made_with=other, a=b"1", c=b"3"), anew)[0] is False, "of other sources"


def test_another_llvmlite_is_named_where_it_compiles(archive: Path, monkeypatch, capsys) -> None:
    entry, content = tarfile.TarInfo(packed.MADE_WITH), b"llvmlite 0.0.1\nnumba 0.0.2"
    entry.size = len(content)
    with tarfile.open(archive, "w:xz") as made:
        made.addfile(entry, io.BytesIO(content))
    assert (
        packed.reason() == f"; the compiled solver that comes with it is for llvmlite 0.0.1, not {llvmlite.__version__}"
    )
    announce.cache_clear()
    announce()
    assert re.fullmatch(
        r"worm3d: compiling, once, .*; the compiled solver .* 0\.0\.1, not .*\n", capsys.readouterr().err
    )
    announce.cache_clear()


@pytest.mark.parametrize("kind", packed.PACKED_PROCESSORS)
def test_no_object_names_the_folder_where_it_was_made(kind: str) -> None:
    for content in packed.content_of(packed.archive(kind)).values():
        assert not re.search(rb"/[\x20-\x7e]*(worm3d|site-packages)/", content)
