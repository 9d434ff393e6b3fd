"""What is compiled is compiled by one process of a machine; the others wait for it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from worm3d.machine import cache

HERE = Path(__file__).parent
KERNEL_TOO = """
import casadi
from kept_files import fresh
from worm3d.machine.codegen import compile_kernel, native
made, compile_function = [], native.compile_function
def noted(*args):
    made.append(args)
    return compile_function(*args)
native.compile_function = noted
print("ready", flush=True)
input()
x = casadi.SX.sym("x", 50)
y = x
for _ in range(40):
    y = casadi.sin(y) + casadi.sqrt(1.0 + y * y)
compile_kernel(casadi.Function("f", [x], [y]))
print(fresh()[2], len(made))
"""
HOLD = """
import sys, time, pathlib
from worm3d.machine import cache
with cache.alone(pathlib.Path(sys.argv[1]), "key"):
    print("in", flush=True)
    time.sleep(60)
"""


def start(program: str, *arguments: object, home: Path) -> subprocess.Popen[str]:
    environment = {**os.environ, "XDG_CACHE_HOME": str(home), "PYTHONPATH": str(HERE)}
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    )


def test_processes_that_start_together_compile_each_thing_once(tmp_path: Path) -> None:
    processes = [start(KERNEL_TOO, home=tmp_path) for _ in range(2)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    found = [process.communicate(timeout=100)[0].split() for process in processes]
    assert sum(int(missed) for missed, _ in found) == 2
    assert sorted(compiled for _, compiled in found) == ["0", "1"]
    assert not list(tmp_path.rglob("*.part"))


def test_the_lock_of_a_killed_process_is_free(tmp_path: Path) -> None:
    holder = start(HOLD, tmp_path / "kernels", home=tmp_path)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "in\n"
    waited = threading.Thread(target=lambda: cache.alone(tmp_path / "kernels", "key").__enter__())
    waited.start()
    waited.join(0.3)
    assert waited.is_alive(), "somebody else is at it"
    holder.kill()
    holder.communicate()
    waited.join(5.0)
    assert not waited.is_alive()


def test_nobody_waits_without_end(tmp_path: Path) -> None:
    begun = time.monotonic()
    with cache.alone(tmp_path / "kernels", "key"):
        with cache.alone(tmp_path / "kernels", "other"):
            assert time.monotonic() < begun + 0.2, "another key is another lock"
        with cache.alone(tmp_path / "kernels", "key", wait=0.2):
            assert 0.2 <= time.monotonic() - begun < 5.0
    assert list((tmp_path / "kernels").iterdir()) == []


def test_without_a_folder_there_is_no_lock(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (None, tmp_path / "file" / "kernels"):
        with cache.alone(folder, "key"), cache.alone(folder, "key"):
            pass
