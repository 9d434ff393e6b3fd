"""The plant: a worm robot, the worlds it crawls in, and its simulation.

    result = worm3d.simulate(worm, world, ground, actuation=gait, duration=10.0)

Start reading at `worm3d/running/simulate.py`, then `worm3d/solver/step.py`, and the formulas in
`worm3d/physics/elements.py` and `worm3d/physics/contact.py`; the letters are listed in NOTATION.md.

The public names and their modules are listed once, in `__init__.pyi`, where editors and type checkers find them too
(the names of worlds in `worm3d.worlds`). Each name is imported on the first access: gaits and scene checks need no
compiler.
"""

import importlib
from pathlib import Path
from typing import Any

_LINES = [line.partition("  #")[0].split() for line in Path(__file__).with_suffix(".pyi").read_text().splitlines()]
_MODULES = {name: module for _, module, _, *_, name in _LINES if name != "*"}
"""Module of each public name; `worm3d.worlds` lists the names of worlds."""
_ELSEWHERE = (
    "control.gaits",
    "control.sensing",
    "control.controllers",
    "control.tracking.paths",
    "planar.published",
    "planar.linkage",
)
"""Modules outside this package whose names people look for here; the error message names the right module."""


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted({*_MODULES, *_worlds()})
    if name not in _MODULES and (name.startswith("_") or name not in _worlds()):
        from worm3d.values.spelling import no_attribute  # numpy takes a while

        raise no_attribute("worm3d", name, __getattr__("__all__"), _ELSEWHERE)
    value = getattr(importlib.import_module(_MODULES.get(name, "worm3d.worlds")), name)
    globals()[name] = value
    return value


def _worlds() -> list[str]:
    names: list[str] = importlib.import_module("worm3d.worlds").__all__
    return names


def __dir__() -> list[str]:
    return sorted({*__getattr__("__all__"), *(name for name in globals() if name.startswith("__"))})
