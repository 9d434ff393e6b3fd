"""The commands of `worm3d` that run a scene many times, or compare runs; all heavy imports are inside of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenes.commands.arguments import Force, NoCode, Out, Overrides, Quiet, SceneArgument, file_option
from scenes.language.errors import SceneError

studies = typer.Typer(rich_markup_mode=None)
"""Commands that stand beside `run` and the others."""
gait = typer.Typer(help="Train gaits on animals.", no_args_is_help=True, rich_markup_mode=None)

Vary = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        metavar="KEY=VALUES",
        help="A key and its values, v1,v2,... or lo:hi:n[:log]; with --random also lo:hi[:log]. Repeatable.",
    ),
]
Random = Annotated[int | None, typer.Option("--random", metavar="N", help="Draw N cases from the keys given as lo:hi.")]
Listed = Annotated[Path | None, file_option("--list", help="CSV: a row of keys, then a row of values per case.")]
Results = Annotated[bool, typer.Option("--results", help="Keep the whole record of each case, as 'worm3d run' does.")]
RetryFailed = Annotated[bool, typer.Option("--retry-failed", help="Run cases again that failed before.")]
Workers = Annotated[int | None, typer.Option("--workers", metavar="N", help="Run on N processes of this machine.")]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Run on the workers of a Dask scheduler, tcp://...")
]
Bind = Annotated[
    str,
    typer.Option("--bind", metavar="ADDRESS", help="Where the scheduler of --workers listens; others may reach it."),
]
CaseLimit = Annotated[
    float | None,
    typer.Option(
        "--case-limit-s",
        metavar="SECONDS",
        help="Longest time of a case, which fails if it takes longer (left out: 3600, or as [sweep] says).",
    ),
]
Anew = Annotated[bool, typer.Option("--force", help="Run all cases anew, and write to a folder with other files.")]


@studies.command()
def sweep(
    scene: SceneArgument,
    vary: Vary = None,
    random: Random = None,
    listed: Listed = None,
    o: Overrides = None,
    results: Results = False,
    retry_failed: RetryFailed = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    bind: Bind = "127.0.0.1",
    case_limit_s: CaseLimit = None,
    out: Out = None,
    force: Anew = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run a scene many times, some of its keys varied.

    Several --vary make a grid. Each case is a file: started again on the same --out, only what is missing runs. Writes
    sweep.csv, sweep.nc, summary.json and figures. Each case has a seed of its own; vary seed, or fix it with -o, to
    have others: fixed, all cases have the same noise. Ends with 5 if cases failed.
    """
    from scenes.sweep.command import Options, run

    options = Options(
        vary or (), random, listed, results, retry_failed, workers, scheduler, bind, case_limit_s, force, quiet
    )
    raise typer.Exit(run(scene, o or (), out, options))


@studies.command()
def study(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="A study, or a scene with a section [sweep]; without: a list."),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Run all studies, and write one report of what they tell.")
    ] = False,
    o: Overrides = None,
    workers: Workers = None,
    case_limit_s: CaseLimit = None,
    retry_failed: RetryFailed = False,
    out: Out = None,
    force: Anew = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run a study: a sweep, its table and figure, and what a designer learns from it in sentences.

    Without a name the studies are listed. A scene with a section [sweep] is run too; [study] says what it is to tell.
    Beside what 'worm3d sweep' writes there are study.md, study.csv and study.png. Each number has an error: a case runs
    with run.accuracy=0.01 unless the scene or -o says otherwise.
    """
    from scenes.studies.study import command
    from scenes.sweep.command import Options

    options = Options(workers=workers, case_limit_s=case_limit_s, retry_failed=retry_failed, force=force, quiet=quiet)
    if every:
        if name is not None or o:
            raise SceneError("study: --all runs the studies as they are; leave out the name and -o")
        raise typer.Exit(command.run_all(out, options))
    if name is not None:
        raise typer.Exit(command.run(name, o or (), out, options))
    command.list_studies()


@studies.command()
def compare(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="A B ...",
            help="Folders of runs, result.nc, cases of a sweep, measurements (CSV); the first one is the reference.",
        ),
    ],
    align: Annotated[
        bool, typer.Option("--align", help="Move and turn the others so that their positions fit the reference best.")
    ] = False,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Say in what runs and measurements differ.

    Prints the settings, figures and series that differ, and writes all of them (compare.csv), figures with the results
    laid over one another, and compare.html, which plays the runs side by side.
    """
    from scenes.studies.compare import command

    raise typer.Exit(command.run(results, out, align=align, force=force, quiet=quiet))


