"""Compiled kernels on disk: found again, shared by processes, mended when damaged, not needed where no place is."""

import json
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from worm3d.machine import cache
from worm3d.machine.cache import files
from worm3d.machine.codegen import Kernel, Origin, compile_kernel, native, this_host
from worm3d.machine.codegen import kernel as kernels

COLUMNS = np.arange(12.0).reshape(3, 4)


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(kernels, "_LOADED", {})


def norm(factor: float = 1.0) -> ca.Function:
    x = ca.SX.sym("x", 3)
    return ca.Function("norm", [x], [factor * ca.sqrt(ca.dot(x, x)), ca.exp(x)])


def run(kernel: Kernel, columns: np.ndarray) -> np.ndarray:
    count = columns.shape[1]
    inputs, outputs = kernel.allocate(count)
    inputs[:, :count] = columns
    kernel(inputs, outputs, count)
    return outputs[:, :count]


def _forget() -> None:
    kernels._LOADED.clear()


def test_a_kernel_is_found_in_memory_and_then_on_disk(tmp_path: Path) -> None:
    function = norm()
    first = compile_kernel(function, folder=tmp_path)
    again = compile_kernel(norm(), folder=tmp_path)
    assert (first.origin, again.origin, again.address) == (Origin.COMPILED, Origin.MEMORY, first.address)
    _forget()
    loaded = compile_kernel(function, folder=tmp_path)
    assert loaded.origin is Origin.DISK
    assert_array_equal(run(loaded, COLUMNS), run(first, COLUMNS))
    _forget()
    assert compile_kernel(norm(2.0), folder=tmp_path).origin is Origin.COMPILED


def test_a_kernel_on_disk_serves_only_the_same_processor_and_generator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = this_host()
    assert compile_kernel(norm(), folder=tmp_path).origin is Origin.COMPILED
    for other in (own._replace(width=4 if own.width == 2 else 2), own._replace(features="")):
        assert compile_kernel(norm(), folder=tmp_path, host=other).origin is Origin.COMPILED
    monkeypatch.setattr(native, "_generator", lambda: "another")
    assert compile_kernel(norm(), folder=tmp_path).origin is Origin.COMPILED


@pytest.mark.parametrize("damage", ["flipped", "short", "empty", "folder"])
def test_a_damaged_file_is_compiled_anew(damage: str, tmp_path: Path) -> None:
    function = norm()
    expected = run(compile_kernel(function, folder=tmp_path), COLUMNS)
    (path,) = tmp_path.glob("*.kernel")
    whole = path.read_bytes()
    path.unlink()
    if damage == "folder":
        path.mkdir()
    else:
        flipped = bytes([*whole[:400], whole[400] ^ 1, *whole[401:]])
        path.write_bytes({"flipped": flipped, "short": whole[:400], "empty": b""}[damage])
    _forget()
    mended = compile_kernel(function, folder=tmp_path)
    assert mended.origin is Origin.COMPILED
    assert_array_equal(run(mended, COLUMNS), expected)
    assert damage == "folder" or path.read_bytes() == whole
    assert not list(tmp_path.glob(".*")), "nothing half-written stays"


def test_without_a_place_to_write_kernels_are_compiled_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the folder's place")
    assert compile_kernel(norm(), folder=tmp_path / "file").origin is Origin.COMPILED
    _forget()

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("XDG_CACHE_HOME", "relative/paths/do/not/count")
    monkeypatch.setattr(Path, "home", homeless)
    assert cache.folder("kernels") is None
    assert compile_kernel(norm()).origin is Origin.COMPILED


def test_the_oldest_kernels_make_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MAX_FILES", 2)
    for age, key in enumerate("abc"):
        assert cache.store(tmp_path, key, b"code of " + key.encode())
        os.utime(tmp_path / f"{key}.kernel", (age, age))
    assert cache.store(tmp_path, "d", b"code of d")
    assert [cache.load(tmp_path, key) for key in "abcd"] == [None, None, b"code of c", b"code of d"]


SCRIPT = """
import json, sys
import numpy as np
import casadi as ca
from worm3d.machine.codegen import compile_kernel, evaluate, native
from worm3d.machine.compiled import njit

if "warm" in sys.argv:
    def refuse(*_):
        raise AssertionError("compiled again")
    native.compile_text = refuse
    sys.modules["numba"] = None  # it cannot be imported

@njit
def total(address: int, inputs: np.ndarray, outputs: np.ndarray, count: int) -> float:
    evaluate(address, inputs, outputs, count)
    found = 0.0
    for row in range(len(outputs)):
        for k in range(count):
            found += outputs[row, k]
    return found

x = ca.SX.sym("x", 3)
kernel = compile_kernel(ca.Function("norm", [x], [ca.sqrt(ca.dot(x, x)), ca.exp(x)]))
inputs, outputs = kernel.allocate(5)
inputs[:, :5] = np.arange(15.0).reshape(3, 5)
value = total(kernel.address, inputs, outputs, 5)
print(json.dumps({"origin": kernel.origin.name, "value": value}))
"""


def _start(folder: Path, *args: str) -> "subprocess.Popen[str]":
    script = folder / "caller.py"
    if not script.exists():
        script.write_text(SCRIPT)
    places = {"XDG_CACHE_HOME": str(folder / "kernels")}
    command = [sys.executable, "-W", "error", str(script), *args]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, **places}
    )


def _finish(process: "subprocess.Popen[str]") -> dict[str, object]:
    out, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    result: dict[str, object] = json.loads(out)
    return result


def test_concurrent_writers_agree_and_a_later_process_compiles_nothing(tmp_path: Path) -> None:
    both = [_start(tmp_path), _start(tmp_path)]
    first, second = (_finish(process) for process in both)
    assert first["value"] == second["value"]
    assert "COMPILED" in (first["origin"], second["origin"])
    kept = sorted(path.name for path in (tmp_path / "kernels").rglob("*") if path.is_file())
    assert [Path(name).suffix for name in sorted(kept, key=lambda name: name[::-1])] == [".kernel", ".kernel"]
    third = _finish(_start(tmp_path, "warm"))
    assert third == {"origin": "DISK", "value": first["value"]}, "the caller comes from disk as well"
