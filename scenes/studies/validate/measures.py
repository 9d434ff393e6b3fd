"""Measures, numbers that are computed from runs of scenes.

A measure is a figure of one run, the ratio of two measures, or the exponent of a power law.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate

VALIDATION_FOLDER = Path(__file__).parent
"""Folder of this package, which also has its scenes."""

Changes = tuple[str, ...]
"""Changes of a scene, each of the form `section.key=value`."""


class StoppedError(Exception):
    """A run did not finish; the message gives the reason."""


class Measure(Protocol):
    """A number that is computed from runs."""

    @property
    def scene(self) -> str:
        """Name of the scene."""

    def __call__(self, changes: Changes = ()) -> float:
        """Run the scenes with further changes and return the number.

        Raises
        ------
        StoppedError
            A run did not finish.
        """


@dataclass(frozen=True)
class Figure:
    """Measure: a figure of a run, with its name in `run_figures` or in the summary of the run."""

    name: str
    scene: str
    changes: Changes = ()

    def __call__(self, changes: Changes = ()) -> float:
        """Return the figure; see `Measure`."""
        known = figures(self.scene, _merged(self.changes, changes))
        if self.name not in known:
            raise StoppedError(f"the run of {self.scene} has no {self.name}")
        return known[self.name]


@dataclass(frozen=True)
class Ratio:
    """Measure: the ratio of two measures."""

    of: Measure
    """Numerator."""
    over: Measure
    """Denominator."""

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.of.scene

    def __call__(self, changes: Changes = ()) -> float:
        """Return the ratio; see `Measure`."""
        return self.of(changes) / self.over(changes)


@dataclass(frozen=True)
class Exponent:
    """Measure: the exponent of a power law, fitted by least squares of the logarithms."""

    at: Mapping[float, Measure]
    """Measure for each value of the independent variable."""

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return next(iter(self.at.values())).scene

    def __call__(self, changes: Changes = ()) -> float:
        """Return the exponent; see `Measure`."""
        values = [measure(changes) for measure in self.at.values()]
        if min(values) <= 0.0:
            raise StoppedError("one of the runs does not get forward: there is no exponent")
        return float(np.polyfit(np.log(list(self.at)), np.log(values), 1)[0])


@cache
def figures(scene: str, changes: Changes) -> dict[str, float]:
    """Run a scene of this package or another shipped scene, and return the figures of the run by name.

    The figures are the numbers of the summary and, if the scene has a worm, the numbers of `run_figures`.

    Raises
    ------
    StoppedError
        The scene is invalid, or the run did not finish.
    """
    own = VALIDATION_FOLDER / f"{scene}.toml"
    try:
        record = simulate(load_scene(own if own.exists() else scene, changes))
    except SceneError as error:
        raise StoppedError("; ".join(error.lines)) from error
    if record.status != "done":
        raise StoppedError(record.sentence)
    known = {name: value for name, value in record.summary.metrics.items() if isinstance(value, float)}
    return known | (run_figures(record) if "com" in record else {})


def run_figures(record: Record) -> dict[str, float]:
    """Return the stride and the speed of a run, in SI units and in body lengths (BL, the length at rest).

    The stride is the displacement of the centre of mass per period of the gait, in the initial direction from tail to
    head. It is the mean over the whole periods of the second half of the run.
    """
    settings = tomllib.loads(record.scene)
    period, length = float(settings["gait"]["period_s"]), float(settings["worm"]["length_m"])
    time, com = record["time"], record["com"]
    periods = max(1, int(0.5 * time[-1] / period + 1e-9))
    first = int(np.argmin(np.abs(time - (time[-1] - periods * period))))
    chord = record["joints"][0, -1] - record["joints"][0, 0]
    stride = float((com[-1] - com[first]) @ chord / np.linalg.norm(chord) / periods)
    speed = stride / period
    return {"stride_m": stride, "stride_BL": stride / length, "speed_m_s": speed, "speed_BL_s": speed / length}


def _merged(own: Changes, further: Iterable[str]) -> Changes:
    """Return the union of two sets of changes. If both change the same key, the change in `own` is used."""
    keys = {change.partition("=")[0] for change in own}
    return (*own, *(change for change in further if change.partition("=")[0] not in keys))
