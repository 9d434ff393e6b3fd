"""Models as the command line sees them: schema, checks, run, pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar

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
"""Draws a picture of a record."""

S = TypeVar("S", bound=Settings)

Rows = NDArray[np.bool_] | slice
"""Stored instants among those of a record."""

MOVIE_S = 30.0
"""Longest part of a run that is animated [s]."""

Observer = Callable[[int], bool]
"""Function of the number of finished steps; where it returns False, the run ends."""

Status = Literal["done", "interrupted", "diverged"]


class Movie(Protocol):
    """An animation ready to be written."""

    def save(self, path: Path, fps: int = 20) -> None:
        """Write a GIF or MP4; FileNotFoundError if a program for that is missing."""


class View(Protocol):
    """Writes the page of a record."""

    def __call__(self, record: Record, path: Path, *, skin: bool = True) -> None:
        """Write the page that shows a record in a browser."""


@dataclass(frozen=True)
class Watch:
    """How a run is watched while it goes on."""

    speed: float
    """Simulated over real time [1]."""
    began: Callable[[str], None]
    """Called with the address to visit, once there is something to see."""


def status_word(status: worm3d.Status | planar.status.Status) -> Status:
    """Return how a run ended, in a word."""
    if status.diverged:
        return "diverged"
    return "done" if status.name == "DONE" else "interrupted"


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, complete up to the last finished step, however it ended."""

    status: Status
    sentence: str
    """How the run ended, in a word and in a sentence (with step, time and place if it diverged)."""
    variables: tuple[Variable, ...]
    """Variables of the record; solver statistics of each step have the dimension "step"."""
    summary: Mapping[str, Metric]
    """The figures of `summary.json`; None, NaN and infinity need a reason."""
    reasons: Mapping[str, str]
    """Why a figure of the summary has no value."""
    wall_s: float
    """Wall time of the simulation alone [s]."""
    checkpoint: tuple[Variable, ...] = ()
    """State from which the run can go on; empty if this model cannot."""
    timing: tuple[Variable, ...] = ()
    """Further wall-clock figures; single numbers stand in `summary.json`."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Errors of the figures of the summary, by name; empty for a run without an accuracy."""
    run: str = ""
    parts: tuple[Variable, ...] = ()
    """Worm, world and end of the run, and their arrays, as in `Record`."""


def pictures(module: str, **functions: str) -> dict[str, Draw]:
    """Return the functions of a module that draw pictures, by file stem; it is imported when one is drawn."""

    def draw(function: str, record: Record) -> tuple[Picture, Axes]:
        drawn: tuple[Picture, Axes] = getattr(import_module(module), function)(record)
        return drawn

    return {stem: partial(draw, function) for stem, function in functions.items()}


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """What can be drawn of records of a kind."""

    name: str
    title: str
    """Noun phrase for people; `name` is the value of a scene's `model`."""
    figures: Mapping[str, Draw]
    """File stem -> function drawing it from a record."""
    overview: Callable[[Record], Image] | None
    """Draws the one figure that every run writes (`scenes.records.overview`)."""
    animate: Callable[[Record], Movie] | None = None
    """Returns the movie of a record."""
    view: View | None = None
    """Writes the page that shows a record in a browser, given its path; with `skin=True`, one with a smooth skin. A
    run then writes no animation, which would show less and take longer."""
    mesh: Callable[[Record, float | None], bytes] | None = None
    """Returns the mesh of a record at an instant [s] (None: the end), as a GLB file."""


@dataclass(frozen=True, kw_only=True)
class Model(Pictures, Generic[S]):
    """A model that scenes can choose."""

    schema: type[S]
    """Schema of the whole scene."""
    checks: tuple[Check, ...]
    """Checks across keys."""
    run: Callable[[S, Observer], Outcome]
    """Simulates a scene, calling the observer after each step."""
    advice: str
    """What to try when a run diverges."""
    headlines: tuple[tuple[str, str, str], ...] = field(default=())
    """Figures of the summary, beyond those of every worm that moves, that end a run's report."""
    moves: bool = True
    """Whether a worm moves."""
    inputs: tuple[str, ...] = ()
    """Variables of its records that a scene imposes: of a measurement they are nothing to fit to."""
    abscissa: str = "time"
    """Variable of its records, one number at each instant, over which a fit is drawn."""
    resume: Callable[[S, Record, Observer], Outcome] | None = None
    """Goes on from a record's checkpoint to the end of the scene; its outcome is that of the whole run."""
    watch: Callable[[S, Observer, Watch], Outcome] | None = None
    """Runs a scene in a live view."""
    beside: Callable[[S, Record, Rows], Mapping[str, Any]] | None = None
    """Returns arguments of `worm3d.results.pictures.arrays`: the period, and what to draw beside a worm at instants."""
    refers_to: Callable[[S], object] | None = None
    """What a run depends on that stands neither in its scene nor in a file that the scene names, as data for JSON."""
