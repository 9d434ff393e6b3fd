"""`worm3d optimise`: search for the best gait in a scene, and write `gait.toml`, the card and a run with a film."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from control.gaits.periodic import Periodic
from scenes.language.loader import find_scene
from scenes.language.toml import value as toml_value
from scenes.models.loading import load_scene
from scenes.records.folder import VIEWER, write_bytes
from scenes.running.report import Heading, Report, StudyStoppedError, markdown, report_study
from scenes.running.runner import run_scene
from scenes.running.terminal import Interruption, progress
from scenes.studies.optimise.card import CONDITIONS, Card, fragment
from scenes.studies.optimise.goals import BROKEN
from scenes.studies.optimise.optimising import is_begun, searched, trials_of
from scenes.studies.optimise.search import Best, Found, Scores
from scenes.studies.optimise.trials import SURE_WAVES, Trials
from scenes.studies.optimise.unknowns import Choice
from scenes.sweep.engine import chosen
from scenes.sweep.executors import InProcess

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FILM_EVERY = 20.0
"""Least time between two films of the best gait so far [s]. A film takes about a second."""


@dataclass(frozen=True)
class Options:
    """Options of the command."""

    goal: str
    limits: Sequence[str]
    over: Sequence[str]
    free: str
    """As in `optimise`."""
    budget: int
    """Largest number of candidates of each search."""
    seed: int
    searches: int
    """Number of searches, with consecutive seeds."""
    workers: int | None
    scheduler: str | None
    """Number of processes, or address of a running Dask scheduler, that share the runs."""
    force: bool
    quiet: bool


def run(scene: str, overrides: Sequence[str], out: Path | None, options: Options) -> int:
    """Search, write the files, print the card, and return the exit code.

    Raises
    ------
    SceneError
        The scene has no 3D worm with a periodic gait, an option is wrong, or the folder cannot be used.
    """
    asked = str(find_scene(scene)), options.goal, tuple(overrides), tuple(options.limits), tuple(options.over)
    trials, executor = trials_of(*asked, options.free), chosen(options.workers, options.scheduler)

    def study(folder: Path) -> Report:
        began = perf_counter()
        with ExitStack() as stack:
            of: Scores = trials.scores
            if not isinstance(executor, InProcess):
                from scenes.studies.optimise.workers import Asked, scores_by  # imports Dask

                of = stack.enter_context(scores_by(executor, Asked(*asked, options.free)))
            card = Card(trials, _found(scene, overrides, trials, options, folder, of))
        return _report(scene, overrides, card, folder, perf_counter() - began, quiet=options.quiet)

    force = options.force or is_begun(out)
    return report_study(f"optimise-{trials.scene.name}", study, out, force=force, quiet=options.quiet)


def _found(
    scene: str, overrides: Sequence[str], trials: Trials, options: Options, folder: Path, of: Scores
) -> list[Found]:
    total, seeds = options.budget * options.searches, range(options.seed, options.seed + options.searches)
    filmed, then = math.inf, perf_counter()
    with Interruption() as interruption, progress(options.goal, total, quiet=options.quiet, what="run") as show:

        def go_on(seed: int, runs: int, best: Best) -> bool:
            nonlocal filmed, then
            if best.score.cost < min(filmed, BROKEN) and perf_counter() > then + FILM_EVERY:
                choice = trials.space.choice(best.at)
                _film(scene, overrides, choice, trials.gait_of(choice, trials.base_of(choice)), folder)
                filmed, then = best.score.cost, perf_counter()
            page = f", film {folder / 'best' / VIEWER}" if filmed < BROKEN else ""
            title = f"{options.goal}, seed {seed}: {best.score.value:.4g}{page}"
            show((seed - options.seed) * options.budget + runs, title)
            return not interruption.requested

        found = list[Found]()
        for each in searched(trials, options.free, options.budget, seeds, go_on, folder, of):
            found.append(each)
            if interruption.requested:
                kept = f"the finished runs are kept, the same command with --out {folder} goes on"
                raise StudyStoppedError(interruption.cause, kept)
    return found


def _report(scene: str, overrides: Sequence[str], card: Card, folder: Path, seconds: float, *, quiet: bool) -> Report:
    from scenes.studies.optimise.figure import draw  # imports matplotlib

    with progress("conditions", len(CONDITIONS), quiet=quiet, what="condition") as show:
        rows = card.measure(show)
    goal, best = card.trials.goal, card.best.best.score.value
    title = f"{card.trials.scene.name}, goal {goal.name}: {best:.4g}, found by worm3d optimise"
    text = _film(scene, overrides, card.choice, card.gait, folder, title)
    blocks, picture = list(card.blocks(rows, seconds)), draw(card)
    return Report(
        said=[block for block in blocks if not isinstance(block, Heading) or block.level > 1],
        pages={"card.md": blocks},
        files={"card.html": html(markdown(blocks), picture).encode(), "gait.toml": text.encode()},
        pictures={"gait.png": picture},
    )


def _film(
    scene: str, overrides: Sequence[str], choice: Choice, gait: Periodic, folder: Path, title: str = "the best so far"
) -> str:
    """Write and return `gait.toml`, run the gait in its scene, and write the results to the folder `best`."""
    text = fragment(gait, title, choice.changes)
    write_bytes(folder / "gait.toml", text.encode())
    given = f"gait={toml_value(str((folder / 'gait.toml').resolve()))}", f"run.duration_s={SURE_WAVES * gait.period!r}"
    run_scene(load_scene(scene, (*overrides, *choice.changes, *given)), folder / "best", force=True, quiet=True)
    return text


def html(page: str, picture: Figure) -> str:
    """Return a page in Markdown as HTML that contains its picture."""
    from markdown_it import MarkdownIt

    drawn = BytesIO()
    picture.savefig(drawn, format="png")
    inline = f"data:image/png;base64,{b64encode(drawn.getvalue()).decode()}"
    body = MarkdownIt("commonmark").enable("table").render(page).replace('src="gait.png"', f'src="{inline}"')
    style = (
        "body{max-width:60rem;margin:2rem auto;padding:0 1rem;font-family:sans-serif;line-height:1.5}"
        "img{max-width:100%}table{border-collapse:collapse;display:block;overflow-x:auto}"
        "td,th{border:1px solid #bbb;padding:.2rem .6rem;text-align:left}"
    )
    film = '<p><a href="best/viewer.html">Film of the gait</a></p>'
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><style>{style}</style>'
    return f'<!doctype html><html lang="en"><head>{head}<title>Card</title></head><body>{body}{film}</body></html>\n'
