"""`worm3d study identify`: simulate the worm, fit and store its maps, and write the report.

The files are `identified.json`, `steering.md` and `steering.png`. A map gives speed and turn of the worm for amplitude,
frequency and steering of its gait. Controllers read the stored maps.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path

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
from scenes.records.text import json_bytes
from scenes.running.report import Items, Report, report_study
from scenes.running.terminal import progress
from scenes.studies.identify import figure, report, study
from scenes.studies.identify.study import Curve, Phases

STEERING_FIGURE_FILE = "steering.png"
Measured = tuple[Identified, tuple[Curve, ...], tuple[Phases, ...]]


def run(scene: Scene, out: Path | None, *, force: bool, quiet: bool) -> int:
    """Identify the worm of a scene on level ground with the scene's friction, and return the exit code.

    If the scene leaves the form of the wave to the program, the sine wave is identified first and the form is chosen
    from its map. The files describe the chosen wave. The default folder is `runs/identify-<scene>-<time>`. The other
    options are those of the command.

    Raises
    ------
    SceneError
        The scene does not have a 3D worm, or its worm does not crawl on its feet.
    """
    settings = scene.settings
    if not isinstance(settings, SpatialScene):
        raise SceneError(f"{scene.name}: a scene of the model '{scene.model.name}' does not steer, must be of 'worm'")
    worm, ground = worm_of(settings), friction_of(settings)

    def computed(folder: Path) -> Report:
        @cache
        def measured(wave: Wave) -> tuple[Measured, bool]:
            made = _measure(Subject(worm, ground, WAVE_SCHEDULES[wave]), quiet)
            return made, kept.store(made[0], worm, ground, Design())

        wave = wave_of(settings, lambda wave: measured(wave)[0][0]) if isinstance(settings, ControlScene) else "sine"
        made, stored = measured(wave)
        return _report(made, stored, worm, ground)

    return report_study(f"identify-{scene.name}", computed, out, force=force, quiet=quiet)


def _measure(subject: Subject, quiet: bool) -> Measured:
    with progress("maps", len(MECHANISMS), quiet=quiet, what="mechanism") as show:
        found = identify(subject, Design(), show)
    with progress("schedules", study.CURVES, quiet=quiet, what="curve") as show:
        curves = study.curves(subject, show)
    with progress("phases", study.PHASE_STUDIES, quiet=quiet, what="wave") as show:
        return found, curves, study.phases(subject, show)


def _report(made: Measured, stored: bool, worm: worm3d.Worm, ground: worm3d.Friction) -> Report:
    found, curves, phases = made
    content = {
        "worm": kept.parameters(worm),
        "ground": kept.parameters(ground),
        **found.as_dict(),
        "speed_range_bl_s": {mechanism: report.speeds(each) for mechanism, each in found.maps.items()},
        "curves": [asdict(curve) for curve in curves],
        "phases": [asdict(each) for each in phases],
    }
    said = report.sentences(found, curves, worm.length)
    return Report(
        said=[Items([*said, *(["kept for controllers"] if stored else [])])],
        pages={"steering.md": report.page(found, curves, STEERING_FIGURE_FILE)},
        files={"identified.json": json_bytes(content, indent=1)},
        pictures={STEERING_FIGURE_FILE: figure.draw(curves, phases, found)},
    )
