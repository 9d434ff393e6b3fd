"""Other simulators on the same task, each at the step where its own distance error is 1 %."""

from scenes.bench.rivals import Measured, MissingRivalError, Rival, load, measure, names
from scenes.bench.search import NotConvergedError
from scenes.bench.task import Task

__all__ = ["Measured", "MissingRivalError", "NotConvergedError", "Rival", "Task", "load", "measure", "names"]
