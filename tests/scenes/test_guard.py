from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from scenes.running.packages import HOME, OURS


def python_in(path: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(path)}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, env=environment, cwd=path, capture_output=True, text=True, timeout=60)


def version_with(path: Path) -> subprocess.CompletedProcess[str]:
    return python_in(path, "from scenes.commands.cli import main; main(['--version'])")


@pytest.mark.parametrize("name", OURS)
def test_a_foreign_package_is_named(name: str, tmp_path: Path) -> None:
    foreign = tmp_path / name / "__init__.py"
    foreign.parent.mkdir()
    foreign.write_text("raise RuntimeError('this was imported')")
    done = version_with(tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        f"the import name '{name}' leads to {foreign}, must lead to worm3d's own package; "
        f"run 'pip uninstall {name}' (or take its folder off PYTHONPATH), then install worm3d again\n"
    )


def test_a_merged_package_is_named(tmp_path: Path) -> None:
    for name in ("scenes", *OURS):
        shutil.copytree(HOME / name, tmp_path / name)
    assert version_with(tmp_path).returncode == 0
    merged = tmp_path / "control" / "__init__.py"
    merged.write_text('"""The Python Control Systems Library."""\n')
    done = version_with(tmp_path)
    assert done.returncode == 2
    assert f"the import name 'control' leads to {merged}, must lead to worm3d's own package" in done.stderr


def test_a_missing_package_is_named(tmp_path: Path) -> None:
    for name in ("scenes", "control", "worm3d"):
        shutil.copytree(HOME / name, tmp_path / name)
    # However ours is installed (a finder, a path): it must not be found beside the copies.
    code = (
        "import importlib.util as u; found = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'planar' else found(name, *a)\n"
        "from scenes.commands.cli import main; main(['--version'])"
    )
    done = python_in(tmp_path, code)
    assert done.returncode == 2
    assert "the import name 'planar' leads to nothing" in done.stderr


def test_no_other_distribution_owns_our_names() -> None:
    owners = packages_distributions()
    for name in ("scenes", *OURS):
        assert set(owners.get(name, [])) <= {"worm3d"}
