"""`worm3d fit`: fit keys of a scene, and write `fit.json`, `fit.toml` and `fit.png`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from scenes.language.loader import find_scene
from scenes.running.report import Report, StudyStoppedError, report_study
from scenes.running.terminal import Interruption, progress
from scenes.studies.fit.fitting import fit
from scenes.studies.fit.report import report
from scenes.studies.fit.trials import StoppedError


def run(
    scene: str,
    to: Path,
    vary: Sequence[str],
    overrides: Sequence[str],
    out: Path | None,
    *,
    runs: int,
    force: bool,
    quiet: bool,
) -> int:
    """Fit keys of a scene, write the files, print the report, and return the exit code.

    The default folder is `runs/fit-<scene>-<time>`.

    Raises
    ------
    SceneError
        As in `scenes.studies.fit.fit`, or the folder cannot be used.
    """
    name = find_scene(scene).stem

    def study(folder: Path) -> Report:
        with Interruption() as interruption, ExitStack() as shown:
            shows: list[Callable[[int], None]] = []

            def go_on(done: int) -> bool:
                if done and not shows:  # the first run has shown that the scene, the keys and the data are valid
                    bar = progress(f"fit of {name}, at most", runs, quiet=quiet, what="run")
                    shows.append(shown.enter_context(bar))
                for show in shows:
                    show(done)
                return not interruption.requested

            try:
                return report(fit(scene, to, vary, overrides, runs, go_on))
            except StoppedError as stop:
                raise StudyStoppedError(interruption.cause) from stop

    return report_study(f"fit-{name}", study, out, force=force, quiet=quiet)
