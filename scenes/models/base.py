"""Models as the command line sees them: schema, checks, run, pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Generic, Literal, Protocol, TypeVar

from scenes.language.checks import Check
from scenes.models.sections import Settings
from scenes.records.record import Metric, Record
from worm3d.values.variable import Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture
    from PIL.Image import Image

Draw = Callable[[Record], "tuple[Picture, Axes]"]
"""Draws a picture of a record."""

S = TypeVar("S", bound=Settings)

MOVIE_S = 30.0
"""Longest part of a run that is animated [s]."""

Observer = Callable[[int], bool]
"""Function of the number of finished steps; where it returns False, the run ends."""

Status = Literal["done", "interrupted", "diverged", "incomplete"]
"""Incomplete: some cases of a study came to their end, others did not."""


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
    """How a run is watched while it goes on.

    Attributes
    ----------
    speed : float
        Simulated over real time.
    began : callable
        Called with the address to visit, once there is something to see.
    """

    speed: float
    began: Callable[[str], None]


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, complete up to the last finished step, however it ended.

    Attributes
    ----------
    status, sentence : str
        How the run ended, in a word and in a sentence (with step, time and place if it diverged).
    variables : tuple of Variable
        Per-step solver statistics have the dimension "step".
    summary : mapping
        The figures of `summary.json`; None, NaN and infinity need a reason.
    reasons : mapping
        Why a figure of the summary has no value.
    wall_s : float
        Wall time of the simulation alone [s].
    checkpoint : tuple of Variable
        From which the run can go on; empty if this model cannot.
    timing : tuple of Variable
        Further wall-clock figures; single numbers stand in `summary.json`.
    run, parts : str, tuple of Variable
        As in `Record`.
    """

    status: Status
    sentence: str
    variables: tuple[Variable, ...]
    summary: Mapping[str, Metric]
    reasons: Mapping[str, str]
    wall_s: float
    checkpoint: tuple[Variable, ...] = ()
    timing: tuple[Variable, ...] = ()
    run: str = ""
    parts: tuple[Variable, ...] = ()


def pictures(module: str, **functions: str) -> dict[str, Draw]:
    """Return the functions of a module that draw pictures, by file stem; it is imported when one is drawn."""

    def draw(function: str, record: Record) -> tuple[Picture, Axes]:
        drawn: tuple[Picture, Axes] = getattr(import_module(module), function)(record)
        return drawn

    return {stem: partial(draw, function) for stem, function in functions.items()}


@dataclass(frozen=True)
class Model(Generic[S]):
    """A model that scenes can choose.

    Attributes
    ----------
    name, title : str
        Value of a scene's `model`, and what it is.
    schema : type
        The whole scene.
    checks : tuple of Check
        Across keys.
    run : callable
        Simulates a scene, calling the observer after each step.
    figures : mapping
        File stem -> function drawing it from a record.
    overview : callable
        Draws the one figure that every run writes (`scenes.records.overview`).
    animate : callable or None
        Returns the movie of a record.
    advice : str
        What to try when a run diverges.
    headlines : tuple of (key, label, unit)
        Figures of the summary, beyond those of every model, that end a run's report.
    table : callable, optional
        Lines that end a run's report instead of figures: the cases of a study.
    resume : callable, optional
        Goes on from a record's checkpoint to the end of the scene; its outcome is that of the whole run.
    view : callable, optional
        Writes the page that shows a record in a browser, given its path; with `skin=True`, one with a smooth skin. A
        run then writes no animation, which would show less and take longer.
    mesh : callable, optional
        Returns the mesh of a record at an instant [s] (None: the end), as a GLB file.
    watch : callable, optional
        Runs a scene in a live view.
    """

    name: str
    title: str
    schema: type[S]
    checks: tuple[Check, ...]
    run: Callable[[S, Observer], Outcome]
    figures: Mapping[str, Draw]
    overview: Callable[[Record], Image]
    animate: Callable[[Record], Movie] | None
    advice: str
    headlines: tuple[tuple[str, str, str], ...] = field(default=())
    table: Callable[[Record], list[str]] | None = None
    resume: Callable[[S, Record, Observer], Outcome] | None = None
    view: View | None = None
    mesh: Callable[[Record, float | None], bytes] | None = None
    watch: Callable[[S, Observer, Watch], Outcome] | None = None
