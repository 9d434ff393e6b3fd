"""Controllers by name, as scenes choose them.

A new controller is a class with the methods of `control.loop.WaveController` and a row in `CONTROLLERS`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from control.loop import WaveController


class Listed(NamedTuple):
    """A controller that can be named."""

    title: str
    """What it is, for help texts."""
    module: str
    name: str
    """Name of its class in that module."""


CONTROLLERS = {
    "mpc": Listed("model predictive control of the gait's parameters", "control.supervisor", "Supervisor"),
    "pi_los": Listed("PI control of the speed and line-of-sight steering", "control.baselines", "PiLineOfSight"),
    "open_loop": Listed("the wave that the identified map says, without looking", "control.baselines", "OpenLoop"),
}
"""Controllers by the name that scenes use."""


def controller(name: str) -> type[WaveController]:
    """Return the class of a controller, which is imported only now: its solvers take a while."""
    listed = CONTROLLERS[name]
    found: type[WaveController] = getattr(import_module(listed.module), listed.name)
    return found
