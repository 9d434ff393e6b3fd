"""The commands of `worm3d`. Imports that take long are inside the commands that need them."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from scenes.commands import studies
from scenes.commands.arguments import (
    Force,
    NoCode,
    Out,
    Overrides,
    Quiet,
    ResultArgument,
    SceneArgument,
    file_option,
    path_of,
)
from scenes.commands.batch import batch
from scenes.commands.robots import robots
from scenes.language.errors import SceneError

if TYPE_CHECKING:
    from scenes.records.record import Record

Fps = Annotated[int | None, typer.Option(min=1, max=50, help="Frames per second of the film; 20 if left out.")]

SECTIONS = {
    "Scenes": ("run", "play", "check", "list", "init"),
    "Results": ("plot", "view", "export", "compare"),
    "Many runs": ("sweep", "study", "fit", "optimise", "learn"),
    "Robots and segments": ("bridge", "robot", "fem", "law"),
}
"""Groups of commands in the help, by title."""


class _Grouped(TyperGroup):
    """Command group that lists the commands by section."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, names in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name, self.commands[name].get_short_help_str(62)) for name in names])


app = typer.Typer(
    name="worm3d",
    cls=_Grouped,
    help="Simulate and control worm-inspired robots: start with 'worm3d run flat'.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(batch)
app.add_typer(robots)
app.add_typer(studies.study, name="study")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"worm3d {metadata.version('worm3d')}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the program itself."""


@app.command()
def run(
    context: typer.Context,
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help="A name of 'worm3d list', or a TOML file.")
    ] = None,
    o: Overrides = None,
    accuracy: Annotated[
        float | None, typer.Option(help="Largest relative error of the distance; sets the key run.accuracy.")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="RESULT", parser=path_of, help="Go on with a run, instead of a SCENE."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration", metavar="SECONDS_MORE", help="With --resume: time to add. Default: up to the planned end."
        ),
    ] = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Run a scene, or continue a run.

    Writes result.nc, summary.json, overview.png and viewer.html, a page that plays the run in any browser. For planar
    worms, writes an animation of the first 30 s instead of the page. After Ctrl-C, the computed part is written. A
    scene with a section [sweep] is run in the same way as by 'worm3d sweep'. With --resume, the whole run including the
    first part is written into a new folder, as if the run had not been stopped.
    """
    if resume is not None:
        if scene is not None or o or accuracy is not None:
            raise SceneError("run: --resume continues a run without changes; leave out SCENE, -o and --accuracy")
        go_on(resume, duration, out, force, quiet)
    if scene is None:
        context.fail("Nothing to run: name a SCENE of 'worm3d list' or a TOML file, or give --resume RESULT.")
    if duration is not None:
        raise SceneError(f"run: --duration is a key of the scene, run.duration_s: -o run.duration_s={duration:g}")
    from scenes.models.loading import load_scene
    from scenes.running.runner import run_scene

    changes = [*(o or ()), *([] if accuracy is None else [f"run.accuracy={accuracy!r}"])]
    loaded = load_scene(scene, changes)
    if loaded.sweep:
        from scenes.sweep import command

        raise typer.Exit(command.run(scene, changes, out, command.Options(force=force, quiet=quiet)))
    raise typer.Exit(run_scene(loaded, out, force=force, quiet=quiet))


@app.command(name="resume", hidden=True)
def go_on(
    result: ResultArgument,
    duration: Annotated[float | None, typer.Option(metavar="SECONDS_MORE")] = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Continue a run, in the same way as 'worm3d run --resume RESULT'."""
    from scenes.records.store import load
    from scenes.running.runner import lengthened, run_scene

    earlier = load(result)
    raise typer.Exit(run_scene(lengthened(earlier, duration), out, force=force, quiet=quiet, earlier=earlier))


@app.command()
def play(
    scene: SceneArgument,
    o: Overrides = None,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1000.0, help="Speed at the start, as simulated time over real time.")
    ] = 1.0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Only print the address of the page.")] = False,
    no_code: NoCode = False,
) -> None:
    """Play with a scene in a browser during the run.

    Sliders change the gait, the requested speed, friction, slope and mass. Arrow keys steer. Drag the worm with the
    ctrl key to pull the worm. 'save' writes a scene with the present values, and 'record' a folder of results.
    """
    from scenes.models.loading import load_scene
    from scenes.running import playing, viewing

    opens = (lambda address: False) if no_open else viewing.open_in_browser
    raise typer.Exit(playing.play(load_scene(scene, o or ()), speed=speed, opens=opens))


