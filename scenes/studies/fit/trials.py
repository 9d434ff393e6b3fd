"""Trial runs: a function from values of the varied keys to the simulated counterparts of the measured values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scenes.language.errors import DiscError, MissingPartError, SceneError
from scenes.models.loading import Scene, parse_scene
from scenes.records.measured import at_instants, simulated_like
from scenes.records.record import Record
from scenes.running.runner import simulate
from scenes.studies.fit.varied import Varied
from scenes.sweep.links import value_at
from worm3d.values.arrays import BoolArray, FloatArray
from worm3d.values.variable import Variable, column_names

LEAST_PER_KEY = 5
"""Smallest number of measured values for each varied key."""

MAX_KEPT_RUNS, MAX_KEPT_VALUES = 100, 4_000_000
"""Largest number of runs whose channels are kept in memory, and largest number of values of these channels together.
Runs are kept because the minimisation and the slopes often need the same run."""
FEWEST_KEPT = 12
"""Number of runs that are kept even if they have more than `MAX_KEPT_VALUES` values."""


class SpentError(Exception):
    """The allowed number of runs has been used up."""


class StoppedError(Exception):
    """The user has stopped the fit."""


@dataclass(frozen=True)
class Data:
    """Measured series that have a counterpart in the simulation: C channels at T instants."""

    names: tuple[str, ...]
    """Name of each channel with its unit, as in the header of a CSV file, such as `com_x_m`."""
    units: tuple[str, ...]
    time: FloatArray
    """Shape (T,) [s]."""
    values: FloatArray
    """Shape (C, T); NaN where the measurement or the simulation has no value."""

    @property
    def spread(self) -> FloatArray:
        """For each channel, the largest standard deviation over time of all channels with the same unit, shape (C,).

        It is 1 if these channels contain only rounding errors, such as the heading of a worm that crawls straight.
        """
        own = np.nanstd(self.values, axis=1)
        largest = [max(own[k] for k, unit in enumerate(self.units) if unit == mine) for mine in self.units]
        return np.where(np.array(largest) > 1e-12, largest, 1.0)


class Trials:
    """Runs a scene with values of its varied keys and counts the runs.

    Parameters
    ----------
    scene : Scene
        The scene. A run that is longer than the measurement is shortened to it.
    measured : Record
        A measurement, as returned by `scenes.records.measured.load`.
    varied : sequence of Varied
    most : int
        Largest number of runs.
    go_on : callable
        Called with the number of finished runs before each run. If it returns False, a `StoppedError` is raised.

    Raises
    ------
    SceneError
        The run from the start values fails, no measured quantity is simulated at any of the instants, or the data are
        constant or too few.
    """

    def __init__(
        self, scene: Scene, measured: Record, varied: Sequence[Varied], most: int, go_on: Callable[[int], bool]
    ) -> None:
        self.varied, self.most, self.runs, self.failed = tuple(varied), most, 0, 0
        self._go_on, self._measured, self._model = go_on, measured, scene.model
        self._known: dict[tuple[float, ...], FloatArray | None] = {}
        self._name, self._text, self._settings = scene.name, scene.to_toml(), scene.settings
        self._shorter = _shortened(scene, float(measured["time"][-1]))
        self.why = ""
        """Reason why the last failed run failed."""
        self._places: list[tuple[str, int]] = []
        self.data = self._data()
        self.left_out: tuple[str, ...] = ()
        """Names of the channels that `narrow` has left out."""

    def __call__(self, values: Sequence[float] | FloatArray) -> FloatArray | None:
        """Return the simulated channels, shape (C, T), with NaN where the data are NaN. Return None if the run fails.

        Raises
        ------
        SpentError, StoppedError
            No further run is allowed.
        """
        key = tuple(map(float, values))
        if key not in self._known:
            found = self._channels(key)
            self.failed += found is None
            if len(self._known) >= max(FEWEST_KEPT, min(MAX_KEPT_RUNS, MAX_KEPT_VALUES // self.data.values.size)):
                del self._known[next(iter(self._known))]
            self._known[key] = found
        return self._known[key]

    def changed(self, values: FloatArray, override: str) -> FloatArray | None:
        """Return the simulated channels of the scene with a further override.

        Return None if the run fails or if the scene with the override is invalid.

        Raises
        ------
        SpentError, StoppedError
            No further run is allowed.
        """
        return self._channels(tuple(map(float, values)), override)

    def number(self, key: str) -> float | None:
        """Return the scene's value of a key. Return None if the value is not a number, or if the key is varied."""
        value = None if key in [each.key for each in self.varied] else value_at(self._settings, key, None)
        return float(value) if isinstance(value, float | int) and not isinstance(value, bool) else None

    def narrow(self, used: BoolArray) -> None:
        """Leave out all channels that are not `used` from now on."""
        self.left_out += tuple(name for name, use in zip(self.data.names, used, strict=True) if not use)
        names, units = (tuple(np.array(each)[used].tolist()) for each in (self.data.names, self.data.units))
        self.data = Data(names, units, self.data.time, self.data.values[used])
        self._known = {key: None if found is None else found[used] for key, found in self._known.items()}
        self._places = [place for place, use in zip(self._places, used, strict=True) if use]
        self._forget_others()

    def allow(self, more: int) -> None:
        """Allow more runs."""
        self.most += more

    def scene(self, values: Sequence[float] | FloatArray, *changes: str) -> Scene:
        """Return the scene with the given values of the varied keys and further overrides.

        Raises
        ------
        SceneError
            The scene is invalid with these values.
        """
        given = [f"{each.key}={float(value)!r}" for each, value in zip(self.varied, values, strict=True)]
        return parse_scene(self._text, self._name, [*given, *changes])

    def _channels(self, values: tuple[float, ...], *changes: str) -> FloatArray | None:
        record = self._run(values, *changes)
        if record is None:
            return None
        rows = {name: _rows(series) for name, series in simulated_like(record, self._measured).items()}
        channels = np.array([rows[name][k] for name, k in self._places])
        channels[~np.isfinite(self.data.values)] = np.nan
        if not np.array_equal(np.isfinite(channels), np.isfinite(self.data.values)):
            self.why = "the run has no value at an instant of the measurement"
            return None
        return channels

    def _run(self, values: tuple[float, ...], *changes: str) -> Record | None:
        """Return the record of a run, None if the scene is refused or the run diverges."""
        if self.runs >= self.most:
            raise SpentError
        if not self._go_on(self.runs):
            raise StoppedError
        self.runs += 1

        def observer(done: int) -> bool:
            return self._go_on(self.runs - 1)

        try:
            record = simulate(self.scene(values, *self._shorter, *changes), observer)
        except (DiscError, MissingPartError):
            raise
        except SceneError as error:
            self.why = str(error)
            return None
        if record.status == "interrupted":
            raise StoppedError
        if record.status != "done":
            self.why = record.sentence
            return None
        return record

    def _data(self) -> Data:
        record = self._run(tuple(each.start for each in self.varied))
        if record is None:
            start = ", ".join(f"{each.key} = {each.start:.6g}" for each in self.varied)
            raise SceneError(
                f"{self._name}: the run from the start, {start}, fails: {self.why}; start from a run that comes to its "
                "end, with -o KEY=VALUE"
            )
        found = simulated_like(record, self._measured)
        found = {name: series for name, series in found.items() if name not in self._model.inputs}
        if not found:
            raise SceneError(
                f"{self._measured.name}: has {', '.join(self._model.inputs)} alone, which {self._name} is given and "
                "does not find; measure something else too"
            )
        values = np.concatenate([_rows(self._measured[name]) for name in found])
        values = np.where(np.isfinite(np.concatenate([_rows(each) for each in found.values()])), values, np.nan)
        known = np.isfinite(values)
        if not known.any():
            raise SceneError(_apart(self._measured, record))
        if known.sum() < (least := LEAST_PER_KEY * len(self.varied)):
            raise SceneError(
                f"{self._measured.name}: got {known.sum()} measured values within the run, must be at least {least} "
                f"for {len(self.varied)} varied keys: measure more, or vary fewer keys"
            )
        chosen = np.flatnonzero(known.sum(axis=1) > 1)
        places = [(name, k) for name, series in found.items() for k in range(len(_rows(series)))]
        titles = [(title, v.units) for v in map(self._measured.variable, found) for title in column_names(v)]
        names, units = zip(*(titles[k] for k in chosen), strict=True)
        data = Data(names, units, self._measured["time"], values[chosen])
        self._places = [places[k] for k in chosen]
        self.abscissa = _at(record, self._model.abscissa, data.time)
        """Quantity on the horizontal axis of the figure, at the measured instants."""
        self._forget_others()
        if not np.any(np.nanmax(data.values, axis=1) > np.nanmin(data.values, axis=1)):
            raise SceneError(f"{self._measured.name}: all that was measured is constant, nothing can be fitted to it")
        return data

    def _forget_others(self) -> None:
        """Remove the measured quantities that no channel uses."""
        used = {"time", *(name for name, _ in self._places)}
        self._measured = replace(self._measured, variables=tuple(v for v in self._measured.variables if v.name in used))


