"""`worm3d study identify`: run the plant, fit, store, and write `identified.json`, `steering.md` and `steering.png`."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path

import typer

import worm3d
from control.gaits.steering import MECHANISMS, WAVE_SCHEDULES, Wave
from control.identification import identified as kept
from control.identification.identified import Design, Identified
from scenes.language.errors import SceneError
from scenes.models.control.build import wave_of
from scenes.models.control.identify import Subject, identify
from scenes.models.control.schema import ControlScene
from scenes.models.loading import Scene
from scenes.models.worm.build import friction_of, worm_of
from scenes.models.worm.schema import SpatialScene
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import json_bytes
from scenes.running.drawing import save_figure
from scenes.running.terminal import progress
from scenes.studies.identify import figure, report, study
from scenes.studies.identify.study import Curve, Phases

STEERING_DATA_FILE, STEERING_TABLES_FILE, STEERING_FIGURE_FILE = "identified.json", "steering.md", "steering.png"
Measured = tuple[Identified, tuple[Curve, ...], tuple[Phases, ...]]


def run(scene: Scene, out: Path | None, *, force: bool, quiet: bool) -> int:
    """Identify the worm of a scene on level ground with the scene's friction, and return the exit code.

    If the wave is to be chosen, the sine is identified first, and the files describe the chosen wave. The default
    folder is `runs/identify-<scene>-<time>`; other options as in the command.

    Raises
    ------
    SceneError
        The scene is not of the 3D worm, or its worm does not crawl on its feet.
    """
    settings = scene.settings
    if not isinstance(settings, SpatialScene):
        raise SceneError(f"{scene.name}: a scene of the model '{scene.model.name}' does not steer, must be of 'worm'")
    worm, ground = worm_of(settings), friction_of(settings)
    with folders.prepared(out, f"identify-{scene.name}", force=force) as folder:

        @cache
        def measured(wave: Wave) -> tuple[Measured, bool]:
            made = _measure(Subject(worm, ground, WAVE_SCHEDULES[wave]), quiet)
            return made, kept.store(made[0], worm, ground, Design())

        wave = wave_of(settings, lambda wave: measured(wave)[0][0]) if isinstance(settings, ControlScene) else "sine"
        made, cached = measured(wave)
        _write(folder, made, worm, ground)
        if not quiet:
            for line in report.terminal_lines(*made[:2], worm.length):
                typer.echo(line)
            typer.echo(
                f"Written to {folder}: {STEERING_TABLES_FILE}, {STEERING_DATA_FILE}, {STEERING_FIGURE_FILE}"
                + ("; kept for controllers" if cached else "")
            )
    return 0


def _measure(subject: Subject, quiet: bool) -> Measured:
    with progress("maps", len(MECHANISMS), quiet=quiet, what="mechanism") as show:
        found = identify(subject, Design(), show)
    with progress("schedules", study.CURVES, quiet=quiet, what="curve") as show:
        curves = study.curves(subject, show)
    with progress("phases", study.PHASE_STUDIES, quiet=quiet, what="wave") as show:
        return found, curves, study.phases(subject, show)


def _write(folder: Path, made: Measured, worm: worm3d.Worm, ground: worm3d.Friction) -> None:
    found, curves, phases = made
    content = {
        "worm": kept.parameters(worm),
        "ground": kept.parameters(ground),
        **found.as_dict(),
        "speed_range_bl_s": {mechanism: report.speeds(each) for mechanism, each in found.maps.items()},
        "curves": [asdict(curve) for curve in curves],
        "phases": [asdict(each) for each in phases],
    }
    write_bytes(folder / STEERING_DATA_FILE, json_bytes(content, indent=1))
    write_bytes(folder / STEERING_TABLES_FILE, report.markdown(found, curves, STEERING_FIGURE_FILE).encode())
    save_figure(figure.draw(curves, phases, found), folder / STEERING_FIGURE_FILE)