@app.command()
def check(scene: SceneArgument, o: Overrides = None, no_code: NoCode = False) -> None:
    """Check a scene without a run.

    All mistakes are listed, with one line for each mistake.
    """
    from scenes.models.loading import load_scene
    from scenes.running.terminal import counted

    loaded = load_scene(scene, o or ())
    size = counted(loaded.settings.steps, "step")
    if loaded.sweep:
        from scenes.sweep.plan import Source, planned

        size = f"{counted(len(planned(Source.of(scene, o or ())).cases), 'case')} of {size}"
    typer.echo(f"{loaded.name}: the scene is right (model {loaded.model.name}, {size})")


@app.command(name="list")
def list_scenes(
    kind: Annotated[
        str | None, typer.Argument(metavar="[KIND]", help="A kind of parts, such as gait, world or actuator.")
    ] = None,
) -> None:
    """List the shipped scenes, or the parts of a kind.

    Each line shows a scene, a part, or a key of scenes that names a part of this kind.
    """
    from scenes.language.loader import says, shipped_scenes

    if kind is not None:
        from scenes.models.kinds import lines

        typer.echo("\n".join(lines(kind)))
        return
    for name, path in shipped_scenes().items():
        typer.echo(f"{name}  {says(path)}")


@app.command()
def init(
    context: typer.Context,
    file: Annotated[Path | None, typer.Argument(metavar="FILE", help="TOML file to write.")] = None,
    model: Annotated[str, typer.Option(help="Model of the scene.")] = "worm",
    o: Overrides = None,
    tutorials: Annotated[
        Path | None,
        typer.Option(
            "--tutorials",
            metavar="DIR",
            parser=path_of,
            help="Write the tutorials as Jupyter notebooks into a folder, instead of a FILE.",
        ),
    ] = None,
    force: Force = False,
    no_code: NoCode = False,
) -> None:
    """Write a commented scene as a starting point, or the tutorials.

    The scene contains every key with its default, or the value from -o, and with its meaning, unit and range. 'worm3d
    init FILE -o gait.kind=my_robot:Kick' includes the keys of your own part. 'worm3d init --tutorials DIR' writes the
    tutorials as notebooks.
    """
    if tutorials is not None:
        if file is not None or o:
            raise SceneError("init: --tutorials writes notebooks and no scene; leave out FILE and -o")
        _write_tutorials(tutorials, force=force)
    elif file is None:
        context.fail("Nothing to write: name a FILE for a scene, or give --tutorials DIR.")
    else:
        _write_scene(file, model, o or (), force=force)


def _write_scene(file: Path, model: str, overrides: Iterable[str], *, force: bool) -> None:
    from scenes import models
    from scenes.models.template import template
    from scenes.records.folder import write_bytes
    from scenes.running.terminal import counted

    if model not in models.names():
        raise SceneError(f"--model: got '{model}', must be one of {', '.join(models.names())}")
    if file.exists() and not force:
        raise SceneError(f"{file} exists: choose another name, or replace it with --force")
    text = template(models.get(model), overrides)
    write_bytes(file, text.encode())
    lacking = text.count(" = ?  must be given")
    fill = f"fill in its {counted(lacking, 'key')} with '= ?', then " if lacking else ""
    typer.echo(f"wrote {file}; {fill}'worm3d run {file}' runs it")


def _write_tutorials(folder: Path, *, force: bool) -> None:
    from scenes.commands.tutorials import write_tutorials

    for path in write_tutorials(folder, force=force):
        typer.echo(str(path))
    typer.echo("open them with Jupyter: pip install notebook, then 'jupyter notebook' in this folder")


@app.command()
def plot(result: ResultArgument, out: Out = None) -> None:
    """Draw all figures of a result.

    The figures are written into the folder of the result, or into the folder --out.
    """
    from scenes.records.folder import made
    from scenes.records.store import load
    from scenes.running import drawing

    record = load(result)
    folder = made(out or _home(result))
    for path in drawing.plot(record, drawing.pictures_of(record), folder):
        typer.echo(str(path))


