"""`worm3d optimise --front`: the best value of the goal at several minimum speeds, and the simple gaits behind it.

The searches begin at the greatest speed. Each further search starts from the gait found before, which fulfils the lower
bound of the speed as well. Therefore no gait of the front is worse than a faster one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from control.gaits.periodic import Periodic
from scenes.language.errors import SceneError
from scenes.records.text import Column
from scenes.running.report import Block, Heading, Picture, Report, StudyStoppedError, Table, report_study
from scenes.running.terminal import Interruption, progress
from scenes.studies.optimise.card import fragment
from scenes.studies.optimise.goals import BROKEN
from scenes.studies.optimise.optimising import is_begun, search_of, trials_of
from scenes.studies.optimise.search import SIMPLE_RUNS, Best, simple_gaits
from scenes.studies.optimise.trials import SURE_WAVES, Trials
from scenes.studies.optimise.unknowns import Choice
from worm3d.measures import MEASURES
from worm3d.values.arrays import FloatArray

SPEED = "speed_bl_s"


@dataclass(frozen=True)
class Point:
    """The best gait at a minimum speed."""

    least: float
    """Least speed [body lengths/s]."""
    speed: float
    """Speed in a run of six waves [body lengths/s]."""
    value: float
    """Value of the goal in this run."""
    runs: int
    """Number of candidates."""
    choice: Choice
    gait: Periodic

    @property
    def file(self) -> str:
        """Name of the file of the gait."""
        return f"gait_{self.least:g}.toml"


COLUMNS = {
    "minimum speed [BL/s]": Column("least", "g"),
    "speed [BL/s]": Column("speed", ".4g"),
    "value": Column("value", ".4g"),
    "runs": Column("runs", "d"),
    "gait": Column("file"),
}


def run(
    scene: str,
    overrides: Sequence[str],
    out: Path | None,
    goal: str,
    limits: Sequence[str],
    over: Sequence[str],
    speeds: str,
    budget: int,
    seed: int,
    *,
    force: bool,
    quiet: bool,
) -> int:
    """Search, write the front, and return the exit code; SceneError if an option is wrong."""
    try:
        wanted = sorted({float(each) for each in speeds.split(",")}, reverse=True)
    except ValueError:
        wanted = []
    if not wanted or not 0.0 < wanted[-1] <= wanted[0] < np.inf:
        raise SceneError(f"--front: got '{speeds}', must be minimum speeds in body lengths/s, such as 0.03,0.06,0.1")
    all_trials = [
        trials_of(scene, goal, overrides, (*limits, f"{SPEED}>={each!r}"), over, "segments") for each in wanted
    ]
    plain = trials_of(scene, goal, overrides, (*limits, f"{SPEED}>=0"), over, "segments")

    def study(folder: Path) -> Report:
        points = _points(plain, all_trials, wanted, budget, seed, folder, quiet=quiet)
        choices = map(plain.space.choice, chain.from_iterable(simple_gaits(plain.space, seed, SIMPLE_RUNS)))
        simple = plain.measured(list(choices), (MEASURES[SPEED], plain.goal.measure))
        blocks = list(_blocks(plain, points))
        return Report(
            said=blocks,
            pages={"front.md": blocks},
            files={
                each.file: fragment(
                    each.gait, f"{goal} at a minimum speed of {each.least:g} BL/s", each.choice.changes
                ).encode()
                for each in points
            },
            pictures={"front.png": draw(plain, points, simple)},
        )

    return report_study(f"optimise-{plain.scene.name}", study, out, force=force or is_begun(out), quiet=quiet)


def _points(
    plain: Trials,
    all_trials: Sequence[Trials],
    speeds: Sequence[float],
    budget: int,
    seed: int,
    folder: Path,
    *,
    quiet: bool,
) -> list[Point]:
    points, start = list[Point](), None
    with (
        Interruption() as interruption,
        progress("front", budget * len(speeds), quiet=quiet, what="run") as show,
    ):
        for k, (trials, least) in enumerate(zip(all_trials, speeds, strict=True)):

            def go_on(seed: int, runs: int, best: Best, k: int = k, least: float = least) -> bool:
                show(k * budget + runs, f"speed {least:g}: {best.score.value:.4g}")
                return not interruption.requested

            found = search_of(trials, "segments", budget, seed, go_on, folder, start=start, name=f"{least:g}-")
            if interruption.requested:
                raise StudyStoppedError(interruption.cause, f"the same command with --out {folder} goes on")
            if found.best.score.cost >= BROKEN:
                continue
            start, choice = found.best.at, trials.space.choice(found.best.at)
            gait = trials.gait_of(choice, trials.base_of(choice))
            for speed, value in plain.measured([choice], (MEASURES[SPEED], trials.goal.measure), SURE_WAVES):
                points.append(Point(least, float(speed), float(value), len(found.costs), choice, gait))
    return points


def _blocks(trials: Trials, points: Sequence[Point]) -> Iterator[Block]:
    yield Heading(f"{trials.scene.name}: {trials.goal.meaning} over the speed", 1)
    if not points:
        yield "No gait reaches the minimum speeds within the other limits: choose lower speeds, or a larger budget."
    yield Table.of(COLUMNS, points)
    yield Picture("front.png", "The optimised gaits, and simple gaits.")


def draw(trials: Trials, points: Sequence[Point], simple: FloatArray) -> Figure:
    """Return the figure of the values over the speed. `simple` are speeds and values of simple gaits, shape (K, 2)."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained", dpi=110)
    axes = figure.subplots()
    if len(simple):
        axes.plot(*simple.T, ".", color="0.6", label="simple gaits")
    axes.plot([each.speed for each in points], [each.value for each in points], "o-", color="C3", label="optimised")
    if trials.goal.smallest and points:
        axes.set_ylim(0.0, 4.0 * max(each.value for each in points))
    axes.set(xlabel="speed [body lengths/s]", ylabel=trials.goal.meaning, xlim=(0.0, None))
    axes.legend()
    axes.grid(alpha=0.25)
    return figure
