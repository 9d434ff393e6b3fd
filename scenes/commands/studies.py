"""The commands of `worm3d study`.

Some studies are scenes with a section [sweep]; one command, `swept`, runs all of these. The other studies are separate
programs, with one command each.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from scenes.commands.arguments import (
    CaseLimit,
    Force,
    ForceAll,
    NoCode,
    Out,
    Overrides,
    Quiet,
    RetryFailed,
    SceneArgument,
    Workers,
    file_option,
)
from scenes.language.errors import SceneError

SWEPT = "swept"
"""Name of the hidden command that runs a study that is a sweep. Such a study is a scene, without a command of its own.
"""


class _Studies(TyperGroup):
    """Group of commands that calls the command `SWEPT` if the first argument is not the name of a command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        named = args and args[0] in {*self.commands, *self.get_help_option_names(ctx)}
        parsed: list[str] = super().parse_args(ctx, args if named else [SWEPT, *args])
        return parsed

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        return "" if name == SWEPT else name, command, rest  # the help shows `worm3d study [NAME]`


study = typer.Typer(cls=_Studies, rich_markup_mode=None)


@study.callback(
    epilog="Studies that are sweeps: 'worm3d study' lists them, 'worm3d study friction --help' shows their options, "
    "'worm3d study --all' runs all of them."
)
def _studies() -> None:
    """Run a study, or list the studies if no name is given.

    A study is either a sweep with a table, a figure and conclusions for a designer, or one of the programs below.
    """


@study.command(SWEPT, hidden=True)
def swept(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", help="A study, or a scene with a section [sweep]. Default: list the studies and do nothing."
        ),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Run all studies that are sweeps, and write one report of their conclusions.")
    ] = False,
    o: Overrides = None,
    workers: Workers = None,
    case_limit_s: CaseLimit = None,
    retry_failed: RetryFailed = False,
    out: Out = None,
    force: ForceAll = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run a study: a sweep with a table, a figure and conclusions for a designer.

    Without a name, the command lists the studies. The name of a scene with a section [sweep] is also valid; the section
    [study] of this scene defines the conclusions. The study writes the same files as 'worm3d sweep', and study.md,
    study.csv and study.png. Each number is reported with its estimated error: each case runs with run.accuracy=0.01,
    unless the scene or -o sets another value.
    """
    from scenes.studies.study import command
    from scenes.sweep.command import Options

    options = Options(workers=workers, case_limit_s=case_limit_s, retry_failed=retry_failed, force=force, quiet=quiet)
    if every:
        if name is not None or o:
            raise SceneError("study: --all runs all studies without changes; leave out the name and -o")
        raise typer.Exit(command.run_all(out, options))
    assert context.parent is not None
    programs = {key: each for key, each in context.parent.command.commands.items() if not each.hidden}  # type: ignore[attr-defined]
    if name in programs:
        raise SceneError(f"study: got options before the name {name}, must be after the name: worm3d study {name} ...")
    if name is not None:
        raise typer.Exit(command.run(name, o or (), out, options))
    command.list_studies()
    for other, program in programs.items():
        typer.echo(f"{other}  {program.get_short_help_str(150)}")


@study.command()
def paper(out: Out = None, force: Force = False, quiet: Quiet = False) -> None:
    """Reproduce the tables and figures of the paper.

    The report judges each claim of the paper, and lists the differences between the paper's text and its program.
    """
    from scenes.studies.paper import report

    raise typer.Exit(report.run(out, force, quiet))


@study.command()
def validate(
    out: Out = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Do not vary the values that the publications leave open.")
    ] = False,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compare the models with published numbers.

    The published numbers are closed forms, and measurements on robots and animals. There is a scene for each. The
    report contains the model's value, the published value and their ratio, and says whether trends have the correct
    sign. The command does not fail if values differ.
    """
    from scenes.studies.validate import report

    raise typer.Exit(report.run(out, quick=quick, force=force, quiet=quiet))


@study.command()
def technologies(
    scene: SceneArgument,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="NAME", help="Use only this technology; repeatable.")
    ] = None,
    o: Overrides = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run the worm of a scene, with its gait, with each actuator technology.

    Reports the speed, the cost of transport, the energy drawn, the best period, and what limits each technology (speed,
    force, stroke or heat). To find the limit, the command removes one limit after the other. Writes technologies.csv,
    technologies.md (with the sources of the numbers) and technologies.png. Takes about half a minute. Keys of the
    scene's section [actuator] apply to all technologies.
    """
    from scenes.studies.technologies import report

    raise typer.Exit(report.run(scene, o or (), only or (), out, force=force, quiet=quiet))


@study.command()
def identify(
    scene: SceneArgument,
    o: Overrides = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Measure how the worm of a scene crawls and turns.

    Runs short simulations on level ground with various amplitudes, frequencies and values of the steering, by hinges
    and by unequal contraction of the left and right chambers. The result is a map from these parameters to the motion,
    which is stored for the controllers. Also writes the error of the map and a figure. Takes a minute or two.
    """
    from scenes.models.loading import load_scene
    from scenes.studies.identify import command

    raise typer.Exit(command.run(load_scene(scene, o or ()), out, force=force, quiet=quiet))


@study.command()
def control(
    out: Out = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the random trials.")] = 0,
    seeds: Annotated[int, typer.Option("--seeds", help="Number of seeds: --seed and the following numbers.")] = 1,
    count: Annotated[int, typer.Option("--trials", help="Number of random trials per seed.")] = 30,
    trials: Annotated[
        list[str] | None,
        typer.Option("--trial", help="Run only this trial (number or name) or class of trials; repeatable."),
    ] = None,
    controllers: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            help="Your own controller, as module:Class, in addition to the built-in controllers; repeatable.",
        ),
    ] = None,
    o: Overrides = None,
    workers: Annotated[int, typer.Option("--workers", help="Number of processes that share the runs.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Run only two short trials.")] = False,
    show: Annotated[
        bool, typer.Option("--show", help="Print the command that runs each trial, and do not run the trials.")
    ] = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Compare the controllers on random trials.

    Each trial has a random task, worm, ground and sensor, which depend only on the seed. Model predictive control, the
    baseline controllers and your own controllers all run the same trials. The score depends on the distance of the worm
    from the desired position (rules: .docs/evidence/controllers.md). The report has one line per controller. If the
    command is started again with the same --out, it runs only the missing trials, and the trials whose program, scene
    or map of the worm has changed. The exit code is 5 if a trial was lost.
    """
    from scenes.studies.bench import control_report as report

    options = report.Options(seed, seeds, count, trials or (), controllers or (), o or (), quick, workers)
    raise typer.Exit(report.show(options) if show else report.run(out, options, quiet=quiet))


@study.command()
def gait(
    to: Annotated[
        Path, file_option("--to", help="CSV file with recordings of waves (format: .docs/guides/studies.md).")
    ],
    use: Annotated[
        list[str] | None,
        typer.Option(
            "--use",
            metavar="NAME",
            help="Recording to fit; repeatable. The other recordings are predicted. Default: fit all recordings.",
        ),
    ] = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit a chain of neurons to the waves of recorded animals.

    Finds the waves in the recordings, and the delays of each wave from one band of the body to the next. Fits a chain
    of neurons (gait 'ei_chain') that has these delays and is insensitive to noise in its constants. Writes gait.toml (a
    scene with the chain), gait.csv and gait.json (the delays of the chain, of the recordings and of a uniform wave),
    and gait.png. Takes a minute or two.
    """
    from scenes.studies.gait_fit import command

    raise typer.Exit(command.run(to, use or (), out, force=force, quiet=quiet))