@app.command()
def view(
    result: Annotated[
        str, typer.Argument(metavar="RESULT", help="Folder of a run, or its result.nc; with --live a scene.")
    ],
    live: Annotated[bool, typer.Option("--live", help="Show a scene during the run; nothing is stored.")] = False,
    o: Overrides = None,
    speed: Annotated[float, typer.Option(min=0.01, max=1000.0, help="With --live: simulated over real time.")] = 1.0,
    skin: Annotated[bool, typer.Option(help="Show a smooth skin, or else the chambers and links.")] = True,
    no_open: Annotated[bool, typer.Option("--no-open", help="Only print the path of the page.")] = False,
    no_code: NoCode = False,
) -> None:
    """Open the page of a result in a browser, or watch a run live.

    The page, viewer.html in the folder of the result, needs no network and can be sent to others. On a machine without
    a screen, the command only prints the path of the page.
    """
    from scenes.running import viewing

    if live:
        from scenes.models.loading import load_scene

        raise typer.Exit(viewing.watch(load_scene(result, o or ()), speed=speed, opens=not no_open))
    if o:
        raise SceneError("view: -o changes a scene, and RESULT is finished; use -o only with --live")
    from scenes.records.folder import VIEWER, made
    from scenes.records.store import load
    from scenes.running import drawing

    path = path_of(result)
    record = load(path)
    page = drawing.view(record, drawing.pictures_of(record), made(_home(path)) / VIEWER, skin=skin)
    typer.echo(str(page))
    if not no_open:
        viewing.open_in_browser(page.resolve().as_uri())


@app.command()
def export(
    result: ResultArgument,
    csv: Annotated[Path | None, file_option("--csv", help="The series over time, one row per instant.")] = None,
    npz: Annotated[Path | None, file_option("--npz", help="All variables, for numpy.load.")] = None,
    glb: Annotated[Path | None, file_option("--glb", help="A mesh of worm and world, for 3D programs.")] = None,
    at: Annotated[float | None, typer.Option(metavar="SECONDS", help="Instant of the mesh. Default: the end.")] = None,
    film: Annotated[
        Path | None, file_option("--film", help="A film in real time, .gif or .mp4 (needs ffmpeg), of 30 s at most.")
    ] = None,
    fps: Fps = None,
    force: Force = False,
) -> None:
    """Write a result in other file formats, or as a film."""
    from scenes.records.folder import require_free
    from scenes.records.store import export_csv, export_npz, load
    from scenes.running import drawing

    asked = [path for path in (csv, npz, glb, film) if path is not None]
    if not asked:
        raise SceneError("export: nothing to write; give --csv FILE, --npz FILE, --glb FILE or --film FILE")
    if at is not None and glb is None:
        raise SceneError("export: --at is the instant of a mesh; give --glb FILE too")
    if fps is not None and film is None:
        raise SceneError("export: --fps is the rate of a film; give --film FILE too")
    require_free(asked, result, force=force)
    record = load(result)
    for path, write in ((csv, export_csv), (npz, export_npz)):
        if path is not None:
            write(record, path)
            typer.echo(str(path))
    if glb is not None:
        typer.echo(str(drawing.mesh(record, drawing.pictures_of(record), at, glb)))
    if film is not None:
        _film(record, film, fps)


@app.command(hidden=True)
def animate(
    result: ResultArgument,
    out: Annotated[Path | None, file_option("--out", help="File ending in .gif or .mp4 (needs ffmpeg).")] = None,
    fps: Fps = None,
    force: Force = False,
) -> None:
    """Write a film of a result, at most 30 s long, as 'worm3d export RESULT --film FILE' does."""
    from scenes.records.folder import ANIMATION, made, require_free
    from scenes.records.store import load

    path = out or _home(result) / ANIMATION
    require_free([path], result, force=force)
    record = load(result)
    made(path.parent)
    _film(record, path, fps)


def _film(record: Record, path: Path, fps: int | None) -> None:
    from scenes.running import drawing

    typer.echo(str(drawing.animate(record, drawing.pictures_of(record), path, fps=fps or 20)))
    if line := drawing.cut_short(record):
        typer.echo(line)


@app.command(hidden=True)
def info() -> None:
    """Print versions, the platform and the paths of the packages."""
    from scenes.running.packages import info_lines

    for line in info_lines():
        typer.echo(line)


def _home(result: Path) -> Path:
    """Return the folder for the pictures of a result.

    It is the folder of the result. For a case of a sweep, it is a separate folder with the name of the case.
    """
    case = result.suffix == ".nc" and result.parent.name == "cases"
    return result if result.is_dir() else result.with_suffix("") if case else result.parent


def _former_names() -> None:
    """Add the studies under their former names as hidden commands."""
    bench, gait = (typer.Typer(no_args_is_help=True, rich_markup_mode=None) for _ in range(2))
    for group, name, command in (
        (app, "paper", studies.paper),
        (app, "validate", studies.validate),
        (app, "technologies", studies.technologies),
        (app, "identify", studies.identify),
        (bench, "control", studies.control),
        (gait, "fit", studies.gait),
    ):
        group.command(name, hidden=group is app)(command)
    for name, group in (("bench", bench), ("gait", gait)):
        group.callback()(lambda: None)
        app.add_typer(group, name=name, hidden=True)


_former_names()
