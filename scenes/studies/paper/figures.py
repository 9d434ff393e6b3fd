"""The paper's figures 7 to 13 from runs of the published program, and figures 10 to 13 for the corrected worm."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control import gaits
from control.gaits import ContractionEngine_segmentdriven as SegmentDriven
from control.gaits.patterns import GAUSSIAN_WIDTH
from planar import figures, linkage, published
from scenes.models.planar.linkage import cumulative_cost
from scenes.studies.paper.cases import (
    GROUND_NAMES,
    PAPER_PERIODS_S,
    SEGMENTS,
    Ground,
    GroundKey,
    Key,
    Overstatement,
)
from worm3d.values.arrays import FloatArray

CONTRACTION_FORCE = published.Parameters().contraction_force
"""Force of a segment at activation 1 [N]."""

ENGINE = SegmentDriven()
"""The paper's gait of single segments that contract one after the other, with its default values."""

T_CONTRACT = ENGINE.T_wave / 6
"""Duration of a contraction in figures 7 and 8 [s]. With this value, the segments contract one at a time."""

OUR_CHOICE = f"T_contract = {T_CONTRACT:.3g} s (one segment at a time)"
"""Text in the figures. The paper does not give the duration of a contraction in figures 7 and 8."""


def published_figures(runs: Mapping[Key, published.Run]) -> dict[str, Figure]:
    """Return the figures by the stem of their file names, which contain the numbers of the paper's figures."""
    by_segments = {f"n = {n}": runs[n, 2.0] for n in SEGMENTS}
    by_period = {f"T = {T:g} s": runs[6, T] for T in PAPER_PERIODS_S}
    return {
        "figure_7_segment_activation": _segment_activation(),
        "figure_8_segment_contraction_force": _segment_force(),
        "figure_9_wave_contraction_force": _wave_force(),
        "figure_10_centre_of_mass_by_segments": _published_com(by_segments, "Fig. 10, T = 2 s"),
        "figure_11_cumulative_cost_by_segments": _published_cost(by_segments, "Fig. 11, T = 2 s"),
        "figure_12_centre_of_mass_by_period": _published_com(by_period, "Fig. 12, n = 6"),
        "figure_13_cumulative_cost_by_period": _published_cost(by_period, "Fig. 13, n = 6"),
    }


def _sampled(activation: Callable[[float, int], FloatArray], duration: float) -> tuple[FloatArray, FloatArray]:
    """Return times [s] up to a duration, and the activations of six segments at these times."""
    time = np.arange(0.0, duration, 0.01)
    return time, np.array([activation(t, 6) for t in time])


def _wide(panels: int, sharey: bool) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels side by side, and the axes of the panels."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained", dpi=120)
    return figure, list(figure.subplots(1, panels, sharey=sharey))


def _segment_activation() -> Figure:
    engine = SegmentDriven(contractType="square", alternating=False, T_contract=T_CONTRACT)
    figure, _ = figures.activation(
        *_sampled(engine.activation, 10.0),
        f"Fig. 7: segment-based activation, T_wave = {ENGINE.T_wave:g} s\nour choice: {OUR_CHOICE}",
    )
    return figure


def _segment_force() -> Figure:
    figure, panels = _wide(3, sharey=True)
    pulses: tuple[gaits.Pulse, ...] = ("gaussian", "square", "dirac")
    for axes, pulse in zip(panels, pulses, strict=True):
        time, activation = _sampled(SegmentDriven(contractType=pulse, T_contract=T_CONTRACT).activation, 4.0)
        figures.activation(
            time, CONTRACTION_FORCE * activation, f"Fig. 8: {pulse} pulse", "contraction force", "N", axes
        )
    figure.suptitle(
        f"our choice: {OUR_CHOICE}, gaussian's sigma = {GAUSSIAN_WIDTH:g} T_contract, {CONTRACTION_FORCE:g} N",
        fontsize=10,
    )
    return figure


def _wave_force() -> Figure:
    wave = gaits.TravellingWave(period=2.0, wavelength=1.0, direction="direct")
    time, activation = _sampled(wave.activation, 10.0)
    figure, _ = figures.activation(
        time, CONTRACTION_FORCE * activation, "Fig. 9: wave contraction, T_wave = 2 s", "contraction force", "N"
    )
    return figure


