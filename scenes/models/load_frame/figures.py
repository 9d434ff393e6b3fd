"""Figures of a run of the load frame. The name of each function is the name of the file."""

from __future__ import annotations

import tomllib

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planar import figures
from scenes.language import own
from scenes.language.errors import DiscError, SceneError
from scenes.language.reading import trusted
from scenes.models.load_frame.model import file_of
from scenes.models.load_frame.schema import LoadFrameScene
from scenes.records import measured
from scenes.records.record import Record


def force_over_cable(record: Record) -> tuple[Figure, Axes]:
    """Draw the force in the cable over the length of cable taken in, for the model and for the measurement.

    The measurement is left out if the scene has none, or if its file can no longer be read.
    """
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    if found := _measured(record):
        axes.plot(1e3 * found["cable"], found["force"], ".", color="0.6", ms=3, label="measured")
    axes.plot(1e3 * record["cable"], record["force"], color="C0", label="the segment of the model")
    axes.set(xlabel="cable taken in [mm]", ylabel="force in the cable [N]", title=record.title)
    axes.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    axes.legend()
    return figure, axes


def _measured(record: Record) -> Record | None:
    """Return the measurement that supplied the motion of the cable, or None if it has no force."""
    scene = trusted(LoadFrameScene, own.without(LoadFrameScene, tomllib.loads(record.scene)))
    path = file_of(scene.frame)
    if path is None:
        return None
    try:
        found = measured.load(path)
    except (SceneError, DiscError):  # the file may have been moved
        return None
    return found if "force" in found and found["force"].ndim == 1 else None


def energy(record: Record) -> tuple[Figure, Axes]:
    """Draw the work of the cable and what becomes of it, cumulative over the steps."""
    incoming, stored = ({name: np.cumsum(record[key])} for name, key in (("the cable", "work"), ("elastic", "elastic")))
    lost = {"joint friction": np.cumsum(record["hysteresis_loss"]), "damping": np.cumsum(record["viscous_loss"])}
    title = f"{record.title}: energy, summed over the steps"
    return figures.energy_ledger(record["step_time"], incoming, stored, lost, title=title)
