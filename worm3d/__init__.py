"""A worm robot, the worlds in which it crawls, and its simulation.

    result = worm3d.simulate(worm, world, ground, actuation=gait, duration=10.0)

To read the code, start with `worm3d/running/simulate.py` and `worm3d/solver/step.py`. The formulas are in
`worm3d/physics/elements.py` and `worm3d/physics/contact.py`, and NOTATION.md explains the symbols.

The public names and their modules are listed in `__init__.pyi`, where editors and type checkers also find them. The
names of worlds are listed in `worm3d.worlds`. Each name is imported on its first access, so that programs that only use
gaits or check scenes do not load the compiler.
"""

import importlib
from pathlib import Path
from typing import Any

_LINES = [line.partition("  #")[0].split() for line in Path(__file__).with_suffix(".pyi").read_text().splitlines()]
_MODULES = {name: module for _, module, _, *_, name in _LINES if name != "*"}
"""Module of each public name except the names of worlds, which `worm3d.worlds` lists."""
_ELSEWHERE = (
    "control.gaits",
    "control.sensing",
    "control.controllers",
    "control.tracking.paths",
    "planar.published",
    "planar.linkage",
)
"""Modules outside this package with names that users may look for in `worm3d`. The error message names the module."""


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
