"""The commands of `worm3d` for robots. Imports that take long are inside the functions."""

from __future__ import annotations

from typing import Annotated

import typer

from scenes.commands.arguments import Force, NoCode, Out, Overrides, Quiet, SceneArgument

robots = typer.Typer(rich_markup_mode=None)
"""Commands that `scenes.commands.app` adds to the program."""

ADDRESS = "udp://HOST:PORT, or serial:DEVICE, with @RATE [bit/s] at the end if needed."


@robots.command()
def bridge(
    scene: SceneArgument,
    to: Annotated[str, typer.Option("--to", metavar="ADDRESS", help=f"Address of the robot: {ADDRESS}")],
    lead: Annotated[
        float, typer.Option("--lead", min=0.0, max=1.0, help="Time from the plan of a command to its use [s].")
    ] = 0.1,
    give_up: Annotated[
        float, typer.Option("--give-up", min=0.1, help="Time without samples after which the run ends [s].")
    ] = 10.0,
    o: Overrides = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Let a controller or a gait drive a robot in real time.

    Writes result.nc, summary.json, figures and viewer.html, measured.csv for 'worm3d fit --to', and commands.csv for
    the key gait.file. If the robot falls silent, the command prints a message, and goes on when the robot answers.
    Otherwise the exit code is 3.
    """
    from scenes.bridge.drive import run
    from scenes.models.loading import load_scene

    raise typer.Exit(run(load_scene(scene, o or ()), to, lead, give_up, out, force=force, quiet=quiet))


@robots.command()
def robot(
    scene: SceneArgument,
    listen: Annotated[str, typer.Option("--listen", metavar="ADDRESS", help=f"Own address: {ADDRESS}")],
    delay: Annotated[float, typer.Option("--delay", min=0.0, help="Delay of each packet, each way [s].")] = 0.0,
    jitter: Annotated[float, typer.Option("--jitter", min=0.0, help="Largest further random delay [s].")] = 0.0,
    loss: Annotated[float, typer.Option("--loss", min=0.0, max=1.0, help="Probability that a packet is lost.")] = 0.0,
    o: Overrides = None,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    no_code: NoCode = False,
) -> None:
    """Simulate a robot in real time, for 'worm3d bridge'.

    The robot is the worm of the scene with the sensors of the scene; -o gives the robot other parameters than the
    controller expects. Ctrl-C ends the robot, and --out writes the true motion to a folder.
    """
    from scenes.bridge.simulated import run
    from scenes.models.loading import load_scene

    line = delay, jitter, loss
    raise typer.Exit(run(load_scene(scene, o or ()), listen, line, out, force=force, quiet=quiet))
