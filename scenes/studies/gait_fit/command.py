"""`worm3d study gait`: write `gait.toml`, a scene of the fitted chain, `gait.csv`, `gait.json` and `gait.png`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from control.gaits.neural.chain import FASTEST, EiChain
from control.gaits.neural.shared import ALONE, Profile, left_out, shared
from control.gaits.neural.training import StoppedError, Target, Training, fit
from scenes.language.errors import SceneError
from scenes.language.parts import key_of
from scenes.language.toml import value
from scenes.records.text import Column, csv_bytes, json_bytes
from scenes.running.report import Items, Report, StudyStoppedError, Table, report_study
from scenes.running.terminal import Interruption, busy
from scenes.studies.gait_fit import recordings
from scenes.studies.gait_fit.comparison import Comparison, Row, compared, sentences
from scenes.studies.gait_fit.recordings import Recording
from worm3d.values.parameters import parameters_of

MIN_PERIOD_RATIO = 1.5
"""The chain is fitted to the delays only if the ratio of the two wave periods is at least this large. If the periods
are closer together, they do not determine how the delays depend on the period."""


def run(to: Path, use: Sequence[str], out: Path | None, *, force: bool, quiet: bool) -> int:
    """Fit a chain to recordings, write the files, print the report, and return the exit code.

    The default folder is `runs/gait-<file>-<time>`.

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

    def study(folder: Path) -> Report:
        training = _trained(profile, targets, EiChain(direction=direction), quiet=quiet)
        comparison = compared(training.gait, shared(targets, np.inf), found, fitted, told)
        return _report(training, comparison, found, fitted, to)

    return report_study(f"gait-{to.name.partition('.')[0]}", study, out, force=force, quiet=quiet)


def _trained(profile: Profile, targets: Sequence[Target], like: EiChain, *, quiet: bool) -> Training:
    """Return a chain that is fitted to the delays of the profile at the shortest and the longest wave period.

    The longer period is increased if the ratio of the two periods is below `MIN_PERIOD_RATIO`.
    """
    fastest, slowest = (choose(target.period for target in targets) for choose in (min, max))
    paces = (fastest, max(slowest, MIN_PERIOD_RATIO * max(fastest, FASTEST)))
    with Interruption() as interruption, busy("fitting", quiet=quiet):
        wanted = [Target(period, profile.delays(period)) for period in paces]
        try:
            return fit(wanted, like, lambda tried: not interruption.requested)
        except StoppedError as stop:
            raise StudyStoppedError(interruption.cause) from stop


def _report(training: Training, comparison: Comparison, found: list[Recording], fitted: list[str], to: Path) -> Report:
    from scenes.studies.gait_fit import figure  # imports matplotlib

    title = f"A chain of neurons fitted to {', '.join(fitted[:4])} of {to.name}"
    return Report(
        said=[
            f"{to}: {training.tried} networks tried",
            Table.of(PACE_COLUMNS, comparison.paces),
            Table.of(DELAY_COLUMNS, comparison.rows),
            Items(list(sentences(comparison))),
        ],
        files={
            "gait.toml": scene(training.gait, comparison, fitted, to).encode(),
            "gait.csv": csv_bytes([CSV_COLUMNS, *map(_cells, comparison.rows)]),
            "gait.json": json_bytes(_content(training, comparison, fitted, to)),
        },
        pictures={"gait.png": figure.draw(comparison, found, title)},
    )


def scene(gait: EiChain, comparison: Comparison, fitted: Sequence[str], to: Path) -> str:
    """Return a scene of the default worm with the fitted gait as TOML. Comments at the top describe the fit."""
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
    """Return a number or a list of numbers, rounded to four significant digits. A text is returned unchanged."""
    if isinstance(number, str):
        return number
    given = number.tolist() if hasattr(number, "tolist") else number
    return [_short(each) for each in given] if isinstance(given, list) else float(f"{given:.4g}")


CSV_COLUMNS = (
    *("recording", "use", "band", "delay_s", "low_s", "high_s"),
    *("network_s", "network_error_s", "uniform_s", "uniform_error_s"),
)
"""Columns of `gait.csv`."""
PACE_COLUMNS = {
    "recording": Column("recording"),
    "use": Column("use"),
    "waves": Column("waves"),
    "period [s]": Column("period_s", ".2f"),
    "network's period [s]": Column("network_s", ".2f"),
}
DELAY_COLUMNS = {
    "delay [ms] of band": Column("band"),
    "recording": Column("recording"),
    "recorded": Column("delay_s", ".0f", 1e3),
    "90 % interval": Column("interval_text"),
    "network": Column("network_s", ".0f", 1e3),
    "error": Column("network_error_s", "+.0f", 1e3),
    "uniform": Column("uniform_s", ".0f", 1e3),
    "error of uniform": Column("uniform_error_s", "+.0f", 1e3),
}
"""Columns of the two tables that are printed in the terminal."""


def _cells(row: Row) -> list[str]:
    items = [getattr(row, name) for name in CSV_COLUMNS]
    return [f"{item:.4f}" if isinstance(item, float) else str(item) for item in items]


def _content(training: Training, comparison: Comparison, fitted: Sequence[str], to: Path) -> dict[str, Any]:
    gait, told = {name: getattr(training.gait, name) for name in parameters_of(EiChain)}, comparison.told
    return {
        "status": "done",
        "measured": str(to),
        "fitted": list(fitted),
        "gait": {name: _short(item) if hasattr(item, "tolist") else item for name, item in gait.items()},
        "cost": training.cost,
        "networks_tried": training.tried,
        "carried": comparison.carried,
        "leaving_one_out": None if told is None else {**asdict(told), "learnt": told.learnt},
        "paces": [asdict(pace) for pace in comparison.paces],
        "rows": [{name: getattr(row, name) for name in (*CSV_COLUMNS, "kept")} for row in comparison.rows],
        "sentences": list(sentences(comparison)),
    }
