from planar.linkage.ground import Friction
from planar.linkage.run import Run
from planar.linkage.simulate import LimitPointError, simulate
from planar.linkage.worm import Linkage

__all__ = ["Friction", "LimitPointError", "Linkage", "Run", "simulate"]
