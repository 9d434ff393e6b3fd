"""The figure that shows the body of the 3D worm at a few instants, drawn from a record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scenes.models.worm.overview import in_its_frame, outlines
from scenes.models.worm.view import scene_of, world_seen
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.values.chamber_colours import RAMP

if TYPE_CHECKING:
    from worm3d import World


WALLED = ("pipe", "slope_into_pipe", "mesh")
"""Kinds of worlds whose walls are drawn in the top view, as a horizontal section."""


def body(record: Record) -> tuple[Figure, Axes]:
    """Draw the worm at a few instants.

    The colour of a chamber shows the contraction that its actuator commands, not its strain. Each instant has a row
    with a side view and a top view. A worm that climbs steeply is drawn from the side only, with the instants next to
    each other.
    """
    rows = np.unique(np.linspace(0, len(record["time"]) - 1, 5).round().astype(int))
    joints, points = (in_its_frame(record, record[name][rows]) for name in ("joints", "points"))
    low, high = points.reshape(-1, 3).min(axis=0), points.reshape(-1, 3).max(axis=0)
    climbs = bool((high - low)[2] > 2.0 * (high - low)[:2].max())
    margin = float((high - low)[[0, 2]].max()) * (0.06 if climbs else np.array([0.05, 0.02, 0.02]))
    low, high = low - margin, high + margin
    figure, grid = _stage(high - low, len(rows), climbs)
    most = 1.3 * float(np.abs(record["contraction"]).max()) or 1.0  # the darkest colours would hide the lines
    world = world_seen(record, scene_of(record))
    for k, row in enumerate(rows):
        com = in_its_frame(record, record["com"][row])
        for axes, across in zip(grid[k], (2, 1), strict=False):
            shapes = _bodies(axes, record, joints[k], points[k], int(row), across)
            shapes.set_clim(-most, most)
            axes.set(xlim=(low[0], high[0]), ylim=(low[across], high[across]))
            _section(axes, record, world, com, across)
    figure.suptitle(record.title, fontsize=10)
    _label(grid, [f"{time:.2f} s" for time in record["time"][rows]], climbs)
    bar = figure.colorbar(shapes, cax=_beside(figure))
    bar.set_label("contraction given\nby the actuators", fontsize=8)
    return figure, grid[-1][0]


def _bodies(
    axes: Axes, record: Record, joints: FloatArray, points: FloatArray, row: int, across: int
) -> PolyCollection:
    """Draw the chambers and the joints at a row of a record.

    `across` is the coordinate on the vertical axis of the view: 2 (z) for the side view, 1 (y) for the top view.
    """
    half, order = 0.5 * record["chamber_length"][row], (1, 0) if across == 2 else (0, 1)
    shapes = PolyCollection(
        [r for side in order for r in _chambers(record, joints, points, half[:, side], side, across)],
        array=np.concatenate([record["contraction"][row, :, side] for side in order]),
        cmap=LinearSegmentedColormap.from_list("contraction", RAMP[::-1]),
        edgecolors="0.2",
        lw=0.7,
    )
    axes.add_collection(shapes)
    axes.plot(joints[:, 0], joints[:, across], "o-", color="0.1", ms=2, lw=0.8)
    return shapes


def _label(grid: NDArray[Any], times: list[str], climbs: bool) -> None:
    side, along = "from the side, z [m]", "along the initial heading [m]"
    if climbs:
        grid[0, 0].set_ylabel(side, fontsize=8)
        grid[len(grid) // 2, 0].set_xlabel(along, fontsize=8)
    else:
        grid[0, 0].set_title(side, fontsize=8)
        grid[0, 1].set_title("from above, y [m]", fontsize=8)
        for axes in grid[-1]:
            axes.set_xlabel(along, fontsize=8)
    for axes, time in zip(grid[:, 0], times, strict=True):
        (axes.set_title if climbs else axes.set_ylabel)(time, fontsize=8)


def _stage(span: FloatArray, instants: int, climbs: bool) -> tuple[Figure, NDArray[Any]]:
    """Return a figure and its axes, which all have the same scale.

    The array of axes has a row for each instant, with the side view and, unless the worm climbs, the top view.
    """
    columns, rows, tall = (instants, 1, span[2]) if climbs else (2, instants, max(span[1], span[2]))
    widest, highest = (10.0, 5.0) if climbs else (8.4, 10.0)
    wide, high = min(widest / (columns * span[0]), highest / (rows * tall)) * np.array([span[0], tall])
    wide = max(wide, 0.9)
    full_wide, full_high = columns * (wide + 0.6) + 1.6, rows * (high + 0.3) + 1.0
    figure = Figure(figsize=(full_wide, full_high), dpi=120)
    places = {
        "left": 0.7 / full_wide,
        "right": 1.0 - 1.5 / full_wide,
        "bottom": 0.6 / full_high,
        "top": 1.0 - 0.7 / full_high,
        "wspace": 0.6 / wide,
        "hspace": 0.3 / high,
    }
    grid = figure.subplots(rows, columns, sharex=True, sharey=climbs, squeeze=False, gridspec_kw=places)
    for axes in grid.flat:
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7)
        if climbs or wide < 1.5:  # in narrow panels the labels of more ticks would overlap
            axes.locator_params(axis="x", nbins=2, min_n_ticks=1)
    return figure, grid.T if climbs else grid


def _beside(figure: Figure) -> Axes:
    """Return axes for the colour bar, at the right side of a figure."""
    wide, high = figure.get_size_inches()
    tall = min(2.5, high - 1.3)
    return figure.add_axes((1.0 - 1.2 / wide, 0.5 - 0.5 * tall / high, 0.15 / wide, tall / high))


def _chambers(
    record: Record, joints: FloatArray, points: FloatArray, half: FloatArray, side: int, across: int
) -> FloatArray:
    """Return the outlines of the chambers on one side (0 left, 1 right), shape (N, C, 2) [m].

    Two corners are on the axis of the segment. In the side view (`across` = 2), the other two are the upper and the
    lower apex. In the top view, they are the outward apex and its mirror image.
    """
    below, above, outward = (points[:, 3 * side + k] for k in range(3))
    centre = 0.5 * (below + above)
    edge = np.diff(joints, axis=0)
    reach = half[:, None] * edge / np.linalg.norm(edge, axis=1)[:, None]
    one, other = (above, below) if across == 2 else (outward, 2.0 * centre - outward)
    return outlines(record, centre - reach, one, centre + reach, other)[:, :, [0, across]]


def _section(axes: Axes, record: Record, world: World | None, com: FloatArray, across: int) -> None:
    """Draw the section of the world through the centre of mass, in the top view only if the world has walls."""
    if world is None or (across == 1 and scene_of(record).world.kind not in WALLED):
        return
    sides = [np.linspace(*limits, 250) for limits in (axes.get_xlim(), axes.get_ylim())]
    places = np.tile(com, (250, 250, 1))
    places[..., 0], places[..., across] = np.meshgrid(*sides)
    distance = world.distance(in_its_frame(record, places, back=True))
    axes.contourf(*sides, distance, levels=[-1e3, 0.0], colors=["0.85"], zorder=0)
