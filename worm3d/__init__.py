"""The plant: a worm robot, the worlds it crawls in, and its simulation.

    result = worm3d.simulate(worm, world, ground, actuation=gait, duration=10.0)

Start reading at `worm3d.simulate`, then `worm3d.solver.step`, `worm3d.kernels`, and the formulas in `worm3d.elements`
and `worm3d.contact`; the letters are listed in NOTATION.md.
"""

from worm3d.command import Command
from worm3d.friction import Friction
from worm3d.held import Held
from worm3d.observation import Observation
from worm3d.result import Energy, Result
from worm3d.simulate import simulate
from worm3d.start import LimitPointError, flattening_weight
from worm3d.state import State
from worm3d.status import Status, Stop
from worm3d.worlds import ClampedGround, Patch, Plane
from worm3d.worm import Worm

__all__ = [
    "ClampedGround",
    "Command",
    "Energy",
    "Friction",
    "Held",
    "LimitPointError",
    "Observation",
    "Patch",
    "Plane",
    "Result",
    "State",
    "Status",
    "Stop",
    "Worm",
    "flattening_weight",
    "simulate",
]
