"""Guard against a foreign package under one of our import names.

The import name `control` is also that of python-control, and pip lays the two over one another without a
word; then `import control` gets the other one, or a mixture.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from scenes.language.errors import SceneError

NAMES = ("control", "planar", "worm3d")
MARK = 'DISTRIBUTION = "worm3d"'
HOME = Path(__file__).resolve().parents[2]


def require_own_packages() -> None:
    """Check, without importing them, that our import names lead to our packages.

    Raises
    ------
    SceneError
        Which file was found instead, and what to do.
    """
    for name in NAMES:
        found, own = _found(name), HOME / name / "__init__.py"
        if found != own or (name == "control" and MARK not in own.read_text(encoding="utf-8")):
            raise SceneError(
                f"the import name '{name}' leads to {found or 'nothing'}, which is not worm3d's package; "
                f"run 'pip uninstall {name}' (or take its folder off PYTHONPATH), then install worm3d again"
            )


def _found(name: str) -> Path | None:
    spec = find_spec(name)
    return Path(spec.origin).resolve() if spec and spec.origin else None
