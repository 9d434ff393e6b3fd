"""Search for a gait in two stages: random simple gaits, then CMA-ES over the gaits of all segments from the best one.

CMA-ES (N. Hansen, A. Ostermeier, Evol. Comput. 9:159, 2001) comes from the package `cma`. A search depends only on its
seed and on the scores. The scores are kept in a file. A search that is started again has the same candidates, and takes
the known scores from the file.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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
"""Candidates of a generation of CMA-ES, and its first step size. With a step of 0.2, in 400 runs one of two
seeds found no gait that is better than the best simple gait."""
PATIENCE, LEAST_GAIN, STARTS = 150, 0.01, 2
"""CMA-ES starts again from the best gait if so many runs have improved the value by less than this share. A search
stops if so many further starts in a row have gained less. On a slope of 15 degrees, a second start with seed 1 gained
less than 1 %, and a third start 11 %."""

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
    skipped: Mapping[str, int] = field(default_factory=dict)
    """Numbers of candidates without a value, by the reason."""


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
        kept = map(json.loads, lines[1:])
        self._kept = [Score(float(cost), float(value), why) for cost, value, why in kept]

    def scores(self, choices: Sequence[Choice], of: Scores) -> list[Score]:
        """Return the scores of candidates, from the file if it has them; otherwise compute and keep them."""
        known, self._kept = self._kept[: len(choices)], self._kept[len(choices) :]
        found = known if len(known) == len(choices) else of(choices)
        self._lines += [json.dumps([repr(each.cost), repr(each.value), each.why]) for each in found]
        if self._path is not None and not self._kept:
            write_bytes(self._path, "".join(f"{line}\n" for line in self._lines).encode())
        return found


def search(
    space: Space,
    of: Scores,
    seed: int,
    budget: int,
    log: Log,
    tell: Callable[[int, Best], bool],
    *,
    simple: bool,
    start: FloatArray | None = None,
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
        Function that is called after each generation with the number of runs and the best candidate. If it returns
        False, the search ends.
    simple : bool
        Whether only simple gaits are searched, with the whole budget.
    start : ndarray, shape (size,), optional
        Coordinates of a gait from which CMA-ES starts. Simple gaits are not searched then.
    """
    scores, best = list[Score](), None
    why = "the budget is used up"
    tried = simple_gaits(space, seed, budget if simple else min(SIMPLE_RUNS, budget))
    for generation in tried if start is None else [[start]]:
        best = _scored(generation, space, of, log, scores, best)
        if not tell(len(scores), best):
            return _found(seed, best, best, scores, "it was stopped")
    assert best is not None, "each search has a generation"
    first = origin = best
    begun, number, failed = len(scores), 1, 0
    strategy = None if simple else _strategy(space, seed, number)
    while strategy is not None and len(scores) + POPULATION <= budget:
        steps = [np.asarray(each) for each in strategy.ask()]
        asked = [space.inside(origin.at + space.neighbourly @ each) for each in steps]
        before = len(scores)
        best = _scored(asked, space, of, log, scores, best)
        strategy.tell(steps, [each.cost for each in scores[before:]])
        if not tell(len(scores), best):
            why = "it was stopped"
            break
        if _is_stuck(scores[begun:]):
            failed = 0 if _gains(origin.score.cost, best.score.cost) or number == 1 else failed + 1
            if failed == STARTS:
                why = f"{STARTS} starts from the best gait gained less than {LEAST_GAIN:.0%} each"
                break
            origin, begun, number = best, len(scores), number + 1
            strategy = _strategy(space, seed, number)
    return _found(seed, first, best, scores, why)


def _found(seed: int, simple: Best, best: Best, scores: Sequence[Score], why: str) -> Found:
    costs, skipped = np.array([each.cost for each in scores]), Counter(each.why for each in scores if each.why)
    return Found(seed, simple, best, costs, why, skipped)


def simple_gaits(space: Space, seed: int, runs: int) -> Iterator[list[FloatArray]]:
    """Yield coordinates of random simple gaits, `POPULATION` at a time."""
    rng = np.random.default_rng(seed)
    for start in range(0, runs, POPULATION):
        count = min(POPULATION, runs - start)
        yield [space.spread(rng.random(space.simple_size)) for _ in range(count)]


def _strategy(space: Space, seed: int, number: int) -> Any:
    try:
        import cma
    except ImportError as error:
        raise MissingPartError(f"{error}; pip install 'worm3d[optimise]'") from error
    rng = np.random.default_rng((seed, number))
    options = {
        "popsize": POPULATION,
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,  # the numbers above are used
        "verbose": -9,
        "verb_log": 0,
    }
    return cma.CMAEvolutionStrategy(np.zeros(len(space.neighbourly)), SIGMA, options)


def _scored(
    asked: Sequence[FloatArray], space: Space, of: Scores, log: Log, scores: list[Score], best: Best | None
) -> Best:
    """Score candidates, append their scores, and return the best candidate so far."""
    new = log.scores([space.choice(each) for each in asked], of)
    scores += new
    k = int(np.argmin([each.cost for each in new]))
    return Best(asked[k], new[k]) if best is None or new[k].cost < best.score.cost else best


def _is_stuck(scores: Sequence[Score]) -> bool:
    """Return whether the last `PATIENCE` runs of a start have hardly improved on the earlier runs of the start."""
    costs = [each.cost for each in scores]
    return len(costs) > PATIENCE and not _gains(min(costs[:-PATIENCE]), min(costs))


def _gains(earlier: float, now: float) -> bool:
    """Return whether a cost is less than an earlier one by at least the share `LEAST_GAIN`, or breaks limits less."""
    return earlier > now if now >= BROKEN else earlier >= BROKEN or earlier - now >= LEAST_GAIN * abs(now)
