"""Figures of runs of the planar models, drawn from their records."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planar import figures
from scenes.models import panels
from scenes.models.planar.linkage import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from scenes.records.record import Record


def centre_of_mass(record: Record) -> tuple[Figure, Axes]:
    """Draw the centre of mass along the ground, and any centre of mass reported by the published program."""
    curves = {"centre of mass": record["com"][:, 0]}
    if "reported_com" in record:
        curves["as the program reports it"] = record["reported_com"]
    return figures.centre_of_mass(record["time"], curves, title=f"{record.title}: centre of mass")


def cumulative_cost_of_transport(record: Record) -> tuple[Figure, Axes]:
    """Draw the cumulative cost of transport of the contraction, and for the corrected worm also that of friction."""
    time, title = record["step_time"], f"{record.title}: cumulative cost of transport"
    if "cumulative_cot" in record:
        return figures.cumulative_cost(time, {"contraction": record["cumulative_cot"]}, title=title)
    curves = {
        "contraction, (P12)": record["cumulative_cot_contract"],
        "friction, (P14)": record["cumulative_cot_friction"],
    }
    return figures.cumulative_cost(time, curves, title=f"{title}, sum of |work / dx|", logarithmic=True)


def energy_ledger(record: Record) -> tuple[Figure, Axes]:
    """Draw the energy balance, cumulative over the steps."""
    return panels.energy_ledger(record, "step_time", SUPPLIED_ENERGY, STORED_ENERGY, LOST_ENERGY)


def loads_and_slip(record: Record) -> tuple[Figure, Axes]:
    """Draw the loads and the slip of the apexes, or, for a clamped worm, the loads and the friction of the joints."""
    step_time = record["step_time"]
    if "side" not in record.sizes:
        panels = {
            "normal load (P9) [N]": (step_time, record["joint_load"]),
            "friction (P10) [N]": (step_time, record["joint_friction"]),
        }
        return figures.space_time(panels, "joint (0 = tail)", title=f"{record.title}: loads and friction of the joints")
    dt = np.diff(step_time, prepend=0.0)[:, None]
    panels = {
        "normal load [N]": (record["time"], record["normal_load"].sum(axis=2)),
        "slip [mm/s]": (step_time, 1e3 * record["slip"].sum(axis=2) / dt),
    }
    return figures.space_time(panels, "segment (0 = tail)", title=f"{record.title}: loads and slip of the apexes")


def contraction(record: Record) -> tuple[Figure, Axes]:
    """Draw the commanded contraction of each segment."""
    title = f"{record.title}: commanded contraction"
    return figures.activation(record["time"], record["contraction"], title=title, quantity="contraction")


def activation(record: Record) -> tuple[Figure, Axes]:
    """Draw the activation of the segments."""
    return figures.activation(record["step_time"], record["activation"], title=f"{record.title}: activation")
