"""Search for a gait in two stages: random simple gaits, then CMA-ES over the gaits of all segments from the best one.

CMA-ES (N. Hansen, A. Ostermeier, Evol. Comput. 9:159, 2001) comes from the package `cma`. A search depends only on its
seed and on the scores. It keeps the scores in a file. A search that is started again asks for the same candidates, and
takes the scores of the first ones from the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.language.errors import MissingPartError, SceneError
from scenes.records.folder import disc_errors, write_bytes
from scenes.studies.optimise.goals import BROKEN
from scenes.studies.optimise.trials import Score
from scenes.studies.optimise.unknowns import Choice, Space
from worm3d.values.arrays import FloatArray

SIMPLE_RUNS = 202
"""Number of simple gaits."""
POPULATION, SIGMA = 14, 0.1
"""Candidates of a generation of CMA-ES, and its first step size. With a step of 0.2, one of two seeds found no
gait that is better than the best simple one in 400 runs."""
PATIENCE, LEAST_GAIN = 150, 0.01
"""CMA-ES starts again from the best gait if so many runs have improved the value by less than this share. A search
stops if a further start gains less."""

Scores = Callable[[Sequence[Choice]], list[Score]]


@dataclass(frozen=True)
class Best:
    """Best candidate of a stage."""

    at: FloatArray
    """Coordinates in the space of all gaits."""
    score: Score


@dataclass(frozen=True)
class Found:
    """Result of a search."""

    seed: int
    simple: Best
    """Best simple gait."""
    best: Best
    costs: FloatArray
    """Cost of each run, shape (runs,)."""
    why: str
    """Why the search stopped."""


class Log:
    """File with the scores of a search, which a later search with the same settings reads first; no file for None.

    Raises
    ------
    SceneError
        The file belongs to a search with other settings.
    DiscError
        The file cannot be read or written.
    """

    def __init__(self, path: Path | None, settings: Mapping[str, Any]) -> None:
        self._path, self._kept, self._lines = path, list[Score](), [json.dumps(dict(settings), sort_keys=True)]
        if path is None:
            return
        with disc_errors(path):
            lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else self._lines
        if lines[:1] != self._lines:
            raise SceneError(f"{path}: belongs to a search with other settings; choose another --out")
        self._kept = [Score(*map(float, json.loads(line))) for line in lines[1:]]

    def scores(self, choices: Sequence[Choice], of: Scores) -> list[Score]:
        """Return the scores of candidates, from the file if it has them; otherwise compute and keep them."""
        known, self._kept = self._kept[: len(choices)], self._kept[len(choices) :]
        found = known if len(known) == len(choices) else of(choices)
        self._lines += [json.dumps([repr(each.cost), repr(each.value)]) for each in found]
        if self._path is not None and not self._kept:
            write_bytes(self._path, "".join(f"{line}\n" for line in self._lines).encode())
        return found


def search(
    space: Space, of: Scores, seed: int, budget: int, log: Log, tell: Callable[[int, Score], bool], *, simple: bool
) -> Found:
    """Search for the gait with the least cost.

    Parameters
    ----------
    space : Space
    of : callable
        Function that returns the scores of candidates.
    seed : int
        Seed of the random numbers.
    budget : int
        Largest number of runs.
    log : Log
    tell : callable
        Function that is called after each generation with the number of runs and the best score. If it returns False,
        the search ends.
    simple : bool
        Whether only simple gaits are searched, with the whole budget.
    """
    costs, best = list[float](), None
    why = "the budget is used up"
    for generation in _generations(space, seed, budget if simple else min(SIMPLE_RUNS, budget)):
        best = _scored(generation, space, of, log, costs, best)
        if not tell(len(costs), best.score):
            return Found(seed, best, best, np.array(costs), "it was stopped")
    assert best is not None, "each search has a generation"
    first = best
    starts = [len(costs)]  # run at which each strategy begins
    strategy = None if simple else _strategy(space, best.at, seed, 1)
    while strategy is not None and len(costs) + POPULATION <= budget:
        asked = [np.asarray(each) for each in strategy.ask()]
        before = len(costs)
        best = _scored(asked, space, of, log, costs, best)
        strategy.tell(asked, costs[before:])
        if not tell(len(costs), best.score):
            why = "it was stopped"
            break
        if _is_stuck(costs, starts[-1], PATIENCE):
            if len(starts) > 1 and _is_stuck(costs, starts[-1], len(costs) - starts[-1]):
                why = f"a start from the best gait gained less than {LEAST_GAIN:.0%} in {PATIENCE} runs"
                break
            starts.append(len(costs))
            strategy = _strategy(space, best.at, seed, len(starts))
    return Found(seed, first, best, np.array(costs), why)


def _generations(space: Space, seed: int, runs: int) -> Iterator[list[FloatArray]]:
    """Yield random simple gaits, `POPULATION` at a time."""
    rng = np.random.default_rng(seed)
    for start in range(0, runs, POPULATION):
        count = min(POPULATION, runs - start)
        yield [space.spread(rng.random(space.simple_size)) for _ in range(count)]


def _strategy(space: Space, at: FloatArray, seed: int, number: int) -> Any:
    try:
        import cma
    except ImportError as error:
        raise MissingPartError(f"{error}; pip install 'worm3d[optimise]'") from error
    rng = np.random.default_rng((seed, number))
    options = {
        "popsize": POPULATION,
        "bounds": list(space.bounds),
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,  # the numbers above are used
        "verbose": -9,
        "verb_log": 0,
    }
    return cma.CMAEvolutionStrategy(at, SIGMA, options)


def _scored(
    asked: Sequence[FloatArray], space: Space, of: Scores, log: Log, costs: list[float], best: Best | None
) -> Best:
    """Score candidates, append their costs, and return the best candidate so far."""
    scores = log.scores([space.choice(each) for each in asked], of)
    costs += [each.cost for each in scores]
    k = int(np.argmin([each.cost for each in scores]))
    return Best(asked[k], scores[k]) if best is None or scores[k].cost < best.score.cost else best


def _is_stuck(costs: Sequence[float], start: int, runs: int) -> bool:
    """Return whether the last `runs` runs, at least `PATIENCE` after run `start`, have hardly improved the cost."""
    if len(costs) - start < PATIENCE:
        return False
    earlier, now = min(costs[:-runs]), min(costs)
    if now >= BROKEN:
        return earlier == now
    return earlier < BROKEN and earlier - now < LEAST_GAIN * abs(now)
