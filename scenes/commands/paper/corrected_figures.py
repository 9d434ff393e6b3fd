"""The paper's figures 10 to 13 for the corrected worm, and what the friction law makes of the distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from planar import figures
from planar.linkage import Run
from scenes.commands.paper.corrected import NAMES, CorrectedRow, Ground, Key, Overstatement
from scenes.commands.paper.tables import PERIODS, SEGMENTS
from scenes.models.planar.linkage import cumulative_cost
from worm3d.values.arrays import FloatArray

COMPARED = (2.0, 5.0)
"""Wave periods at which the grounds are compared [s]."""


def draw(
    runs: Mapping[Key, Run], rows: Sequence[CorrectedRow], overstatements: Sequence[Overstatement]
) -> dict[str, Figure]:
    """Return the figures by file stem."""
    contact = {(r.n, r.T_wave_s): r for r in rows if r.law == "anchored"}
    by_segments = {f"n = {n}": runs[n, 2.0, "anchored"] for n in SEGMENTS}
    by_period = {f"T = {T:g} s": runs[6, T, "anchored"] for T in PERIODS}
    table_2, table_3 = [contact[n, 2.0] for n in SEGMENTS], [contact[6, T] for T in PERIODS]
    return {
        "corrected_figure_10_centre_of_mass_by_segments": _centre_of_mass(by_segments, "Fig. 10 corrected, T = 2 s"),
        "corrected_figure_11_cost_by_segments": _cost(
            by_segments, np.array(SEGMENTS, dtype=float), table_2, "number of segments", "Fig. 11 corrected, T = 2 s"
        ),
        "corrected_figure_12_centre_of_mass_by_period": _centre_of_mass(by_period, "Fig. 12 corrected, n = 6"),
        "corrected_figure_13_cost_by_period": _cost(
            by_period, np.array(PERIODS), table_3, "wave period [s]", "Fig. 13 corrected, n = 6"
        ),
        "friction_threshold_against_set_valued": _friction(runs, overstatements),
    }


def _centre_of_mass(runs: Mapping[str, Run], title: str) -> Figure:
    time = next(iter(runs.values())).time
    figure, _ = figures.centre_of_mass(time, {label: run.com[:, 0] for label, run in runs.items()}, title)
    return figure


def _cost(
    runs: Mapping[str, Run], parameter: FloatArray, rows: Sequence[CorrectedRow], xlabel: str, title: str
) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout="constrained", dpi=120)
    left, right = figure.subplots(1, 2)
    time = next(iter(runs.values())).time[1:]
    curves = {label: cumulative_cost(run.ledger.work_contract_p11, run.com[:, 0]) for label, run in runs.items()}
    figures.cumulative_cost(time, curves, f"{title}: sum of |work / dx|, (P12)", left, logarithmic=True)
    cost = np.array([np.nan if row.cost_of_transport is None else row.cost_of_transport for row in rows])
    figures.case_panel(right, parameter, cost, xlabel, "cost of transport W / (m g d)")
    right.set_title("work over weight and distance; none: no way forward", fontsize=10)
    return figure


def _friction(runs: Mapping[Key, Run], overstatements: Sequence[Overstatement]) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout="constrained", dpi=120)
    by_period = {each.T_wave_s: each for each in overstatements}
    for axes, T in zip(figure.subplots(1, 2), COMPARED, strict=True):
        curves = {_labelled(ground, by_period[T]): runs[6, T, ground].com[:, 0] for ground in NAMES}
        figures.centre_of_mass(runs[6, T, "anchored"].time, curves, f"six segments, T = {T:g} s", axes)
    return figure


def _labelled(ground: Ground, by: Overstatement) -> str:
    percent = {"anchored": None, "threshold": by.threshold_percent, "clamped": by.clamped_percent}[ground]
    return NAMES[ground] if percent is None else f"{NAMES[ground]}: {percent:+.0f} %"
