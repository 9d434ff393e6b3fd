"""Files of the cache, damaged at random: every later start works and computes the same."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fuzzing import TIMES
from kept_files import AS_ROOT, KINDS, damage, fresh, mend

from worm3d.machine import cache
from worm3d.machine.cache import files

KEY, CONTENT = "ab" * 32, bytes(range(256)) * 4
SEED = 11 if TIMES == 1 else None


@pytest.fixture(autouse=True)
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(files, "_told", set())
    return tmp_path / "worm3d"


@pytest.mark.slow
def test_damaged_functions_are_compiled_anew(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(SEED)
    fresh()
    whole = {path: path.read_bytes() for path in (home / "compiled").iterdir()}
    kinds = set()
    for _ in range(100 * TIMES):
        path = random.choice(sorted(whole))
        kind = damage(path, random)
        kinds.add(kind)
        files._told.clear()
        readable = kind == "locked" and AS_ROOT
        assert fresh() == (14.0, 3.0, 0 if readable else 1), kind
        assert readable or str(home / "compiled") in capsys.readouterr().err, kind
        mend(path, whole[path])
    assert kinds == set(KINDS)
    assert fresh() == (14.0, 3.0, 0)
    assert not list(home.rglob("*.part"))


def test_what_is_damaged_is_absent(home: Path) -> None:
    random = np.random.default_rng(SEED)
    path = home / "grids" / f"{KEY}.grid"
    for _ in range(100 * TIMES):
        assert cache.store(path.parent, KEY, CONTENT, ".grid")
        kind = damage(path, random)
        assert cache.load(path.parent, KEY, ".grid") == (CONTENT if kind == "locked" and AS_ROOT else None), kind
        if kind == "folder":
            path.rmdir()


RUN = """
import hashlib
import worm3d
from control.gaits import TravellingWave
from scenes.language.loader import SHIPPED_FOLDER
world = worm3d.Mesh(SHIPPED_FOLDER / "mesh_tunnel.stl", units="m", solid="outside")
start = worm3d.State.straight(worm3d.Worm(), world, position=(0.6, 0.0))
result = worm3d.simulate(worm3d.Worm(), world, actuation=TravellingWave(), duration=0.5, dt=0.01, state=start)
print(hashlib.sha256(result.com.tobytes()).hexdigest())
"""


@pytest.mark.skipif(TIMES == 1, reason="compiles the solver again and again; WORM3D_FUZZ=10 does it ten times")
def test_a_simulation_starts_with_ten_damaged_files(home: Path) -> None:
    random = np.random.default_rng(SEED)
    whole, said = start()
    assert "compiling, once" in said
    assert start() == (whole, "")
    kept = sorted(path for path in home.rglob("*") if path.is_file())
    assert {path.parent.name for path in kept} == {"kernels", "compiled", "grids"}
    for _ in range(TIMES):
        shutil.copytree(home, home.parent / "copy")
        kinds = [damage(path, random) for path in random.choice(kept, size=10, replace=False)]
        found, said = start()
        assert found == whole, kinds
        assert "Traceback" not in said
        shutil.rmtree(home)
        (home.parent / "copy").rename(home)


def start() -> tuple[str, str]:
    """Return what a new process computes, and what it complains of."""
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True, timeout=600)
    return done.stdout, done.stderr
