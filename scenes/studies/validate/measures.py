"""What a comparison takes from runs of scenes: a figure, the ratio of two, or the exponent of a power law."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate

HOME = Path(__file__).parent
"""Folder of the scenes of this room."""

Changes = tuple[str, ...]
"""Changes of a scene, `section.key=value` each."""


class StoppedError(Exception):
    """A run did not come to its end; says why."""


class Measure(Protocol):
    """A number that runs give."""

    @property
    def scene(self) -> str:
        """Name of the scene."""

    def __call__(self, changes: Changes = ()) -> float:
        """Return the number, with further changes of the scene.

        Raises
        ------
        StoppedError
            A run did not come to its end.
        """


@dataclass(frozen=True)
class Figure:
    """A figure of a run, by its name in `FIGURES` or in the summary."""

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
    """A measure over another."""

    of: Measure
    over: Measure

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.of.scene

    def __call__(self, changes: Changes = ()) -> float:
        """Return the ratio; see `Measure`."""
        return self.of(changes) / self.over(changes)


@dataclass(frozen=True)
class Exponent:
    """Exponent of a power law, fitted to a measure over a number, least squares of the logarithms."""

    at: Mapping[float, Measure]

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
    """Run a scene of this room, or one that comes with the program, and return its figures.

    These are the numbers of its summary, and of worms those of `FIGURES`.

    Raises
    ------
    StoppedError
        The scene is refused, or the run did not come to its end.
    """
    own = HOME / f"{scene}.toml"
    try:
        record = simulate(load_scene(own if own.exists() else scene, changes))
    except SceneError as error:
        raise StoppedError("; ".join(error.lines)) from error
    if record.status != "done":
        raise StoppedError(record.sentence)
    known = {name: value for name, value in record.summary.metrics.items() if isinstance(value, float)}
    return known | ({name: figure(record) for name, figure in FIGURES.items()} if "com" in record else {})


def stride(record: Record) -> float:
    """Return how far the centre of mass comes in a period of the gait, towards the head at the start [m].

    It is the mean over the last whole periods that the second half of the run holds.
    """
    time, com, period = record["time"], record["com"], _period(record)
    periods = max(1, int(0.5 * time[-1] / period + 1e-9))
    first = int(np.argmin(np.abs(time - (time[-1] - periods * period))))
    chord = record["joints"][0, -1] - record["joints"][0, 0]
    return float((com[-1] - com[first]) @ chord / np.linalg.norm(chord) / periods)


def _period(record: Record) -> float:
    return float(_settings(record)["gait"]["period_s"])


def _length(record: Record) -> float:
    return float(_settings(record)["worm"]["length_m"])


FIGURES: Mapping[str, Callable[[Record], float]] = {
    "stride_m": stride,
    "stride_BL": lambda record: stride(record) / _length(record),
    "speed_m_s": lambda record: stride(record) / _period(record),
    "speed_BL_s": lambda record: stride(record) / _period(record) / _length(record),
}
"""Figures of a run by name; body lengths are those at rest."""


def _settings(record: Record) -> Mapping[str, Mapping[str, float]]:
    return tomllib.loads(record.scene)


def _merged(own: Changes, further: Iterable[str]) -> Changes:
    """Return changes of which the own ones win."""
    keys = {change.partition("=")[0] for change in own}
    return (*own, *(change for change in further if change.partition("=")[0] not in keys))
