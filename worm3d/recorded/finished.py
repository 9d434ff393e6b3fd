"""A finished run as data. Measures, files and pictures are computed from a finished run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from worm3d.recorded.energy import Energy
from worm3d.recorded.estimate import ErrorEstimate
from worm3d.recorded.series import Recorded, Steps, variables_of
from worm3d.recorded.state import State
from worm3d.recorded.status import Status, Stop
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable
from worm3d.worlds.base import World


@dataclass(frozen=True, eq=False, kw_only=True)
class FinishedRun(Recorded, Steps):
    """A run with T recorded instants, S finished steps and N segments.

    If the run failed, its series contain the steps before the failure.
    """

    world: World | None
    gravity: FloatArray
    """Gravity, shape (3,) [m/s^2]."""
    period: float | None
    """Period of the gait, over which speeds are averaged [s]. None if the actuation has no period."""
    energy: Energy
    state: State = field(repr=False)
    """State at the end, with the memory of the solver. A run from this state continues exactly, to the last bit."""
    stop: Stop
    wall_s: float
    """Wall time of the steps, including the time for commands and external forces [s]."""
    error_estimate: ErrorEstimate | None = None
    """Estimated errors of the run. None if no accuracy was requested."""

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @property
    def settled(self) -> bool:
        """Whether the worm was settled on its world before the run."""
        return self.settling is not None

    def variables(self) -> Iterator[Variable]:
        """Yield all recorded series as named arrays with dimensions and units, in the form that files contain."""
        for part in (self, self.energy):
            yield from variables_of(part, "time")
        yield from variables_of(self, "step", "")
