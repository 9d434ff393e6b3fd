"""Optimisation of the gait of a scene, with several searches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from scenes.language.errors import SceneError
from scenes.records.folder import TEMPORARY_PREFIX
from scenes.studies.optimise.card import Card
from scenes.studies.optimise.goals import goal_of
from scenes.studies.optimise.search import Best, Found, Log, Scores, search
from scenes.studies.optimise.trials import Trials
from scenes.studies.optimise.unknowns import free_of
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import spelled

FREE = ("segments", "waves")
"""Values of the argument `free`: separate shapes of the segments, or simple gaits only."""

LOG_PREFIX = f"{TEMPORARY_PREFIX}search-"
"""Begin of the names of the files with the scores of searches."""

GoOn = Callable[[int, int, Best], bool]
"""Function of seed, number of runs and best candidate. If it returns False, the search ends."""


@spelled
def optimise(
    scene: str | Path,
    goal: str = "robust",
    overrides: Iterable[str] = (),
    limits: Iterable[str] = (),
    over: Iterable[str] = (),
    free: str = "segments",
    budget: int = 1500,
    seed: int = 0,
    searches: int = 2,
    go_on: GoOn = lambda seed, runs, best: True,
) -> Card:
    """Search for the best gait of the worm in a scene. The amplitude and the period are taken from the scene.

    Parameters
    ----------
    scene : str or Path
        Name of a shipped scene, or a TOML file, with a 3D worm and a periodic gait.
    goal : str
        "robust", "speed", "cost", "turn", "climb", or `module:NAME` of a measure that is to be large.
    overrides : iterable of str
        Changes of the scene, each of the form `section.key=value`.
    limits : iterable of str
        Bounds of measures, each of the form `measure<=value` or `measure>=value`. A candidate that breaks a limit is
        worse than all others.
    over : iterable of str
        Keys of the scene that are searched as well, each of the form `section.key=low:high`.
    free : str
        "segments" for a shape of each segment, or "waves" for waves with the same shape in all segments.
    budget : int
        Largest number of candidates of each search.
    seed : int
        Seed of the first search. Each further search has the next seed.
    searches : int
        Number of searches; the best search counts.
    go_on : callable
        Function that is called with seed, number of runs and best candidate. If it returns False, the search ends.

    Returns
    -------
    Card
        The attribute `gait` is the best gait, and the method `measure` returns how much of the value is left under
        other conditions.

    Raises
    ------
    SceneError
        The scene, the goal, a limit or a key is wrong.
    """
    trials = trials_of(scene, goal, overrides, limits, over, free)
    return Card(trials, list(searched(trials, free, budget, range(seed, seed + searches), go_on)))


def trials_of(
    scene: str | Path, goal: str, overrides: Iterable[str], limits: Iterable[str], over: Iterable[str], free: str
) -> Trials:
    """Return the runs of an optimisation. The parameters and errors are the same as in `optimise`."""
    if free not in FREE:
        raise SceneError(f"free: got '{free}', must be one of {', '.join(FREE)}")
    trials = Trials(str(scene), tuple(overrides), goal_of(goal, tuple(limits)), [free_of(text) for text in over])
    trials.require_value()
    return trials


def is_begun(folder: Path | None) -> bool:
    """Return whether a folder has the scores of an earlier search, which the same search can go on with."""
    return folder is not None and any(folder.glob(f"{LOG_PREFIX}*"))


def searched(
    trials: Trials,
    free: str,
    budget: int,
    seeds: Iterable[int],
    go_on: GoOn,
    folder: Path | None = None,
    of: Scores | None = None,
) -> Iterator[Found]:
    """Yield the result of a search for each seed. The scores are kept in `folder`, if given. `of` computes them."""
    for seed in seeds:
        yield search_of(trials, free, budget, seed, go_on, folder, of)


def search_of(
    trials: Trials,
    free: str,
    budget: int,
    seed: int,
    go_on: GoOn,
    folder: Path | None,
    of: Scores | None = None,
    start: FloatArray | None = None,
    name: str = "",
) -> Found:
    """Return the result of a search. The scores are kept in a file of `folder`, with `name` in the file name."""
    begun = {} if start is None else {"start": start.tolist()}
    settings = {**trials.settings, "free": free, "seed": seed, **begun}
    log = Log(None if folder is None else folder / f"{LOG_PREFIX}{name}{seed}.jsonl", settings)

    def tell(runs: int, best: Best) -> bool:
        return go_on(seed, runs, best)

    scores = of or trials.scores
    return search(trials.space, scores, seed, budget, log, tell, simple=free == "waves", start=start)
