"""The plant: a worm robot, the worlds it crawls in, and its simulation.

    result = worm3d.simulate(worm, world, ground, actuation=gait, duration=10.0)

Start reading at `worm3d/simulate.py`, then `worm3d/solver/step.py`, and the formulas in
`worm3d/physics/elements.py` and `worm3d/physics/contact.py`; the letters are listed in NOTATION.md.

What needs the compiler is imported when it is first asked for: gaits and scene checks need the parameters only.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from worm3d.command import Command, Commands
from worm3d.worm import Worm

if TYPE_CHECKING:
    from worm3d.batch import simulate_batch
    from worm3d.constraints import Held
    from worm3d.live import Live
    from worm3d.observation import Observation
    from worm3d.physics.friction import Friction
    from worm3d.physics.friction_laws import Coulomb, FrictionLaw
    from worm3d.pictures import draw, show
    from worm3d.result import Energy, Result
    from worm3d.simulate import simulate
    from worm3d.start import LimitPointError, flattening_weight
    from worm3d.state import State, StateError
    from worm3d.status import Status, Stop
    from worm3d.worlds import (
        Bend,
        Centreline,
        ClampedGround,
        Heightfield,
        Mesh,
        MeshError,
        Patch,
        Pipe,
        Plane,
        Profile,
        Straight,
        Union,
        slope_into_pipe,
    )

_HOMES = {
    "Bend": "worlds",
    "Centreline": "worlds",
    "ClampedGround": "worlds",
    "Energy": "result",
    "Coulomb": "physics.friction_laws",
    "Friction": "physics.friction",
    "FrictionLaw": "physics.friction_laws",
    "Heightfield": "worlds",
    "Held": "constraints",
    "LimitPointError": "start",
    "Live": "live",
    "Mesh": "worlds",
    "MeshError": "worlds",
    "Observation": "observation",
    "Patch": "worlds",
    "Pipe": "worlds",
    "Plane": "worlds",
    "Profile": "worlds",
    "Result": "result",
    "State": "state",
    "StateError": "state",
    "Status": "status",
    "Stop": "status",
    "Straight": "worlds",
    "Union": "worlds",
    "draw": "pictures",
    "flattening_weight": "start",
    "show": "pictures",
    "simulate": "simulate",
    "simulate_batch": "batch",
    "slope_into_pipe": "worlds",
}
"""Module of each name that is imported when it is first asked for."""

__all__ = [
    "Bend",
    "Centreline",
    "ClampedGround",
    "Command",
    "Commands",
    "Energy",
    "Coulomb",
    "Friction",
    "FrictionLaw",
    "Heightfield",
    "Held",
    "LimitPointError",
    "Live",
    "Mesh",
    "MeshError",
    "Observation",
    "Patch",
    "Pipe",
    "Plane",
    "Profile",
    "Result",
    "State",
    "StateError",
    "Status",
    "Stop",
    "Straight",
    "Union",
    "Worm",
    "draw",
    "flattening_weight",
    "show",
    "simulate",
    "simulate_batch",
    "slope_into_pipe",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'worm3d' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"worm3d.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


class _Package(ModuleType):
    """Keeps `worm3d.simulate` the function: importing the module of that name does not put it in its place."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name == "simulate" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