@studies.command()
def validate(
    out: Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Leave out the spreads over what is not published.")] = False,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compare the models with published numbers.

    Closed forms, and what was measured on robots and animals, a scene each: what the model gives, what was published,
    the ratio, and whether trends have the right sign. What the model misses is said, and is no failure of the command.
    """
    from scenes.studies.validate import report

    raise typer.Exit(report.run(out, quick=quick, force=force, quiet=quiet))


@studies.command()
def fit(
    scene: SceneArgument,
    to: Annotated[Path, file_option("--to", help="Measurement: a CSV file, see scenes/STUDIES.md.")],
    vary: Annotated[
        list[str],
        typer.Option("--vary", metavar="KEY[=LO:HI]", help="Key to fit, e.g. friction.forward=0.01:0.3; repeatable."),
    ],
    o: Overrides = None,
    runs: Annotated[int, typer.Option("--runs", min=10, help="Largest number of runs.")] = 1000,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Fit keys of a scene to a measurement by least squares.

    Each starts from the value that the scene, or -o, gives it. Writes fit.json (values, their 95 % intervals, keys
    that the data cannot tell apart), fit.toml, the scene with these values, and fit.png, the residuals.
    """
    from scenes.studies.fit import command

    raise typer.Exit(command.run(scene, to, vary, o or (), out, runs=runs, force=force, quiet=quiet))


@studies.command()
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

    Speed, cost of transport, energy drawn, the best period, and what limits each (speed, force, stroke, heat), found by
    taking one limit after the other away. Writes technologies.csv, technologies.md, also with the sources of the
    numbers, and technologies.png. Takes half a minute. Keys of the section [actuator] hold for all of them.
    """
    from scenes.studies.technologies import command

    raise typer.Exit(command.run(scene, o or (), only or (), out, force=force, quiet=quiet))


@studies.command()
def learn(
    scene: SceneArgument,
    to: Annotated[Path, file_option("--to", help="Policy to write, ending in .npz.")],
    minutes: Annotated[float, typer.Option("--minutes", help="Time to train.")] = 10.0,
    practice: Annotated[float, typer.Option("--practice", help="Minutes in a reduced model before.")] = 0.0,
    acts: Annotated[str, typer.Option("--acts", help="What actions mean: course or wave.")] = "course",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of what is drawn.")] = 0,
    vary: Vary = None,
    o: Overrides = None,
    worms: Annotated[int, typer.Option("--worms", min=1, help="Worms at once.")] = 16,
    threads: Annotated[int, typer.Option("--threads", min=1, help="Worms that crawl at the same time.")] = 1,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Train a controller by reinforcement (PPO), on many worms at once.

    For each episode, of the scene's duration, the keys given by --vary are drawn anew. Prints the mean reward as it
    goes. Needs the optional part 'learn'; the policy that is written needs numpy only (control/README.md says how to
    use it). Ctrl-C ends the training early, and keeps what was learned.
    """
    from scenes.studies.learn.command import Options, run

    raise typer.Exit(
        run(scene, to, vary or (), o or (), Options(minutes, practice, acts, seed, worms, threads, force, quiet))
    )


@gait.callback()
def _group() -> None:
    """Keep the name of a command necessary while there is one only."""


@gait.command(name="fit")
def gait_fit(
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

    Finds the waves in a recording and their delays from band to band, and a chain, gait 'ei_chain', with these delays
    that noise in its constants disturbs little. Writes gait.toml, a scene of it, gait.csv and gait.json, its delays
    beside those of the recordings and of a uniform wave, and gait.png. Takes a minute or two.
    """
    from scenes.studies.gait_fit import command

    raise typer.Exit(command.run(to, use or (), out, force=force, quiet=quiet))
