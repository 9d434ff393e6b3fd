"""`worm3d learn`: train a policy in a scene and write it to a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from scenes.language.errors import SceneError
from scenes.records.folder import made, require_free, written_whole
from scenes.sweep.vary import texts

if TYPE_CHECKING:
    from scenes.studies.learn.training import Point


@dataclass(frozen=True)
class Options:
    """Options of the command."""

    minutes: float
    practice: float
    acts: str
    seed: int
    worms: int
    threads: int
    force: bool
    quiet: bool


def run(scene: str, to: Path, vary: Sequence[str], overrides: Sequence[str], options: Options) -> int:
    """Train a policy, write the policy, and return the exit code; parameters as in the command.

    Raises
    ------
    SceneError
        The scene is wrong, a key cannot be varied, the file exists, or an option is out of range.
    MissingPartError
        Stable-Baselines3 is not installed.
    """
    if to.suffix != ".npz":
        raise SceneError(f"--to: got '{to}', must be a file ending in .npz")
    require_free([to], Path(scene), force=options.force)
    from scenes.studies.learn import training

    try:
        task = training.Task(
            scene=scene,
            minutes=options.minutes,
            practice=options.practice,
            seed=options.seed,
            overrides=tuple(overrides),
            vary=texts(vary),
            worms=options.worms,
            threads=options.threads,
            acts=options.acts,
        )
        made(to.parent)
        policy = training.train(task, lambda point: _tell(point, quiet=options.quiet))
    except ValueError as error:
        raise SceneError(str(error)) from error
    with written_whole(to) as part:
        policy.save(part)
    if not options.quiet:
        steps, seconds = (sum(stage[what] for stage in policy.about["stages"]) for what in ("steps", "wall_s"))
        typer.echo(f"{to}: trained for {steps} control periods in {seconds:.0f} s")
    return 0


def _tell(point: Point, *, quiet: bool) -> bool:
    """Print the state of the training; return True so that the training continues."""
    if not quiet:
        typer.echo(f"{point.seconds:7.0f} s {point.steps:9d} periods  reward {point.reward:7.3f}")
    return True
