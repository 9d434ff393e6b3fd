"""Trial runs of a fit: a scene as a function from values of its varied keys to simulated series.

Each simulated series is the counterpart of a measured series.
"""

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
"""Minimum number of measured values per varied key."""

MAX_KEPT_RUNS, MAX_KEPT_VALUES = 100, 4_000_000
"""Maximum number of runs whose channels are kept in memory, and maximum number of values of all kept channels. Runs are
kept because the search for the minimum and the derivatives often need the same run."""
FEWEST_KEPT = 12
"""Number of runs that are kept even if they exceed `MAX_KEPT_VALUES`."""


class SpentError(Exception):
    """The maximum number of runs has been reached."""


class StoppedError(Exception):
    """The user has stopped the fit."""


@dataclass(frozen=True)
class Data:
    """Measured series with a counterpart in the simulation: C channels at T times."""

    names: tuple[str, ...]
    """Name of each channel with its unit, as in the column names of a table: `com_x_m`."""
    units: tuple[str, ...]
    """Unit of each channel."""
    time: FloatArray
    """Times, shape (T,) [s]."""
    values: FloatArray
    """Measured values, shape (C, T); NaN if there is no measured or no simulated value."""

    @property
    def spread(self) -> FloatArray:
        """Scale of each channel, shape (C,): the largest standard deviation over time of all channels with its unit.

        It is 1 if the series vary only by rounding errors (for example the heading if the worm crawls straight).
        """
        own = np.nanstd(self.values, axis=1)
        largest = [max(own[k] for k, unit in enumerate(self.units) if unit == mine) for mine in self.units]
        return np.where(np.array(largest) > 1e-12, largest, 1.0)


class Trials:
    """Runs a scene with values of its varied keys, and counts the runs.

    Parameters
    ----------
    scene : Scene
        Checked scene. If its run is longer than the measurement, the run ends with the measurement.
    measured : Record
        Measurement, as returned by `scenes.records.measured.load`.
    varied : sequence of Varied
        Varied keys, with their initial values.
    most : int
        Maximum number of runs.
    go_on : callable
        Function of the number of finished runs. It is called before and during each run; if it returns False, the fit
        ends.

    Raises
    ------
    SceneError
        The run with the initial values fails, no measured value has a simulated counterpart, all measured series are
        constant, or there are too few measured values.
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
        """Return the simulated channels, shape (C, T), or None if the run fails.

        The channels are NaN where `data.values` is NaN.

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
        """Return the simulated channels with an additional override, or None if the run fails or is refused.

        Raises
        ------
        SpentError, StoppedError
            No further run is allowed.
        """
        return self._channels(tuple(map(float, values)), override)

    def number(self, key: str) -> float | None:
        """Return the number that a key has in the scene, or None if its value is not a number or the key is varied."""
        value = None if key in [each.key for each in self.varied] else value_at(self._settings, key, None)
        return float(value) if isinstance(value, float | int) and not isinstance(value, bool) else None

    def narrow(self, used: BoolArray) -> None:
        """From now on, leave out the channels where `used`, shape (C,), is False."""
        self.left_out += tuple(name for name, use in zip(self.data.names, used, strict=True) if not use)
        names, units = (tuple(np.array(each)[used].tolist()) for each in (self.data.names, self.data.units))
        self.data = Data(names, units, self.data.time, self.data.values[used])
        self._known = {key: None if found is None else found[used] for key, found in self._known.items()}
        self._places = [place for place, use in zip(self._places, used, strict=True) if use]
        self._forget_others()

    def allow(self, more: int) -> None:
        """Increase the maximum number of runs by `more`."""
        self.most += more

    def scene(self, values: Sequence[float] | FloatArray, *changes: str) -> Scene:
        """Return the scene with values of the varied keys and further overrides; SceneError if it is not valid."""
        given = [f"{each.key}={float(value)!r}" for each, value in zip(self.varied, values, strict=True)]
        return parse_scene(self._text, self._name, [*given, *changes])

    def _channels(self, values: tuple[float, ...], *changes: str) -> FloatArray | None:
        record = self._run(values, *changes)
        if record is None:
            return None
        try:
            series = simulated_like(record, self._measured)
        except SceneError as error:
            self.why = str(error)
            return None
        rows = {name: _rows(each) for name, each in series.items()}
        channels = np.array([rows[name][k] for name, k in self._places])
        channels[~np.isfinite(self.data.values)] = np.nan
        if not np.array_equal(np.isfinite(channels), np.isfinite(self.data.values)):
            self.why = "the run has no value at an instant of the measurement"
            return None
        return channels

    def _run(self, values: tuple[float, ...], *changes: str) -> Record | None:
        """Return the record of a run, or None if the scene is refused or the run diverges; `why` is then the reason."""
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
                f"{self._name}: the run with the initial values, {start}, fails: {self.why}; choose initial values "
                "with which the run reaches its end, by -o KEY=VALUE"
            )
        found = simulated_like(record, self._measured)
        found = {name: series for name, series in found.items() if name not in self._model.inputs}
        if not found:
            raise SceneError(
                f"{self._measured.name}: has only {', '.join(self._model.inputs)}, an input of {self._name} and not a "
                "result; measure another quantity too"
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
        """Abscissa for plots of the channels."""
        self._forget_others()
        if not np.any(np.nanmax(data.values, axis=1) > np.nanmin(data.values, axis=1)):
            raise SceneError(f"{self._measured.name}: all measured series are constant, must vary for a fit")
        return data

    def _forget_others(self) -> None:
        """Remove the quantities that have no channel from the measurement."""
        used = {"time", *(name for name, _ in self._places)}
        self._measured = replace(self._measured, variables=tuple(v for v in self._measured.variables if v.name in used))


def _shortened(scene: Scene, end: float) -> tuple[str, ...]:
    """Return the override that ends a run at the first stored instant at or after `end` [s], the end of a measurement.

    Return an empty tuple if the run is shorter.
    """
    run = scene.settings.run
    stored = run.dt_s * run.record_every
    duration = stored * math.ceil(end / stored - 1e-9)
    return (f"run.duration_s={duration!r}",) if 0.0 < duration < run.duration_s else ()


def _rows(values: FloatArray) -> FloatArray:
    """Return a series of shape (T, ...) as channels, an array of shape (C, T)."""
    return np.asarray(values, dtype=float).reshape(len(values), -1).T


def _at(record: Record, name: str, instants: FloatArray) -> Variable:
    """Return a variable of a record, interpolated at other instants."""
    found = record.variable(name)
    return replace(found, values=instants if name == "time" else at_instants(record["time"], record[name], instants))


def _apart(measured: Record, simulated: Record) -> str:
    measured_time, time = measured["time"], simulated["time"]
    return (
        f"{measured.name}: measured from {measured_time[0]:g} to {measured_time[-1]:g} s, must overlap with the run of "
        f"{simulated.name} from {time[0]:g} to {time[-1]:g} s: set run.duration_s, or let the file's time begin at 0"
    )
