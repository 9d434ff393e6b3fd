"""Compiled functions are kept under a digest of all that they are made of."""

import ast
from pathlib import Path

import worm3d
from worm3d.machine.compiled import COMPILED

HOME = Path(worm3d.__file__).parent


def imported(path: Path) -> set[str]:
    """Return the names behind `worm3d.` of the modules that a file imports, their packages for those inside one."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module == "worm3d":
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("worm3d."):
            found.add(node.module.split(".")[1])
    return found


def test_the_digest_covers_all_that_the_solver_imports() -> None:
    covered = {Path(name).stem for name in COMPILED}
    files = {*(HOME / "solver").glob("*.py"), *(HOME / name for name in COMPILED if name.endswith(".py"))}
    for path in files - {HOME / "compiled.py"}:
        assert imported(path) <= covered, path.name
    assert "congruence" in set().union(*map(imported, files)), "and it looks at what is imported"