def _shortened(scene: Scene, end: float) -> tuple[str, ...]:
    """Return the override that ends the run at the first stored instant at or after `end`, the end of the measurement.

    The tuple is empty if the run does not have to be shortened.
    """
    run = scene.settings.run
    stored = run.dt_s * run.record_every
    duration = stored * math.ceil(end / stored - 1e-9)
    return (f"run.duration_s={duration!r}",) if 0.0 < duration < run.duration_s else ()


def _rows(values: FloatArray) -> FloatArray:
    """Return a series of shape (T, ...) as channels, an array of shape (C, T)."""
    return np.asarray(values, dtype=float).reshape(len(values), -1).T


def _at(record: Record, name: str, instants: FloatArray) -> Variable:
    """Return a variable of a record, interpolated at the given instants."""
    found = record.variable(name)
    return replace(found, values=instants if name == "time" else at_instants(record["time"], record[name], instants))


def _apart(measured: Record, simulated: Record) -> str:
    measured_time, time = measured["time"], simulated["time"]
    return (
        f"{measured.name}: measured from {measured_time[0]:g} to {measured_time[-1]:g} s, nothing of it within the run "
        f"of {simulated.name} from {time[0]:g} to {time[-1]:g} s: set run.duration_s, or let the file's time begin at 0"
    )
