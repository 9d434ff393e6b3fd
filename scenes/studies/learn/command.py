"""`worm3d learn`: train a policy in a scene and write it to a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from scenes.language.errors import SceneError
from scenes.records.folder import made, require_free, written_whole
from scenes.studies.learn.task import Task

if TYPE_CHECKING:
    from scenes.studies.learn.training import Point


def run(task: Task, to: Path, *, force: bool, quiet: bool) -> int:
    """Train a policy, write it to the file `to`, and return the exit code.

    Raises
    ------
    SceneError
        The scene is wrong, a key cannot be varied, the file exists, or an option is out of range.
    MissingPartError
        Stable-Baselines3 is not installed.
    """
    if to.suffix != ".npz":
        raise SceneError(f"--to: got '{to}', must be a file ending in .npz")
    require_free([to], Path(task.scene), force=force)
    from scenes.studies.learn import training

    try:
        made(to.parent)
        policy = training.train(task, lambda point: _tell(point, quiet=quiet))
    except ValueError as error:
        raise SceneError(str(error)) from error
    with written_whole(to) as part:
        policy.save(part)
    if not quiet:
        steps, seconds = (sum(stage[what] for stage in policy.about["stages"]) for what in ("steps", "wall_s"))
        typer.echo(f"{to}: trained for {steps} control periods in {seconds:.0f} s")
    return 0


def _tell(point: Point, *, quiet: bool) -> None:
    """Print the state of the training."""
    if not quiet:
        typer.echo(f"{point.seconds:7.0f} s {point.steps:9d} periods  reward {point.reward:7.3f}")
