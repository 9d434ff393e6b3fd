"""Scores of candidates, computed by the workers of a Dask scheduler."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import NamedTuple

from distributed import Client, Future, KilledWorker

from scenes.language.errors import SceneError
from scenes.studies.optimise.goals import FAILED
from scenes.studies.optimise.optimising import trials_of
from scenes.studies.optimise.search import POPULATION, Scores
from scenes.studies.optimise.trials import Score
from scenes.studies.optimise.unknowns import Choice
from scenes.sweep.cluster import Local, Remote, require_single
from scenes.sweep.executors import Executor
from scenes.sweep.flight import WORKER_TIMEOUT_S


class Asked(NamedTuple):
    """Arguments of `trials_of`."""

    scene: str
    goal: str
    overrides: tuple[str, ...]
    limits: tuple[str, ...]
    over: tuple[str, ...]
    free: str


@contextmanager
def scores_by(executor: Executor, asked: Asked) -> Iterator[Scores]:
    """Context with a function that returns the scores of candidates from the workers of an executor."""
    assert isinstance(executor, Local | Remote), "the executor has workers"
    with executor.connected(POPULATION) as client:
        require_worker(client)
        yield lambda choices: _scores(client, asked, choices)


def require_worker(client: Client) -> None:
    """Raise SceneError if the scheduler has no worker, or a worker runs several trials at the same time."""
    try:
        client.wait_for_workers(1, timeout=WORKER_TIMEOUT_S)
    except TimeoutError as error:
        raise SceneError(
            f"--scheduler: the scheduler has had no worker for {WORKER_TIMEOUT_S:g} s; 'dask worker ADDRESS --nthreads "
            "1' starts one"
        ) from error
    require_single(client.nthreads())


def _scores(client: Client, asked: Asked, choices: Sequence[Choice]) -> list[Score]:
    return [_ended(each) for each in client.map(_score, choices, asked=asked, pure=False)]


def _ended(future: Future) -> Score:
    try:
        found: Score = future.result()
    except KilledWorker:
        return Score(FAILED, math.nan, "the worker died")
    return found


def _score(choice: Choice, asked: Asked) -> Score:
    return _trials(asked)([choice])[0]


@lru_cache(maxsize=1)
def _trials(asked: Asked) -> Scores:
    return trials_of(*asked).scores
