"""Compiled functions are kept under a digest of all that they are made of."""

import ast
from pathlib import Path

import pytest

from worm3d.machine.compiled import COMPILED

ROOT = Path(__file__).parents[2]
NOT_COMPILED = ("worm3d/values/", "worm3d/recorded/status.py", "worm3d/recorded/series.py", "worm3d/running/plant.py")
"""What modules beside compiled functions import, and no compiled function depends on."""


def imported(path: Path) -> set[str]:
    """Return the files of the project's modules that a file imports, from the root."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in COMPILED:
            module = node.module.replace(".", "/")
            names = [module] if (ROOT / f"{module}.py").exists() else [f"{module}/{each.name}" for each in node.names]
            found |= {f"{name}.py" if (ROOT / f"{name}.py").exists() else f"{module}/__init__.py" for name in names}
    return found


@pytest.mark.parametrize("room", ["worm3d/solver", "worm3d/physics/kernels", "worm3d/machine", "planar/linkage"])
def test_the_digest_covers_all_that_compiled_functions_import(room: str) -> None:
    covered = tuple(f"{package}/{folder}".removesuffix(".") for package, parts in COMPILED.items() for folder in parts)
    for path in (ROOT / room).glob("*.py"):
        beside = {name for name in imported(path) if not name.startswith((*NOT_COMPILED, *covered))}
        assert not beside, path.name
    assert set().union(*map(imported, (ROOT / room).glob("*.py"))), "and it looks at what is imported"
