"""The interface between the models and the command line: schema, checks, runs and pictures of a model."""

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
"""Longest time of a run that an animation shows [s]."""

Observer = Callable[[int], bool]
"""Function that is called with the number of finished steps; the run ends when the function returns False."""

Status = Literal["done", "interrupted", "diverged"]


@runtime_checkable
class Movie(Protocol):
    """An animation, ready for writing."""

    def save(self, path: Path, fps: int = 20) -> None:
        """Write a GIF or MP4 file; raise FileNotFoundError if a required program is missing."""


class View(Protocol):
    """Writer of the browser page of a record."""

    def __call__(self, record: Record, path: Path, *, skin: bool = True) -> None:
        """Write the page that shows a record in a browser."""


@dataclass(frozen=True)
class Watch:
    """Options for watching a run live."""

    speed: float
    """Speed of the display, simulated time over real time [1]."""
    began: Callable[[str], None]
    """Function that is called with the address of the page as soon as the page can be opened."""


class Played:
    """Drive of the worm of a scene that is played (`scenes.running.playing`), also after a change of values."""

    steers = ""
    """Text about the effect of the arrow keys."""

    def drive(self) -> tuple[Any, Any]:
        """Return the actuation and the sensor for the next part of the run, which go on from the part before."""
        raise NotImplementedError

    def follow(self, scene: Any, time: float) -> None:
        """Take over the values of a changed scene from a time on [s]."""

    def steer(self, left: float, up: float, heading: float) -> dict[str, float]:
        """Steer to the left and go faster, by numbers of key presses. `heading` is the present one [rad].

        Return the keys of the scene that have to change, with their new values. With 0 and 0, follow the scene again.
        """
        return {}

    def state(self) -> str:
        """Return a text for the page about steering that differs from the scene; empty without such steering."""
        return ""

    def horizon(self, time: float, com: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the path that a controller expects, as for `worm3d.Live`."""
        return None

    def path(self, com: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the path to keep near the centre of mass, shape (P, 3) [m], or None."""
        return None

    def wanted(self, time: float) -> float | None:
        """Return the speed that the worm has to keep [m/s], or None."""
        return None

    def forget(self) -> None:
        """Forget data that only a record of earlier times would need."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, also of a run that ended early, with all finished steps."""

    status: Status
    sentence: str
    """How the run ended, as a sentence. For a run that diverged, the sentence contains the step, time and place."""
    variables: tuple[Variable, ...]
    """Variables of the record; solver statistics of each step have the dimension "step"."""
    summary: Mapping[str, Metric]
    """Entries of `summary.json`. An entry without a value (None, NaN or infinity) needs a reason in `reasons`."""
    reasons: Mapping[str, str]
    """Reason why an entry of the summary has no value, by the name of the entry."""
    wall_s: float
    """Wall time of the simulation, without checks, files and pictures [s]."""
    checkpoint: tuple[Variable, ...] = ()
    """State for a continuation of the run; empty if the model does not support this."""
    timing: tuple[Variable, ...] = ()
    """Further wall-clock values; single numbers are written to `summary.json`."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Estimated errors of entries of the summary, by name; empty if no accuracy was requested."""
    run: str = ""
    """Description of the worm, the world and the end of the run as JSON, as in `Record`."""
    parts: tuple[Variable, ...] = ()
    """Arrays that belong to the description `run`, as in `Record`."""


def status_word(status: worm3d.Status | planar.status.Status) -> Status:
    """Return the status of a run as one word."""
    if status.diverged:
        return "diverged"
    return "done" if status.name == "DONE" else "interrupted"


def pictures(module: str, *stems: str) -> dict[str, Draw]:
    """Return functions that draw pictures, by name.

    A stem is the name of the function in `module`, and of the picture's file without its ending. The module is imported
    when the first picture is drawn.
    """

    def draw(function: str, record: Record) -> tuple[Picture, Axes]:
        drawn: tuple[Picture, Axes] = getattr(import_module(module), function)(record)
        return drawn

    return {stem: partial(draw, stem) for stem in stems}


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Pictures that can be drawn of records of one kind."""

    name: str
    title: str
    """Title of the model as users read it. `name` is the value of the key `model` in a scene."""
    figures: Mapping[str, Draw]
    """Functions that draw a figure from a record, by the name of the figure's file without its ending."""
    overview: Callable[[Record], Image] | None
    """Function that draws the figure written by every run (`scenes.records.overview`)."""
    animate: Callable[[Record], Movie] | None = None
    """Function that returns the movie of a record."""
    view: View | None = None
    """Function that writes a page that shows the run in a browser. If a model has this function, a run writes the
    page instead of an animation. With `skin=True`, the worm has a smooth skin."""
    mesh: Callable[[Record, float | None], bytes] | None = None
    """Function that returns a mesh of the worm at an instant [s] as the content of a GLB file. None means the end."""


@dataclass(frozen=True, kw_only=True)
class Model(Pictures, Generic[S]):
    """A model that can be chosen in scenes."""

    schema: type[S]
    """Schema of the whole scene."""
    checks: tuple[Check, ...]
    """Checks of the scene that involve several keys."""
    run: Callable[[S, Observer], Outcome]
    """Function that simulates a scene, and calls the observer after each step."""
    advice: str
    """Advice for a run that diverges."""
    headlines: tuple[tuple[str, str, str], ...] = field(default=())
    """Entries of the summary that a run prints at its end, each with the label and the unit. They are printed in
    addition to the entries that are printed for every moving worm."""
    entries: Mapping[str, str] = field(default_factory=dict)
    """Meanings of entries of the summary by name, for entries that are not measures of `worm3d.measures`."""
    moves: bool = True
    """Whether the model has a worm that moves."""
    inputs: tuple[str, ...] = ()
    """Variables of a record that the scene prescribes. A fit does not compare them with a measurement."""
    abscissa: str = "time"
    """Variable of a record for the horizontal axis in the figures of fits. It has one number per instant."""
    resume: Callable[[S, Record, Observer], Outcome] | None = None
    """Function that continues a run from the checkpoint of a record to the end of the scene. The outcome contains the
    whole run, not only the continuation."""
    watch: Callable[[S, Observer, Watch], Outcome] | None = None
    """Function that runs a scene while a browser shows the run."""
    played: Callable[[S], Played] | None = None
    """Function that returns what drives the worm while a scene is played."""
    recorded: Callable[[S, Any, worm3d.Result], Outcome] | None = None
    """Function that returns the last part of a played run as an outcome. The second argument is from `played`."""
    beside: Callable[[S, Record, Rows], Mapping[str, Any]] | None = None
    """Function that returns arguments of `worm3d.results.pictures.arrays`: the period of the gait, and what to draw
    in addition to the worm."""
    refers_to: Callable[[S], object] | None = None
    """Function that returns the data that affect a run in addition to the scene and the files named in it. The data
    can be written as JSON."""
