"""`worm3d optimise`: search for the best gait in a scene, and write `gait.toml`, the card and a run with a film."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from scenes.language.toml import value as toml_value
from scenes.models.loading import load_scene
from scenes.records.folder import write_bytes
from scenes.running.report import Heading, Report, StudyStoppedError, markdown, report_study
from scenes.running.runner import run_scene
from scenes.running.terminal import Interruption, progress
from scenes.studies.optimise.card import CONDITIONS, Card, fragment
from scenes.studies.optimise.optimising import searched, trials_of
from scenes.studies.optimise.search import Found
from scenes.studies.optimise.trials import SURE_WAVES, Score, Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    force: bool
    quiet: bool


def run(scene: str, overrides: Sequence[str], out: Path | None, options: Options) -> int:
    """Search, write the files, print the card, and return the exit code.

    Raises
    ------
    SceneError
        The scene has no 3D worm with a periodic gait, an option is wrong, or the folder cannot be used.
    """
    trials = trials_of(scene, options.goal, overrides, options.limits, options.over, options.free)

    def study(folder: Path) -> Report:
        began = perf_counter()
        card = Card(trials, _found(trials, options, folder))
        return _report(scene, overrides, card, folder, perf_counter() - began, quiet=options.quiet)

    return report_study(f"optimise-{trials.scene.name}", study, out, force=options.force, quiet=options.quiet)


def _found(trials: Trials, options: Options, folder: Path) -> list[Found]:
    total, seeds = options.budget * options.searches, range(options.seed, options.seed + options.searches)
    with Interruption() as interruption, progress(options.goal, total, quiet=options.quiet, what="run") as show:

        def go_on(seed: int, runs: int, best: Score) -> bool:
            show((seed - options.seed) * options.budget + runs, f"{options.goal}, seed {seed}: {best.value:.4g}")
            return not interruption.requested

        found = list[Found]()
        for each in searched(trials, options.free, options.budget, seeds, go_on, folder):
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
    text = fragment(card.gait, title, card.choice.changes)
    write_bytes(folder / "gait.toml", text.encode())
    _film(scene, overrides, card, folder)
    blocks, picture = list(card.blocks(rows, seconds)), draw(card)
    return Report(
        said=[block for block in blocks if not isinstance(block, Heading) or block.level > 1],
        pages={"card.md": blocks},
        files={"card.html": html(markdown(blocks), picture).encode(), "gait.toml": text.encode()},
        pictures={"gait.png": picture},
    )


def _film(scene: str, overrides: Sequence[str], card: Card, folder: Path) -> None:
    """Run the gait in its scene, and write the results to the folder `best`."""
    duration = SURE_WAVES * card.gait.period
    gait = f"gait={toml_value(str((folder / 'gait.toml').resolve()))}"
    loaded = load_scene(scene, (*overrides, *card.choice.changes, gait, f"run.duration_s={duration!r}"))
    run_scene(loaded, folder / "best", force=True, quiet=True)


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
