"""The Python interface of `worm3d fit`: fit keys of a scene to a measurement, and return values with intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.models.loading import load_scene
from scenes.records import measured
from scenes.records.record import Record
from scenes.studies.fit.identifiability import Relation
from scenes.studies.fit.lack import Lack
from scenes.studies.fit.noise import autocorrelation, noise_of
from scenes.studies.fit.solving import Solution, solve
from scenes.studies.fit.trials import Data, Trials
from scenes.studies.fit.varied import Varied, Wanted, varied_of
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import spelled
from worm3d.values.variable import Variable


@dataclass(frozen=True)
class Fitted:
    """A key of the scene and its fitted value."""

    varied: Varied
    value: float
    standard_error: float | None
    """Standard error of the value; None if the value has no interval."""
    interval: tuple[float, float] | None
    """Confidence interval of 95 %; None if the value has no interval."""
    reason: str
    """Reason why the value has no interval; empty if the value has an interval."""

    @property
    def interval_text(self) -> str:
        """The interval as text, or `none` if the value has no interval."""
        return f"{self.interval[0]:.4g} to {self.interval[1]:.4g}" if self.interval else "none"

    @property
    def unit(self) -> str:
        """Unit of the key; empty for a dimensionless key."""
        return "" if self.varied.unit == "1" else self.varied.unit

    @property
    def said(self) -> str:
        """The interval, or the reason why there is no interval, in brackets."""
        return f" ({self.interval_text if self.interval else self.reason})"


@dataclass(frozen=True)
class Channel:
    """A measured series and the residuals of the fit to the series."""

    name: str
    residual_rms: float
    """Root mean square of the residuals, in the unit of the channel."""
    residual_rms_over_peak: float
    """Root mean square of the residuals as a fraction of the largest magnitude of the data."""
    residual_autocorrelation_at_one_sample: float
    order_of_residuals: int
    """Order of the autoregressive model of the residuals."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit. P is the number of varied keys, C the number of channels, and T the number of instants."""

    name: str
    """Name of the scene."""
    measured: str
    """Name of the measurement."""
    keys: tuple[Fitted, ...]
    relations: tuple[Relation, ...]
    """Directions in the space of the keys that the data do not determine; empty if the data determine all values."""
    correlation: FloatArray
    """Correlations of the values, shape (P, P); 0 for a value without an interval."""
    channels: tuple[Channel, ...]
    data: Data
    lack: Lack
    """Result of the test whether the residuals change too slowly for noise. If so, the model is wrong, and the
    intervals are unreliable."""
    simulated: FloatArray
    """Channels of the run with the fitted values, shape (C, T); NaN where the data are NaN."""
    abscissa: Variable
    """Quantity on the horizontal axis of the figure (usually time), at the measured instants."""
    scene: str
    """Scene with the fitted values as TOML."""
    finished: bool
    """Whether a minimum was found; False if the allowed runs were used up first."""
    exact: bool
    """Whether the model matches the data to within integration errors. In this case intervals cannot be computed,
    since there is no noise."""
    left_out: tuple[str, ...]
    """Channels that no key affects. They are removed from `data` and `channels` if there are many channels."""
    runs: int
    """Number of all runs, including failed runs."""
    failed_runs: int
    """Number of failed runs."""

    def __repr__(self) -> str:
        found = (f"{each.varied.key} = {each.value:.6g}{each.said}" for each in self.keys)
        lack = "; the scene does not follow the data" if self.lack.found else ""
        return f"<fit of {self.name} to {self.measured}: {', '.join(found)}{lack}>"

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by key."""
        return {each.varied.key: each.value for each in self.keys}

    @property
    def measured_values(self) -> int:
        """Number of measured values in the fit."""
        return int(np.count_nonzero(np.isfinite(self.data.values)))

    @property
    def residuals(self) -> FloatArray:
        """Measured minus simulated values, shape (C, T)."""
        return self.data.values - self.simulated


@spelled
def fit(
    scene: str | Path,
    to: str | Path | Record,
    vary: Wanted,
    overrides: Iterable[str] = (),
    most_runs: int = 1000,
    go_on: Callable[[int], bool] = lambda done: True,
) -> Fit:
    """Fit keys of a scene to a measurement by least squares.

    Parameters
    ----------
    scene : str or Path
        Name of a shipped scene, or a TOML file. A run that is longer than the measurement is shortened to it.
    to : str, Path or Record
        The measurement: a CSV file (format in `scenes.records.measured`), or a record.
    vary : sequence of str, or mapping
        Keys to vary. Each string is `key` or `key=lo:hi`. A mapping has a range (lo, hi) for each key, or None for the
        range that the key has in all scenes. The search starts from the scene's value, which must lie in the range. If
        the scene has no value for the key, the search starts from the middle of the range.
    overrides : iterable of str
        Changes of the scene, each of the form `section.key=value`.
    most_runs : int
        Largest number of runs of the search. A fit of three keys needs about 250 runs.
    go_on : callable
        Called with the number of finished runs. If it returns False, the fit ends with a `StoppedError`.

    Returns
    -------
    Fit

    Raises
    ------
    SceneError
        The scene, the file or a key is wrong, the data are too few or constant, or the runs fail.
    """
    loaded = load_scene(scene, overrides)
    record = to if isinstance(to, Record) else measured.load(Path(to))
    trials = Trials(loaded, record, varied_of(loaded, vary), most_runs, go_on)
    found = solve(trials)
    return Fit(
        name=loaded.name,
        measured=record.name,
        keys=tuple(_fitted(trials, found, k) for k in range(len(trials.varied))),
        relations=found.relations,
        correlation=_correlation(found),
        channels=tuple(_channels(trials.data, found.simulated)),
        data=trials.data,
        lack=found.lack,
        simulated=found.simulated,
        abscissa=trials.abscissa,
        scene=trials.scene(found.values).to_toml(),
        finished=found.finished,
        exact=found.exact,
        left_out=trials.left_out,
        runs=trials.runs,
        failed_runs=trials.failed,
    )


def _fitted(trials: Trials, found: Solution, k: int) -> Fitted:
    value, varied = float(found.values[k]), trials.varied[k]
    if found.at_bound[k]:
        return Fitted(varied, value, None, None, f"at its {found.at_bound[k]} allowed value: widen the range")
    if not found.known[k]:
        return Fitted(varied, value, None, None, "the data do not determine it")
    if found.exact:
        return Fitted(varied, value, None, None, "the data are met exactly")
    half = float(found.uncertainty.half_width[k])
    interval = (max(varied.low, value - half), min(varied.high, value + half))
    return Fitted(varied, value, float(found.uncertainty.standard_error[k]), interval, "")


def _correlation(found: Solution) -> FloatArray:
    errors = np.where(found.known, found.uncertainty.standard_error, 0.0)
    inverse = np.divide(1.0, errors, out=np.zeros_like(errors), where=errors > 0.0)
    return np.asarray(found.uncertainty.covariance * np.outer(inverse, inverse))


def _channels(data: Data, simulated: FloatArray) -> list[Channel]:
    found = []
    for name, values, model in zip(data.names, data.values, simulated, strict=True):
        known = np.isfinite(values)
        left = values[known] - model[known]
        rms, peak = float(np.sqrt(np.mean(left**2))), float(np.abs(values[known]).max())
        order = noise_of(left[None]).order
        found.append(Channel(name, rms, rms / peak if peak else 0.0, float(autocorrelation(left, 1)[1]), order))
    return found
