"""Runs in a browser: opening a page, and watching a run live."""

from __future__ import annotations

import os
import sys
import webbrowser

import typer

from scenes.language.errors import SceneError
from scenes.models.base import Watch
from scenes.models.loading import Scene
from scenes.records.record import Record
from scenes.running import terminal
from scenes.running.runner import EXIT_CODES, simulate
from scenes.running.terminal import Interruption


def open_in_browser(address: str) -> bool:
    """Open an address in the browser if there is a screen, and return whether it was opened.

    Without a screen, a browser would open in the terminal, which users do not want.
    """
    screens = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    if sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in screens):
        return webbrowser.open(address, new=2)
    return False


def watch(scene: Scene, *, speed: float, opens: bool) -> int:
    """Run a scene while a browser shows it, without storing the run, and return the exit code.

    Parameters
    ----------
    scene : Scene
    speed : float
        Speed of the display, simulated time over real time.
    opens : bool
        Whether to open the browser.

    Raises
    ------
    SceneError
        If the model has no live view, or the view cannot be started.
    """
    if scene.model.watch is None:
        raise SceneError(f"{scene.name}: the model '{scene.model.name}' cannot be watched; 'worm3d run' animates it")

    def began(address: str) -> None:
        seen = opens and open_in_browser(address)
        typer.echo(f"{scene.name}: {'seen' if seen else 'to be seen'} at {address} until the run ends; Ctrl-C stops it")

    with Interruption() as interruption:
        record = _watched(scene, Watch(speed, began), interruption)
    if terminal.failed(record):
        typer.echo(terminal.failure(record, scene.model), err=True)
    else:
        how = f"stopped by {interruption.cause}" if record.status == "interrupted" else record.sentence
        typer.echo(f"{scene.name}: {how}; nothing was kept, 'worm3d run' keeps it")
    return EXIT_CODES[record.status]


def _watched(scene: Scene, how: Watch, interruption: Interruption) -> Record:
    try:
        return simulate(scene, lambda done: not interruption.requested, how=how)
    except ConnectionError as error:
        raise SceneError(str(error)) from error
