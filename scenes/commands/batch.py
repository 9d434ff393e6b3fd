"""The commands of `worm3d` that run a scene many times or compare runs.

Imports that take long are inside the functions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
    path_of,
)
from scenes.language.errors import SceneError

batch = typer.Typer(rich_markup_mode=None)
"""Commands that `scenes.commands.app` adds to the program in addition to its own commands."""

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
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Run on the workers of a Dask scheduler, tcp://...")
]
Bind = Annotated[
    str,
    typer.Option(
        "--bind", metavar="ADDRESS", help="Address of the scheduler that --workers starts; others may reach it."
    ),
]


@batch.command()
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
    force: ForceAll = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run a scene many times with varied keys.

    Several --vary make a grid. Each case is stored in a file. If the sweep is started again with the same --out, only
    missing cases are run. Writes sweep.csv, sweep.nc, summary.json and figures. Each case has a different seed; vary
    seed for other seeds, or fix seed with -o to give all cases the same noise. The exit code is 5 if cases failed.
    """
    from scenes.sweep.command import Options, run

    options = Options(
        vary or (), random, listed, results, retry_failed, workers, scheduler, bind, case_limit_s, force, quiet
    )
    raise typer.Exit(run(scene, o or (), out, options))


@batch.command()
def optimise(
    scene: SceneArgument,
    goal: Annotated[
        str,
        typer.Option("--goal", metavar="NAME", help="robust, speed, cost, turn, climb, or module:NAME."),
    ] = "robust",
    limit: Annotated[
        list[str] | None,
        typer.Option("--limit", metavar="MEASURE<=VALUE", help="Bound of a measure, also >=; repeatable."),
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            metavar="KEY=LO:HI[:each]",
            help="Key of the scene to search as well; ':each' gives each segment a value; repeatable.",
        ),
    ] = None,
    free: Annotated[
        str,
        typer.Option("--free", metavar="WHAT", help="segments: each segment has its own shape; waves: all are alike."),
    ] = "segments",
    budget: Annotated[int, typer.Option("--budget", min=14, help="Largest number of runs of each search.")] = 1500,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first search.")] = 0,
    searches: Annotated[int, typer.Option("--searches", min=1, help="Number of searches; the best search counts.")] = 2,
    front: Annotated[
        str | None,
        typer.Option("--front", metavar="V1,V2,...", help="Minimum speeds [BL/s]; one search for each."),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    o: Overrides = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Search for the best gait of the worm in a scene.

    Writes gait.toml, a card (card.md, card.html) with the gain and the values under other conditions, and the folder
    best with a run and a film. Amplitude and period are taken from the scene. If the command is stopped, the
    same command with the same --out goes on. With --front, the options --free, --searches, --workers and --scheduler
    have no effect, and front.png, front.md and the gaits are written instead.
    """
    if front is not None:
        from scenes.studies.optimise.front import run

        if (free, searches, workers, scheduler) != ("segments", 2, None, None):
            raise SceneError("--front: got --free, --searches, --workers or --scheduler too, must be without them")
        given = goal, limit or (), over or (), front, budget, seed
        raise typer.Exit(run(scene, o or (), out, *given, force=force, quiet=quiet))

    from scenes.studies.optimise import command

    options = command.Options(
        goal, limit or (), over or (), free, budget, seed, searches, workers, scheduler, force, quiet
    )
    raise typer.Exit(command.run(scene, o or (), out, options))


@batch.command()
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
    """Compare runs and measurements.

    Prints the settings, figures and series that differ, and writes compare.csv (all differences), figures that show the
    results together, and compare.html, which plays the runs side by side.
    """
    from scenes.studies.compare import command

    raise typer.Exit(command.run(results, out, align=align, force=force, quiet=quiet))


@batch.command()
def fit(
    scene: SceneArgument,
    to: Annotated[Path, file_option("--to", help="Measurement: a CSV file, see .docs/guides/compare.md.")],
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

    Each key starts from the value in the scene, or from -o. Writes fit.json (values, 95 % intervals, and keys that the
    data cannot separate), fit.toml (the scene with the fitted values) and fit.png (the residuals).
    """
    from scenes.studies.fit import command

    raise typer.Exit(command.run(scene, to, vary, o or (), out, runs=runs, force=force, quiet=quiet))


@batch.command()
def learn(
    scene: SceneArgument,
    to: Annotated[Path, file_option("--to", help="Policy to write, ending in .npz.")],
    minutes: Annotated[float, typer.Option("--minutes", help="Minutes of training with the scene.")] = 10.0,
    practice: Annotated[float, typer.Option("--practice", help="Minutes of training in a reduced model before.")] = 0.0,
    acts: Annotated[str, typer.Option("--acts", help="Meaning of the actions: course or wave.")] = "course",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = 0,
    vary: Vary = None,
    o: Overrides = None,
    worms: Annotated[int, typer.Option("--worms", min=1, help="Number of worms that are trained at once.")] = 16,
    threads: Annotated[int, typer.Option("--threads", min=1, help="Number of threads that simulate the worms.")] = 1,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Train a controller by reinforcement learning (PPO).

    SCENE can also be an environment by name, such as worm3d/Slope-v0. Trains on many worms at once. Each episode has
    the duration of the scene, and random values of the keys in --vary. Prints the mean reward during the training.
    Needs the optional part 'learn'; the trained policy needs only numpy (see .docs/guides/learn.md for use). Ctrl-C
    ends the training early, and keeps the trained policy.
    """
    from scenes.studies.learn.command import run
    from scenes.studies.learn.task import Task
    from scenes.sweep.vary import texts

    task = Task(scene, minutes, practice, seed, o or (), texts(vary or ()), worms, threads, acts)
    raise typer.Exit(run(task, to, force=force, quiet=quiet))


@batch.command()
def fem(
    segment: Annotated[
        str, typer.Argument(metavar="SEGMENT", help="TOML file that describes a segment, or a shipped one: barrel.")
    ],
    out: Annotated[Path, file_option("--out", help="Table to write, NetCDF; pictures are written beside the table.")],
    states: Annotated[int, typer.Option("--states", min=4, max=100_000, help="Number of stable states.")] = 100,
    mesh: Annotated[
        str,
        typer.Option("--mesh", metavar="ALONGxACROSS", help="Elements of half of the segment, and through the wall."),
    ] = "20x2",
    bending: Annotated[
        int, typer.Option("--bending", min=0, max=100_000, help="Number of states with bent plates, by a 3D model.")
    ] = 0,
    patch: Annotated[
        int, typer.Option("--patch", min=0, max=1000, help="Number of states that ground presses, for the contact.")
    ] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Few states on a coarse mesh, for a first look.")] = False,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compute a table of a soft segment by finite elements.

    The segment is described by profile, wall, rubber, fibres and load. Each row of the table is an equilibrium at a
    length and a pressure (or tension of a cable): force, radius, enclosed volume, and whether the state is stable. The
    error of the mesh is found on a second mesh. 100 states take about half a minute, and bent states a second each.
    A pressed state takes 15 seconds, and gives the stiffness of the contact with flat ground.
    Needs scikit-fem: pip install 'worm3d[fem]'.
    """
    from scenes.studies.fem.command import Options, mesh_of, run

    raise typer.Exit(run(segment, out, Options(states, mesh_of(mesh), bending, patch, quick, force, quiet)))


@batch.command()
def law(
    table: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE", parser=path_of, help="States of a segment: NetCDF of 'worm3d fem', or CSV of a test bench."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="LAW.json", parser=path_of, help="File of the law.")],
    column: Annotated[
        list[str] | None,
        typer.Option("--column", metavar="NAME=TITLE", help="Title of a column, as length_mm=Position; repeatable."),
    ] = None,
    o: Annotated[
        list[str] | None,
        typer.Option("-o", metavar="FACT=NUMBER", help="Fact about the segment, as rest_length_m=0.06; repeatable."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = 0,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit a segment law to finite elements or to bench data.

    Columns: length_m, force_N (positive if it pulls), pressure_Pa or cable_N, radius_m, volume_m3, bend_rad,
    moment_Nm, and stable (0 for crumpled shapes). A hoop cable that is taken in and let out has cable_mm and force_N.
    Facts: rest_length_m, rest_radius_m, plate_radius_m, chamber_offset_m, cable_per_diameter. Writes the law, an
    energy whose derivatives are force and volume, with its errors on held-out states, and a figure (PNG). A record of
    cycles also gives the friction of the joints. Takes about 20 s.
    """
    from scenes.studies.law import command

    raise typer.Exit(command.run(table, out, column or (), o or (), seed=seed, force=force, quiet=quiet))
