"""`worm3d study gait`: write `gait.toml`, a scene of the fitted chain, `gait.csv`, `gait.json` and `gait.png`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import typer

from control.gaits.neural.chain import FASTEST, EiChain
from control.gaits.neural.shared import ALONE, LeftOut, Profile, left_out, shared
from control.gaits.neural.training import StoppedError, Target, Training, fit
from scenes.language.errors import SceneError
from scenes.language.parts import key_of
from scenes.language.toml import value
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import aligned, csv_bytes, json_bytes
from scenes.running.drawing import save_figure
from scenes.running.runner import EXIT_CODES
from scenes.running.terminal import Interruption, busy
from scenes.studies.gait_fit import recordings
from scenes.studies.gait_fit.comparison import Comparison, Row, compared, sentences
from scenes.studies.gait_fit.recordings import Recording
from worm3d.values.parameters import parameters_of

GAIT_SCENE_FILE, GAIT_TABLE_FILE, GAIT_DATA_FILE, GAIT_FIGURE_FILE = "gait.toml", "gait.csv", "gait.json", "gait.png"
MIN_PERIOD_RATIO = 1.5
"""Smallest ratio of the two periods at which a chain has the profile: less does not determine the exponent of pace."""
DIGITS = 4
"""Significant digits of the constants in the scene."""


def run(to: Path, use: Sequence[str], out: Path | None, *, force: bool, quiet: bool) -> int:
    """Fit, write and report; return the exit code. The default folder is `runs/gait-<file>-<time>`.

    Raises
    ------
    SceneError
        The file has no recordings of waves, a name in `use` is unknown, or the folder cannot be used.
    """
    direction, found = recordings.load(to)
    names = [each.name for each in found]
    if unknown := [name for name in use if name not in names]:
        raise SceneError(f"--use: got '{unknown[0]}', must be one of {', '.join(names)}, the recordings in {to}")
    fitted = list(use) or names
    waves = [each.waves for each in found if each.name in fitted]
    told = left_out(waves) if len(waves) > 1 else None
    targets = [Target(each.period, each.median()) for each in waves]
    profile = shared(targets, told.strength if told else ALONE)
    with folders.prepared(out, f"gait-{to.name.partition('.')[0]}", force=force) as folder:
        try:
            training = _trained(profile, targets, EiChain(direction=direction), quiet=quiet)
        except StoppedError:
            typer.echo(f"{to}: stopped by Ctrl-C; nothing of this fit was kept", err=True)
            return EXIT_CODES["interrupted"]
        comparison = compared(training.gait, shared(targets, np.inf), found, fitted, told)
        with busy("drawing", quiet=quiet):
            _write(training, comparison, found, fitted, to, folder)
    if not quiet:
        _tell(training, comparison, to, folder)
    return 0


def _trained(profile: Profile, targets: Sequence[Target], like: EiChain, *, quiet: bool) -> Training:
    """Return the chain with the profile at the fastest and slowest pace, a factor `MIN_PERIOD_RATIO` or more apart."""
    fastest, slowest = (choose(target.period for target in targets) for choose in (min, max))
    paces = (fastest, max(slowest, MIN_PERIOD_RATIO * max(fastest, FASTEST)))
    with Interruption() as interruption, busy("fitting", quiet=quiet):
        wanted = [Target(period, profile.delays(period)) for period in paces]
        return fit(wanted, like, lambda tried: not interruption.requested)


def _write(
    training: Training, comparison: Comparison, found: list[Recording], fitted: list[str], to: Path, folder: Path
) -> None:
    from scenes.studies.gait_fit import figure  # imports matplotlib

    write_bytes(folder / GAIT_SCENE_FILE, scene(training.gait, comparison, fitted, to).encode())
    write_bytes(folder / GAIT_TABLE_FILE, _table(comparison))
    write_bytes(folder / GAIT_DATA_FILE, json_bytes(_content(training, comparison, fitted, to)))
    title = f"A chain of neurons fitted to {', '.join(fitted[:4])} of {to.name}"
    save_figure(figure.draw(comparison, found, title)[0], folder / GAIT_FIGURE_FILE)


def scene(gait: EiChain, comparison: Comparison, fitted: Sequence[str], to: Path) -> str:
    """Return a scene of the default worm with a fitted gait, as TOML; comments at the top describe the fit."""
    known = parameters_of(EiChain)
    common = {key: value(_short(getattr(gait, key))) for key in ("direction", "coupling", "drive", "inhibition")}
    rest = {key_of(known[key]): value(_short(getattr(gait, key))) for key in ("period", "tau_e", "pace_exponent")}
    lines = [f"# A chain of neurons fitted to {', '.join(fitted)} of {to.name}."]
    lines += [f"# {sentence}" for sentence in sentences(comparison)]
    lines += ["", 'model = "worm"', 'title = "A worm with a fitted chain of neurons"', "", "[run]"]
    lines += [f"duration_s = {5.0 * round(max(10.0, 5.0 * gait.period) / 5.0)}", "dt_s = 0.01", "", "[gait]"]
    lines += ['kind = "ei_chain"', *(f"{key} = {text}" for key, text in {**common, **rest}.items())]
    return "\n".join(lines) + "\n"


def _short(number: Any) -> Any:
    """Return a number or a list of numbers with few digits; other values are returned unchanged."""
    if isinstance(number, str):
        return number
    given = number.tolist() if hasattr(number, "tolist") else number
    return [_short(each) for each in given] if isinstance(given, list) else float(f"{given:.{DIGITS}g}")


RECORDING_COLUMNS = ("recording", "use", "band", "delay_s", "low_s", "high_s")
ERROR_COLUMNS = ("network_s", "network_error_s", "uniform_s", "uniform_error_s")
"""Columns of the table."""


def _table(comparison: Comparison) -> bytes:
    names = (*RECORDING_COLUMNS, *ERROR_COLUMNS)
    return csv_bytes([names, *([_cell(getattr(row, name)) for name in names] for row in comparison.rows)])


def _cell(item: Any) -> str:
    return f"{item:.4f}" if isinstance(item, float) else str(item)


def _content(training: Training, comparison: Comparison, fitted: Sequence[str], to: Path) -> dict[str, Any]:
    gait = {name: getattr(training.gait, name) for name in parameters_of(EiChain)}
    return {
        "status": "done",
        "measured": str(to),
        "fitted": list(fitted),
        "gait": {name: _short(item) if hasattr(item, "tolist") else item for name, item in gait.items()},
        "cost": training.cost,
        "networks_tried": training.tried,
        "carried": comparison.carried,
        "leaving_one_out": None if comparison.told is None else _told(comparison.told),
        "paces": [{field.name: getattr(pace, field.name) for field in fields(pace)} for pace in comparison.paces],
        "rows": [
            {name: getattr(row, name) for name in (*RECORDING_COLUMNS, *ERROR_COLUMNS, "kept")}
            for row in comparison.rows
        ],
        "sentences": list(sentences(comparison)),
    }


def _told(told: LeftOut) -> dict[str, Any]:
    return {field.name: getattr(told, field.name) for field in fields(told)} | {"learnt": told.learnt}


def _tell(training: Training, comparison: Comparison, to: Path, folder: Path) -> None:
    typer.echo(f"{to}: {training.tried} networks tried")
    paces = ("recording", "use", "waves", "period [s]", "network's")
    rows = [
        (each.recording, each.use, str(each.waves), f"{each.period_s:.2f}", f"{each.network_s:.2f}")
        for each in comparison.paces
    ]
    for line in aligned(paces, rows):
        typer.echo(f"  {line}")
    delays = ("delay [ms] of", "in", "recorded", "90 % interval", "network", "off", "uniform", "off")
    for line in aligned(delays, map(_row, comparison.rows)):
        typer.echo(f"  {line}")
    for sentence in sentences(comparison):
        typer.echo(f"  {sentence}")
    typer.echo(f"  written to {folder}: {GAIT_SCENE_FILE}, {GAIT_TABLE_FILE}, {GAIT_DATA_FILE}, {GAIT_FIGURE_FILE}")


def _row(row: Row) -> tuple[str, ...]:
    delay, low, high, network, uniform_ = (
        f"{1e3 * number:.0f}" for number in (row.delay_s, row.low_s, row.high_s, row.network_s, row.uniform_s)
    )
    off, uniform_off = f"{1e3 * row.network_error_s:+.0f}", f"{1e3 * row.uniform_error_s:+.0f}"
    return row.band, row.recording, delay, f"{low} to {high}", network, off, uniform_, uniform_off
