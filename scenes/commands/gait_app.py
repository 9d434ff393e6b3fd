"""The commands of `worm3d gait`; all heavy imports are inside of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenes.commands.arguments import Force, Out, Quiet, path_of

gait = typer.Typer(help="Train gaits on animals.", no_args_is_help=True, rich_markup_mode=None)


@gait.callback()
def _group() -> None:
    """Keep the name of a command necessary while there is one only."""


@gait.command(name="fit")
def gait_fit(
    to: Annotated[
        Path,
        typer.Option("--to", metavar="FILE", parser=path_of, help="Recordings of waves: a CSV file, scenes/README.md."),
    ],
    use: Annotated[
        list[str] | None,
        typer.Option("--use", metavar="NAME", help="Recording to fit, repeatable; the others are predicted. Else all."),
    ] = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit a chain of neurons to the waves of recorded animals.

    Finds the waves in a recording and their delays from band to band, and a chain, gait 'ei_chain', with these delays
    that noise in its constants disturbs little. Writes gait.toml, a scene of it, gait.csv and gait.json, its delays
    beside those of the recordings and of a uniform wave, and gait.png. Takes a minute or two.
    """
    from scenes.studies.gait_fit import command

    raise typer.Exit(command.run(to, use or (), out, force=force, quiet=quiet))
