"""The commands of `worm3d study`. Some studies are sweeps, others are programs of their own."""

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
"""Name of the hidden command that runs the studies that are sweeps. These studies are scenes, not commands."""


class _Studies(TyperGroup):
    """Command group that passes names for which there is no command to the command `SWEPT`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        named = args and args[0] in {*self.commands, *self.get_help_option_names(ctx)}
        parsed: list[str] = super().parse_args(ctx, args if named else [SWEPT, *args])
        return parsed

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        return "" if name == SWEPT else name, command, rest  # the help shows `worm3d study [NAME]`


study = typer.Typer(cls=_Studies, rich_markup_mode=None)


@study.callback(
    epilog="Studies that are sweeps: 'worm3d study' names them, 'worm3d study friction --help' has their options, "
    "'worm3d study --all' runs them all."
)
def _studies() -> None:
    """Run a study; without a name, list the studies.

    A study is a sweep with a table, a figure and conclusions for a designer, or one of the programs below.
    """


@study.command(SWEPT, hidden=True)
def swept(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="A study, or a scene with a section [sweep]; without: a list."),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Run all studies, and write one report of what they tell.")
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

    Without a name, the studies are listed. A scene with a section [sweep] can also be run; its section [study] defines
    the conclusions. In addition to the files of 'worm3d sweep', the study writes study.md, study.csv and study.png.
    Each number has an error estimate. Cases run with run.accuracy=0.01, unless the scene or -o sets another value.
    """
    from scenes.studies.study import command
    from scenes.sweep.command import Options

    options = Options(workers=workers, case_limit_s=case_limit_s, retry_failed=retry_failed, force=force, quiet=quiet)
    if every:
        if name is not None or o:
            raise SceneError("study: --all runs the studies as they are; leave out the name and -o")
        raise typer.Exit(command.run_all(out, options))
    assert context.parent is not None
    programs = {key: each for key, each in context.parent.command.commands.items() if not each.hidden}  # type: ignore[attr-defined]
    if name in programs:
        raise SceneError(f"study: options of {name} come after the name: worm3d study {name} ...")
    if name is not None:
        raise typer.Exit(command.run(name, o or (), out, options))
    command.list_studies()
    for other, program in programs.items():
        typer.echo(f"{other}  {program.get_short_help_str(150)}")


@study.command()
def paper(out: Out = None, force: Force = False, quiet: Quiet = False) -> None:
    """Reproduce the paper's tables and figures.

    Includes a verdict on each claim of the paper, and the differences between the text and the program of the paper.
    """
    from scenes.studies.paper import report

    raise typer.Exit(report.run(out, force, quiet))


@study.command()
def validate(
    out: Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Leave out the spreads over what is not published.")] = False,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compare the models with published numbers.

    Closed forms, and measurements on robots and animals, with a scene for each: the model's value, the published value,
    the ratio, and whether trends have the right sign. Differences are reported, and do not make the command fail.
    """
    from scenes.studies.validate import report

    raise typer.Exit(report.run(out, quick=quick, force=force, quiet=quiet))


@study.command()
def technologies(
    scene: SceneArgument,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="NAME", help="One of the technologies; repeatable.")
    ] = None,
    o: Overrides = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run the worm of a scene, with its gait, on each actuator technology.

    Reports speed, cost of transport, energy drawn, the best period, and the limit of each technology (speed, force,
    stroke, heat), found by removing one limit after the other. Writes technologies.csv, technologies.md (with the
    sources of the numbers) and technologies.png. Takes half a minute. Keys of the section [actuator] apply to all
    technologies.
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

    Runs short simulations on level ground, over amplitude, frequency and steering by hinges and by unequal chambers.
    Stores the map for the controllers, with the error of the map and a figure. Takes a minute or two.
    """
    from scenes.models.loading import load_scene
    from scenes.studies.identify import command

    raise typer.Exit(command.run(load_scene(scene, o or ()), out, force=force, quiet=quiet))


@study.command()
def control(
    out: Out = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed from which trials are drawn.")] = 0,
    seeds: Annotated[int, typer.Option("--seeds", help="Number of such seeds, from --seed on.")] = 1,
    count: Annotated[int, typer.Option("--trials", help="Number of trials that are drawn from each seed.")] = 30,
    trials: Annotated[
        list[str] | None,
        typer.Option("--trial", help="Only this trial, by its number or name, or this class of trials; several."),
    ] = None,
    controllers: Annotated[
        list[str] | None,
        typer.Option("--controller", help="A controller of yours beside those that ship, module:Class; several."),
    ] = None,
    o: Overrides = None,
    workers: Annotated[int, typer.Option("--workers", help="Processes that share the runs.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Two short trials only.")] = False,
    show: Annotated[bool, typer.Option("--show", help="Print the trials, as commands that run them, and end.")] = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Compare the controllers on random trials.

    Tasks, worms, grounds and sensors are drawn from a seed. Model predictive control, the baselines and your own
    controllers all run the same trials. The score depends on the distance of the worm from the desired position; each
    controller gets one line (rules: scenes/studies/bench/CONTROL.md). Started again with the same --out, the command
    runs only the trials that are missing for these programs, scenes and map of the worm. The exit code is 5 if a trial
    was lost.
    """
    from scenes.studies.bench import control_report as report

    options = report.Options(seed, seeds, count, trials or (), controllers or (), o or (), quick, workers)
    raise typer.Exit(report.show(options) if show else report.run(out, options, quiet=quiet))


@study.command()
def gait(
    to: Annotated[Path, file_option("--to", help="Recordings of waves: a CSV file, scenes/README.md.")],
    use: Annotated[
        list[str] | None,
        typer.Option("--use", metavar="NAME", help="Recording to fit, repeatable; the others are predicted. Else all."),
    ] = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit a chain of neurons to the waves of recorded animals.

    Finds the waves in a recording and their delays from band to band. Fits a chain (gait 'ei_chain') with these delays,
    on which noise in the constants has little effect. Writes gait.toml (a scene with the chain), gait.csv and gait.json
    (the delays of the chain, of the recordings and of a uniform wave), and gait.png. Takes a minute or two.
    """
    from scenes.studies.gait_fit import command

    raise typer.Exit(command.run(to, use or (), out, force=force, quiet=quiet))
