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
from worm3d.machine.codegen import Kernel, compile_kernel, evaluate, native, this_host
from worm3d.machine.codegen import kernel as kernels

COLUMNS = np.arange(12.0).reshape(3, 4)


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(kernels, "_LOADED", {})


@pytest.fixture(autouse=True)
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the functions that are compiled."""
    names: list[str] = []
    compile_function = native.compile_function

    def noted(function: ca.Function, *args: object) -> bytes:
        names.append(function.name())
        return compile_function(function, *args)

    monkeypatch.setattr(native, "compile_function", noted)
    return names


def norm(factor: float = 1.0) -> ca.Function:
    x = ca.SX.sym("x", 3)
    return ca.Function("norm", [x], [factor * ca.sqrt(ca.dot(x, x)), ca.exp(x)])


def run(kernel: Kernel, columns: np.ndarray) -> np.ndarray:
    count = columns.shape[1]
    inputs, outputs = kernel.allocate(count)
    inputs[:, :count] = columns
    evaluate(kernel.address, inputs, outputs, count)
    return outputs[:, :count]


def _forget() -> None:
    kernels._LOADED.clear()


def test_a_kernel_is_found_in_memory_and_then_on_disk(tmp_path: Path, compiled: list[str]) -> None:
    function = norm()
    first = compile_kernel(function, folder=tmp_path)
    again = compile_kernel(norm(), folder=tmp_path)
    assert (len(compiled), again.address) == (1, first.address)
    _forget()
    loaded = compile_kernel(function, folder=tmp_path)
    assert len(compiled) == 1
    assert_array_equal(run(loaded, COLUMNS), run(first, COLUMNS))
    _forget()
    compile_kernel(norm(2.0), folder=tmp_path)
    assert len(compiled) == 2


def test_a_kernel_on_disk_serves_only_the_same_processor_and_generator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiled: list[str]
) -> None:
    own = this_host()
    for host in (own, own._replace(width=4 if own.width == 2 else 2), own._replace(features="")):
        compile_kernel(norm(), folder=tmp_path, host=host)
    assert len(compiled) == 3
    monkeypatch.setattr(native, "_generator", lambda: "another")
    compile_kernel(norm(), folder=tmp_path)
    assert len(compiled) == 4


@pytest.mark.parametrize("damage", ["flipped", "short", "empty", "folder"])
def test_a_damaged_file_is_compiled_anew(damage: str, tmp_path: Path, compiled: list[str]) -> None:
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
    assert len(compiled) == 2
    assert_array_equal(run(mended, COLUMNS), expected)
    assert damage == "folder" or path.read_bytes() == whole
    assert not list(tmp_path.glob(".*")), "nothing half-written stays"


def test_without_a_place_to_write_kernels_are_compiled_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiled: list[str]
) -> None:
    (tmp_path / "file").write_text("in the folder's place")
    compile_kernel(norm(), folder=tmp_path / "file")
    _forget()

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("XDG_CACHE_HOME", "relative/paths/do/not/count")
    monkeypatch.setattr(Path, "home", homeless)
    assert cache.folder("kernels") is None
    compile_kernel(norm())
    assert len(compiled) == 2


def test_the_oldest_kernels_make_room(tmp_path: Path) -> None:
    for age, key in enumerate("abc"):
        assert cache.store(tmp_path, key, b"code of " + key.encode(), most=2)
        os.utime(tmp_path / f"{key}.kernel", (age, age))
    assert cache.store(tmp_path, "d", b"code of d", most=2)
    assert [cache.load(tmp_path, key) for key in "abcd"] == [None, None, b"code of c", b"code of d"]


SCRIPT = """
import json, sys
import numpy as np
import casadi as ca
from worm3d.machine.codegen import compile_kernel, evaluate, native
from worm3d.machine.compiled import njit

made, compile_function = [], native.compile_function

def noted(*args):
    made.append(args)
    return compile_function(*args)

native.compile_function = noted
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
print(json.dumps({"compiled": len(made), "value": value}))
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
    assert first["compiled"] or second["compiled"]
    kept = sorted(path.name for path in (tmp_path / "kernels").rglob("*") if path.is_file())
    assert [Path(name).suffix for name in sorted(kept, key=lambda name: name[::-1])] == [".kernel", ".kernel"]
    third = _finish(_start(tmp_path, "warm"))
    assert third == {"compiled": 0, "value": first["value"]}, "the caller comes from disk as well"
