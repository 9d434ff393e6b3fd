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

from worm3d.command import Command as Command
from worm3d.command import Commands as Commands
from worm3d.worm import Worm as Worm

if TYPE_CHECKING:
    from worm3d.batch import simulate_batch as simulate_batch
    from worm3d.constraints import Held as Held
    from worm3d.live import Live as Live
    from worm3d.observation import Observation as Observation
    from worm3d.physics.actuators import ACTUATORS as ACTUATORS
    from worm3d.physics.actuators import Actuator as Actuator
    from worm3d.physics.actuators import FirstOrder as FirstOrder
    from worm3d.physics.actuators import Response as Response
    from worm3d.physics.friction import Friction as Friction
    from worm3d.physics.friction_laws import Coulomb as Coulomb
    from worm3d.physics.friction_laws import FrictionLaw as FrictionLaw
    from worm3d.physics.friction_laws import Viscous as Viscous
    from worm3d.pictures import draw as draw
    from worm3d.pictures import show as show
    from worm3d.result import Energy as Energy
    from worm3d.result import Result as Result
    from worm3d.simulate import simulate as simulate
    from worm3d.start import LimitPointError as LimitPointError
    from worm3d.start import flattening_weight as flattening_weight
    from worm3d.state import State as State
    from worm3d.state import StateError as StateError
    from worm3d.status import Status as Status
    from worm3d.status import Stop as Stop
    from worm3d.worlds import *  # noqa: F403 - a further world is named there alone


_HOMES = {
    "ACTUATORS": "physics.actuators",
    "Actuator": "physics.actuators",
    "Coulomb": "physics.friction_laws",
    "Energy": "result",
    "FirstOrder": "physics.actuators",
    "Friction": "physics.friction",
    "FrictionLaw": "physics.friction_laws",
    "Held": "constraints",
    "LimitPointError": "start",
    "Live": "live",
    "Observation": "observation",
    "Response": "physics.actuators",
    "Result": "result",
    "State": "state",
    "StateError": "state",
    "Status": "status",
    "Stop": "status",
    "Viscous": "physics.friction_laws",
    "draw": "pictures",
    "flattening_weight": "start",
    "show": "pictures",
    "simulate": "simulate",
    "simulate_batch": "batch",
}
"""Module of each name that is imported when it is first asked for; other names are those of `worm3d.worlds`."""


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted({"Command", "Commands", "Worm", *_HOMES, *_worlds()})
    home = _HOMES.get(name, "worlds")
    if name.startswith("_") or (home == "worlds" and name not in _worlds()):
        raise AttributeError(f"module 'worm3d' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"worm3d.{home}"), name)
    globals()[name] = value
    return value


def _worlds() -> list[str]:
    names: list[str] = importlib.import_module("worm3d.worlds").__all__
    return names


def __dir__() -> list[str]:
    return sorted({*__getattr__("__all__"), *(name for name in globals() if name.startswith("__"))})


class _Package(ModuleType):
    """Keeps `worm3d.simulate` the function: importing the module of that name does not put it in its place."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name == "simulate" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
