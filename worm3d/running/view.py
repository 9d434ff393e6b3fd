"""View of a run in progress, the argument of users' observers."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from worm3d.recorded.series import Recorded, series_of
from worm3d.recorded.state import State
from worm3d.recorded.status import Status
from worm3d.results.result import Result
from worm3d.running.observation import Observation
from worm3d.running.run import Observer, Run
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import read_only

SEEN = (*series_of(Recorded), "apexes", "end_load", "chamber_strain", "com_with_load")
"""Names of the attributes of `Recorded` that a view also has, for a single instant."""


class View:
    """Read-only view of a run at an instant, for an observer. Values are read from the run on access.

    Each recorded series of `worm3d.Result` is an attribute without its first dimension. For example, `view.joints` has
    the shape (N+1, 3), `view.com` has the shape (3,), and `view.heading` is a single number. `slip` is measured from
    the last row of the result before this instant. `step` is the number of finished steps, and `steps` is the number
    of steps of the whole run. `worm` and `world` are the simulated objects.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._series: Recorded | None = None
        self.step, self.steps, self.worm, self.world = run.done, run.steps, run.plant.worm, run.plant.world

    def __getattr__(self, name: str) -> FloatArray:
        if name not in SEEN:
            raise AttributeError(f"a view of a run has no {name!r}; it has {', '.join(dir(self))}")
        now: FloatArray = getattr(self._recorded, name)[0].copy()
        found: FloatArray = read_only(now)
        return found

    def __dir__(self) -> list[str]:
        return sorted({*SEEN, "actuator_states", "observation", "result", "state", "step", "steps", "world", "worm"})

    def __repr__(self) -> str:
        return f"View of step {self.step} of {self.steps}: {', '.join(dir(self))}"

    @property
    def _recorded(self) -> Recorded:
        run = self._current
        if self._series is None:
            self._series = run.recorded_now()
        return self._series

    @property
    def _current(self) -> Run:
        if self._run.done != self.step:
            raise ValueError(
                f"view: got one of step {self.step} when the run is at step {self._run.done}, must be read before the "
                "observer returns; keep the arrays, not the view"
            )
        return self._run

    @property
    def actuator_states(self) -> Mapping[str, FloatArray]:
        """States of actuators and loads by name.

        The shapes are (N, 2) for chambers and (N-1,) for hinges. Loads have the same shapes as in the result.
        """
        return {name: array[0].copy() for name, array in self._recorded.actuator_states.items()}

    def state(self) -> State:
        """Return the state with memory. A run from this state continues the present run bit for bit."""
        return self._current.state()

    def result(self) -> Result:
        """Return the result of the run up to the last recorded instant."""
        return self._current.result(Status.DONE)

    def observation(self) -> Observation:
        """Return the present observation, the input of sensors."""
        return self._current.observation()


def watched(look: Callable[[float, View], bool | None], every: int = 1) -> Observer:
    """Return an observer of runs that calls `look` with the time [s] and the view after every `every` steps."""
    return Observer(lambda run: look(run.time(run.done), View(run)), every)
