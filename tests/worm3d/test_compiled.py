"""Compiled functions are kept under a digest of all that they are made of."""

import ast
from pathlib import Path

import pytest

from worm3d.machine.compiled import COMPILED

ROOT = Path(__file__).parents[2]
NOT_COMPILED = {"worm3d/values", "worm3d/status.py", "worm3d/series.py", "worm3d/plant.py"}
"""What modules beside compiled functions import, and no compiled function depends on."""


def imported(path: Path) -> set[str]:
    """Return the folders or files, two steps below the root, of the project's modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in COMPILED:
            parts = node.module.split(".")
            found |= {"/".join([*parts, alias.name][:2]) for alias in node.names}
    return {name if (ROOT / name).is_dir() else f"{name}.py" for name in found}


@pytest.mark.parametrize("room", ["worm3d/solver", "worm3d/physics/kernels", "worm3d/machine", "planar/linkage"])
def test_the_digest_covers_all_that_compiled_functions_import(room: str) -> None:
    covered = {f"{package}/{folder}" for package, folders in COMPILED.items() for folder in folders}
    for path in (ROOT / room).glob("*.py"):
        beside = {name for name in imported(path) if not name.startswith("planar/") or "planar/." not in covered}
        assert beside - NOT_COMPILED <= covered, path.name
    assert set().union(*map(imported, (ROOT / room).glob("*.py"))), "and it looks at what is imported"
