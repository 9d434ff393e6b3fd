"""The paper's figures 7 to 13, re-drawn from our own runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure

from control import gaits
from control.gaits import ContractionEngine_segmentdriven as SegmentDriven
from control.gaits.patterns import GAUSSIAN_WIDTH
from planar import figures
from planar.published import Parameters, Run
from scenes.commands.paper.tables import PERIODS, SEGMENTS, Key
from worm3d.values.arrays import FloatArray

FORCE = Parameters().contraction_force
"""Of a segment at activation 1 [N]."""

SHOWN = 6
"""Segments in figures 7 to 9."""

ENGINE = SegmentDriven()

T_CONTRACT = ENGINE.T_wave / SHOWN
"""Duration of a contraction in figures 7 and 8: one segment at a time [s]."""

OUR_CHOICE = f"T_contract = {T_CONTRACT:.3g} s (one segment at a time)"
"""The paper does not say which it drew."""


def draw(runs: Mapping[Key, Run]) -> dict[str, Figure]:
    """Return the figures by file stem, named after the paper's."""
    by_segments = {f"n = {n}": runs[n, 2.0] for n in SEGMENTS}
    by_period = {f"T = {T:g} s": runs[6, T] for T in PERIODS}
    return {
        "figure_7_segment_activation": _segment_activation(),
        "figure_8_segment_contraction_force": _segment_force(),
        "figure_9_wave_contraction_force": _wave_force(),
        "figure_10_centre_of_mass_by_segments": _centre_of_mass(by_segments, "Fig. 10, T = 2 s"),
        "figure_11_cumulative_cost_by_segments": _cumulative_cost(by_segments, "Fig. 11, T = 2 s"),
        "figure_12_centre_of_mass_by_period": _centre_of_mass(by_period, "Fig. 12, n = 6"),
        "figure_13_cumulative_cost_by_period": _cumulative_cost(by_period, "Fig. 13, n = 6"),
    }


def _sampled(activation: Callable[[float, int], FloatArray], duration: float) -> tuple[FloatArray, FloatArray]:
    time = np.arange(0.0, duration, 0.01)
    return time, np.array([activation(t, SHOWN) for t in time])


def _segment_activation() -> Figure:
    engine = SegmentDriven(contractType="square", alternating=False, T_contract=T_CONTRACT)
    figure, _ = figures.activation(
        *_sampled(engine.activation, 10.0),
        f"Fig. 7: segment-based activation, T_wave = {ENGINE.T_wave:g} s\nour choice: {OUR_CHOICE}",
    )
    return figure


def _segment_force() -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout="constrained", dpi=120)
    pulses: tuple[gaits.Pulse, ...] = ("gaussian", "square", "dirac")
    for axes, pulse in zip(figure.subplots(1, 3, sharey=True), pulses, strict=True):
        time, activation = _sampled(SegmentDriven(contractType=pulse, T_contract=T_CONTRACT).activation, 4.0)
        figures.activation(time, FORCE * activation, f"Fig. 8: {pulse} pulse", "contraction force", "N", axes)
    figure.suptitle(
        f"our choice: {OUR_CHOICE}, gaussian's sigma = {GAUSSIAN_WIDTH:g} T_contract, {FORCE:g} N", fontsize=10
    )
    return figure


def _wave_force() -> Figure:
    wave = gaits.TravellingWave(period=2.0, wavelength=1.0, direction="direct")
    time, activation = _sampled(wave.activation, 10.0)
    figure, _ = figures.activation(
        time, FORCE * activation, "Fig. 9: wave contraction, T_wave = 2 s", "contraction force", "N"
    )
    return figure


def _centre_of_mass(runs: Mapping[str, Run], title: str) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout="constrained", dpi=120)
    reported, true = figure.subplots(1, 2, sharey=True)
    time = next(iter(runs.values())).time
    reported_curves = {label: run.reported_com for label, run in runs.items()}
    true_curves = {label: run.q[:, run.net.main, 0].mean(axis=1) for label, run in runs.items()}
    figures.centre_of_mass(time, reported_curves, f"{title}: as the paper reports it", reported)
    figures.centre_of_mass(time, true_curves, f"{title}: true mean of the main nodes", true)
    true.set_ylabel("")
    return figure


def _cumulative_cost(runs: Mapping[str, Run], title: str) -> Figure:
    time = next(iter(runs.values())).time[1:]
    figure, _ = figures.cumulative_cost(
        time, {label: run.cumulative_cot for label, run in runs.items()}, f"{title}: sum of |work / dx|"
    )
    return figure
