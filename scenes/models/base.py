"""Models as the command line uses them: schema, checks, runs and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from scenes.language.checks import Check
from scenes.models.sections import Settings
from scenes.records.record import Metric, Record
from worm3d.values.variable import Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture
    from PIL.Image import Image

    import planar.status
    import worm3d

Draw = Callable[[Record], "tuple[Picture, Axes]"]
"""Function that draws a picture of a record."""

S = TypeVar("S", bound=Settings)

Rows = NDArray[np.bool_] | slice
"""Selection of the stored instants of a record."""

MOVIE_S = 30.0
"""Longest part of a run in an animation [s]."""

Observer = Callable[[int], bool]
"""Function of the number of finished steps; the run ends when the function returns False."""

Status = Literal["done", "interrupted", "diverged"]


@runtime_checkable
class Movie(Protocol):
    """An animation, ready for writing."""

    def save(self, path: Path, fps: int = 20) -> None:
        """Write a GIF or MP4; FileNotFoundError if a required program is missing."""


class View(Protocol):
    """Writer of the browser page of a record."""

    def __call__(self, record: Record, path: Path, *, skin: bool = True) -> None:
        """Write the page that shows a record in a browser."""


@dataclass(frozen=True)
class Watch:
    """Options for watching a run live."""

    speed: float
    """Simulated time over real time [1]."""
    began: Callable[[str], None]
    """Function that is called with the address of the page as soon as the page can be opened."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, complete up to the last finished step, also after an early end."""

    status: Status
    sentence: str
    """End of the run, in a word and in a sentence (with step, time and place of a divergence)."""
    variables: tuple[Variable, ...]
    """Variables of the record; solver statistics of each step have the dimension "step"."""
    summary: Mapping[str, Metric]
    """Entries of `summary.json`; None, NaN and infinity need a reason."""
    reasons: Mapping[str, str]
    """Reasons for entries of the summary without a value."""
    wall_s: float
    """Wall time of the simulation alone [s]."""
    checkpoint: tuple[Variable, ...] = ()
    """State from which the run can be continued; empty if the model does not support this."""
    timing: tuple[Variable, ...] = ()
    """Further wall-clock values; single numbers are written to `summary.json`."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Errors of entries of the summary, by name; empty for a run without a given accuracy."""
    run: str = ""
    parts: tuple[Variable, ...] = ()
    """Worm, world and end of the run (`run`), and their arrays, as in `Record`."""


def status_word(status: worm3d.Status | planar.status.Status) -> Status:
    """Return the status of a run as one word."""
    if status.diverged:
        return "diverged"
    return "done" if status.name == "DONE" else "interrupted"


def pictures(module: str, *stems: str) -> dict[str, Draw]:
    """Return functions that draw pictures, by their name, the file stem; the first picture imports the module."""

    def draw(function: str, record: Record) -> tuple[Picture, Axes]:
        drawn: tuple[Picture, Axes] = getattr(import_module(module), function)(record)
        return drawn

    return {stem: partial(draw, stem) for stem in stems}


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Pictures that can be drawn of records of one kind."""

    name: str
    title: str
    """Noun phrase for users; `name` is the value of a scene's `model`."""
    figures: Mapping[str, Draw]
    """File stem -> function that draws the figure from a record."""
    overview: Callable[[Record], Image] | None
    """Function that draws the figure written by every run (`scenes.records.overview`)."""
    animate: Callable[[Record], Movie] | None = None
    """Function that returns the movie of a record."""
    view: View | None = None
    """Function that writes the page of a record for a browser to a path; with `skin=True`, the worm has a smooth skin.
    A run then writes no animation, which would show less and take longer."""
    mesh: Callable[[Record, float | None], bytes] | None = None
    """Function that returns a mesh of a record at an instant [s] (None: the end), as a GLB file."""


@dataclass(frozen=True, kw_only=True)
class Model(Pictures, Generic[S]):
    """A model that can be chosen in scenes."""

    schema: type[S]
    """Schema of the whole scene."""
    checks: tuple[Check, ...]
    """Checks across keys."""
    run: Callable[[S, Observer], Outcome]
    """Function that simulates a scene, and calls the observer after each step."""
    advice: str
    """Advice for a run that diverges."""
    headlines: tuple[tuple[str, str, str], ...] = field(default=())
    """Entries of the summary at the end of a run's report, in addition to those for every moving worm."""
    moves: bool = True
    """Whether a worm moves."""
    inputs: tuple[str, ...] = ()
    """Variables of a record that a scene prescribes: a fit ignores these variables in a measurement."""
    abscissa: str = "time"
    """Variable of a record, one number per instant, for the horizontal axis of the figures of fits."""
    resume: Callable[[S, Record, Observer], Outcome] | None = None
    """Function that continues from a record's checkpoint to the end of the scene; the outcome covers the whole run."""
    watch: Callable[[S, Observer, Watch], Outcome] | None = None
    """Function that runs a scene in a live view."""
    beside: Callable[[S, Record, Rows], Mapping[str, Any]] | None = None
    """Function that returns arguments of `worm3d.results.pictures.arrays`: the period, and objects beside the worm."""
    refers_to: Callable[[S], object] | None = None
    """Function that returns the dependencies of a run outside the scene and its named files, as data for JSON."""
