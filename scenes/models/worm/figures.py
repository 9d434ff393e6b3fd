"""Figures of a run of the 3D worm, drawn from its record. The name of each function is the name of the file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from planar import figures as planar_figures
from scenes.models import panels
from scenes.models.panels import at_least, ends, from_above, stacked
from scenes.models.worm.body_figure import body
from scenes.models.worm.overview import in_its_frame
from scenes.models.worm.view import scene_of, side_and_top
from scenes.records.record import Record
from worm3d.physics.segment_laws.file import INPUT_UNITS
from worm3d.recorded.energy import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from scenes.models.worm.schema import AnyWormScene

__all__ = [
    "body",
    "centre_of_mass_and_heading",
    "contraction",
    "energy_ledger",
    "loads_and_slip",
    "path",
    "side_and_top",
]


def path(record: Record) -> tuple[Figure, Axes]:
    """Draw a top view: the path of the centre of mass, headings along it, and the body at the start and at the end."""
    com, heading = record["com"], record["heading"]
    figure, (axes,) = stacked(4.8)
    ends(axes, record["joints"])
    axes.plot(*com[:, :2].T, color="C0", lw=1.2, zorder=4, label="centre of mass")
    from_above(axes)
    wide, high = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    figure.set_figheight(min(max(5.6 * high / wide + 0.9, 2.4), 6.4))
    rows = np.unique(np.linspace(0, len(com) - 1, 8).round().astype(int))
    arrows = 0.05 * wide * np.array([np.cos(heading[rows]), np.sin(heading[rows])])
    style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004, "color": "C3"}
    axes.quiver(*com[rows, :2].T, *arrows, zorder=3, label="heading", **style)
    _patches(axes, scene_of(record))
    axes.set_title(f"{record.title}: path seen from above", fontsize=10)
    axes.legend(fontsize=7)
    return figure, axes


def centre_of_mass_and_heading(record: Record) -> tuple[Figure, Axes]:
    """Draw the displacement of the centre of mass, its height and the heading over time."""
    time, moved = record["time"], in_its_frame(record, record["com"])
    figure, (way, height, turned) = stacked(6.0, (2, 1, 1))
    way.plot(time, moved[:, 0] - moved[0, 0], label="along the initial heading")
    way.plot(time, moved[:, 1] - moved[0, 1], label="to its left")
    way.legend(fontsize=8)
    height.plot(time, moved[:, 2], color="C2")
    turned.plot(time, np.rad2deg(record["heading"]), color="C3")
    for axes, label, span in (
        (way, "displacement of the\ncentre of mass [m]", 0.002),
        (height, "its height, z [m]", 0.02),
        (turned, "heading [deg]", 2.0),
    ):
        axes.set_ylabel(label)
        at_least(axes, span)
    way.set_title(f"{record.title}: centre of mass and heading", fontsize=10)
    return figure, turned


def contraction(record: Record) -> tuple[Figure, Axes]:
    """Draw the contraction of the chambers over time and along the worm, and any inputs and hinge angles."""
    time, given = record["time"], record["contraction"]
    panels = {"contraction": (time, given.mean(axis=2))}
    if not np.array_equal(given[..., 0], given[..., 1]):
        panels = {f"contraction, {side}": (time, given[..., k]) for k, side in enumerate(("left", "right"))}
    for each in (record.variable(name) for name in INPUT_UNITS if name in record):
        panels[f"{each.name} [{each.units}]"] = (time, each.values.mean(axis=2))
    if np.any(record["hinge"]):
        hinge = np.rad2deg(record["hinge"])  # the hinge at the rear of segment j; segment 0, the tail, has none
        panels["hinge [deg]"] = (time, np.column_stack([np.zeros(len(time)), hinge]))
    title = f"{record.title}: contraction given by the actuators"
    return planar_figures.space_time(panels, "segment (0 = tail)", title=title)


def loads_and_slip(record: Record) -> tuple[Figure, Axes]:
    """Draw the normal loads and the slip of the segments over time; for a clamped worm, the loads of the joints."""
    time = record["time"]
    if scene_of(record).world.kind == "clamped":
        panels = {"normal load (P9) [N]": (time, record["joint_load"])}
        return planar_figures.space_time(panels, "joint (0 = tail)", title=f"{record.title}: loads of the joints")
    load = _of_segments(record["normal_load"], record["joint_load"])
    slip = _of_segments(record["slip"], record["joint_slip"])
    rate = slip / np.diff(time, prepend=-np.inf)[:, None]
    panels = {"normal load [N]": (time, load), "slip [mm/s]": (time, 1e3 * rate)}
    title = f"{record.title}: loads and slip, summed over the contacts"
    return planar_figures.space_time(panels, "segment (0 = tail)", title=title)


def energy_ledger(record: Record) -> tuple[Figure, Axes]:
    """Draw the energy balance, cumulative over time."""
    terms = ([name for name in names if name in record] for names in (SUPPLIED_ENERGY, STORED_ENERGY, LOST_ENERGY))
    figure, axes = panels.energy_ledger(record, "time", *terms)
    figure.set_size_inches(8.4, 4.0)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure, axes


def _of_segments(of_apexes: FloatArray, of_faces: FloatArray) -> FloatArray:
    """Return the sums over the contacts of each segment, shape (T, N).

    `of_apexes` are values of the apexes, shape (T, N, 6). `of_faces` are values of the joints and the end faces, shape
    (T, N+1); value j counts for segment j, and the last value for the head.
    """
    total: FloatArray = of_apexes.sum(axis=2) + of_faces[:, :-1]
    total[:, -1] += of_faces[:, -1]
    return total


def _patches(axes: Axes, scene: AnyWormScene) -> None:
    """Draw the areas with a different friction."""
    world, limits = scene.world, (axes.get_xlim(), axes.get_ylim())
    slope, heading = math.radians(world.slope_deg), math.radians(world.heading_deg)
    ascent = math.cos(slope) * np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-math.sin(heading), math.cos(heading)])
    everywhere = (-1e3, 1e3)
    for k, patch in enumerate(world.patches):
        along, across = patch.along_m or everywhere, patch.across_m or everywhere
        corners = [u * ascent + v * left for u, v in zip((*along, *along[::-1]), np.repeat(across, 2), strict=True)]
        area = Polygon(corners, facecolor=f"C{k + 1}", alpha=0.15, zorder=0, label=f"friction x {patch.grip:g}")
        axes.add_patch(area)
    axes.set(xlim=limits[0], ylim=limits[1])