def _published_com(runs: Mapping[str, published.Run], title: str) -> Figure:
    figure, (reported, true) = _wide(2, sharey=True)
    time = next(iter(runs.values())).time
    reported_curves = {label: run.reported_com for label, run in runs.items()}
    true_curves = {label: run.q[:, run.net.main, 0].mean(axis=1) for label, run in runs.items()}
    figures.centre_of_mass(time, reported_curves, f"{title}: as the paper reports it", reported)
    figures.centre_of_mass(time, true_curves, f"{title}: true mean of the main nodes", true)
    true.set_ylabel("")
    return figure


def _published_cost(runs: Mapping[str, published.Run], title: str) -> Figure:
    time = next(iter(runs.values())).time[1:]
    figure, _ = figures.cumulative_cost(
        time, {label: run.cumulative_cot for label, run in runs.items()}, f"{title}: sum of |work / dx|"
    )
    return figure


def corrected_figures(
    runs: Mapping[GroundKey, linkage.Run], overstatements: Sequence[Overstatement]
) -> dict[str, Figure]:
    """Return the figures of the corrected worm by the stem of their file names."""
    by_segments = {f"n = {n}": runs[n, 2.0, "anchored"] for n in SEGMENTS}
    by_period = {f"T = {T:g} s": runs[6, T, "anchored"] for T in PAPER_PERIODS_S}
    return {
        "corrected_figure_10_centre_of_mass_by_segments": _corrected_com(by_segments, "Fig. 10 corrected, T = 2 s"),
        "corrected_figure_11_cost_by_segments": _corrected_cost(
            by_segments, SEGMENTS, "number of segments", "Fig. 11 corrected, T = 2 s"
        ),
        "corrected_figure_12_centre_of_mass_by_period": _corrected_com(by_period, "Fig. 12 corrected, n = 6"),
        "corrected_figure_13_cost_by_period": _corrected_cost(
            by_period, PAPER_PERIODS_S, "wave period [s]", "Fig. 13 corrected, n = 6"
        ),
        "friction_threshold_against_set_valued": _friction(runs, overstatements),
    }


def _corrected_com(runs: Mapping[str, linkage.Run], title: str) -> Figure:
    time = next(iter(runs.values())).time
    figure, _ = figures.centre_of_mass(time, {label: run.com[:, 0] for label, run in runs.items()}, title)
    return figure


def _corrected_cost(runs: Mapping[str, linkage.Run], parameter: Sequence[float], xlabel: str, title: str) -> Figure:
    figure, (left, right) = _wide(2, sharey=False)
    time = next(iter(runs.values())).time[1:]
    curves = {label: cumulative_cost(run.ledger.work_contract_p11, run.com[:, 0]) for label, run in runs.items()}
    figures.cumulative_cost(time, curves, f"{title}: sum of |work / dx|, (P12)", left, logarithmic=True)
    cost = np.array([run.cost_of_transport for run in runs.values()])
    figures.case_panel(right, np.array(parameter, dtype=float), cost, xlabel, "cost of transport W / (m g d)")
    right.set_title("work over weight and distance; none: no way forward", fontsize=10)
    return figure


def _friction(runs: Mapping[GroundKey, linkage.Run], overstatements: Sequence[Overstatement]) -> Figure:
    """Draw the centre of mass over time on each ground, for two of the wave periods."""
    figure, panels = _wide(2, sharey=False)
    by_period = {each.T_wave_s: each for each in overstatements}
    for axes, T in zip(panels, (2.0, 5.0), strict=True):
        curves = {_labelled(ground, by_period[T]): runs[6, T, ground].com[:, 0] for ground in GROUND_NAMES}
        figures.centre_of_mass(runs[6, T, "anchored"].time, curves, f"six segments, T = {T:g} s", axes)
    return figure


def _labelled(ground: Ground, by: Overstatement) -> str:
    percent = {"anchored": None, "threshold": by.threshold_percent, "clamped": by.clamped_percent}[ground]
    return GROUND_NAMES[ground] if percent is None else f"{GROUND_NAMES[ground]}: {percent:+.0f} %"
