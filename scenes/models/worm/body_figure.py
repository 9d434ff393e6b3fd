"""The figure of the 3D worm's body from a record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from scenes.models.worm.overview import in_its_frame
from scenes.models.worm.view import scene_of, world_seen
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from worm3d import World


INSTANTS = 5
"""Number of instants drawn, one below the other."""

STEEP = 2.0
"""Smallest ratio of height to length and width for a worm that is drawn as climbing steeply."""

BAR = 2.5
"""Largest length of a colour bar [inch]."""

WALLED = ("pipe", "slope_into_pipe", "mesh")
"""Worlds whose walls appear in a horizontal section."""

SAMPLES_PER_SIDE = 250
"""Number of positions along each side at which a section is evaluated."""

DEEP = -1e3
"""Depth that represents minus infinity in a picture [m]."""


def body(record: Record) -> tuple[Figure, Axes]:
    """Draw the worm at a few instants, coloured by the contraction from the actuators (not by the strain).

    The views are from the side and from above, one instant below the other. A worm that climbs steeply is drawn from
    the side only, with the instants next to each other.
    """
    rows = np.unique(np.linspace(0, len(record["time"]) - 1, INSTANTS).round().astype(int))
    joints, points = (in_its_frame(record, record[name][rows]) for name in ("joints", "points"))
    low, high = points.reshape(-1, 3).min(axis=0), points.reshape(-1, 3).max(axis=0)
    climbs = bool((high - low)[2] > STEEP * (high - low)[:2].max())
    margin = float((high - low)[[0, 2]].max()) * (np.array([0.05, 0.02, 0.02]) if not climbs else 0.06)
    low, high = low - margin, high + margin
    figure, grid, bar = (_tall_stage if climbs else _stage)(high - low, len(rows))
    most = 1.3 * float(np.abs(record["contraction"]).max()) or 1.0  # the darkest colours would hide the lines
    world = world_seen(record, scene_of(record))
    for k, row in enumerate(rows):
        com = in_its_frame(record, record["com"][row])
        for axes, across in zip(grid[k], (2, 1), strict=False):
            shapes = _bodies(axes, record, joints[k], points[k], int(row), across)
            shapes.set_clim(-most, most)
            axes.set(xlim=(low[0], high[0]), ylim=(low[across], high[across]))
            _section(axes, record, world, com, across)
    figure.suptitle(record.title, fontsize=10, y=1.0 - 0.08 / figure.get_figheight(), va="top")
    times = [f"{time:.2f} s" for time in record["time"][rows]]
    (_label_tall if climbs else _label)(grid, times)
    figure.colorbar(shapes, cax=bar).set_label("contraction given\nby the actuators", fontsize=8)
    return figure, grid[-1][0]


def _bodies(
    axes: Axes, record: Record, joints: FloatArray, points: FloatArray, row: int, across: int
) -> PolyCollection:
    """Draw the chambers and the joints at a row of a record, seen along an axis."""
    half, order = 0.5 * record["chamber_length"][row], (1, 0) if across == 2 else (0, 1)
    shapes = PolyCollection(
        [r for side in order for r in _rhombi(joints, points, half[:, side], side, across)],
        array=np.concatenate([record["contraction"][row, :, side] for side in order]),
        cmap="RdBu_r",
        edgecolors="0.2",
        lw=0.7,
    )
    axes.add_collection(shapes)
    axes.plot(joints[:, 0], joints[:, across], "o-", color="0.1", ms=2, lw=0.8)
    return shapes


def _label(grid: NDArray[Any], times: list[str]) -> None:
    for axes, time in zip(grid[:, 0], times, strict=True):
        axes.set_ylabel(time, fontsize=8)
    for axes, title in zip(grid[0], ("from the side, z [m]", "from above, y [m]"), strict=True):
        axes.set_title(title, fontsize=8)
    for axes in grid[-1]:
        axes.set_xlabel("along the initial heading [m]", fontsize=8)


def _label_tall(grid: NDArray[Any], times: list[str]) -> None:
    for (axes,), time in zip(grid, times, strict=True):
        axes.set_title(time, fontsize=8)
    grid[0, 0].set_ylabel("from the side, z [m]", fontsize=8)
    grid[len(grid) // 2, 0].set_xlabel("along the initial heading [m]", fontsize=8)


def _stage(span: FloatArray, instants: int) -> tuple[Figure, NDArray[Any], Axes]:
    """Return a figure with a side and a top view for each instant, all to one scale, and the axes of a colour bar.

    The layout is computed in inches: with so many axes, the layout of matplotlib takes longer than a run.
    """
    tall = float(max(span[1], span[2]))
    scale = min(4.2 / span[0], 10.0 / (instants * tall))
    wide, high = max(scale * span[0], 1.8), scale * tall
    return _frame((instants, 2), wide, high, gaps=(0.45, 0.2), top=0.6)


def _tall_stage(span: FloatArray, instants: int) -> tuple[Figure, NDArray[Any], Axes]:
    """Return the same as `_stage`, with only a side view for each instant, next to each other."""
    scale = min(5.0 / span[2], 10.0 / (instants * span[0]))
    figure, grid, bar = _frame((1, instants), max(scale * span[0], 0.9), scale * span[2], gaps=(0.25, 0.0), top=0.8)
    for axes in grid[0]:
        axes.xaxis.set_major_locator(MaxNLocator(2, steps=[1, 2, 5, 10], min_n_ticks=1))
        axes.locator_params(axis="y", nbins=8)
        axes.tick_params(labelleft=axes is grid[0, 0])
    return figure, grid.T, bar


def _frame(
    shape: tuple[int, int], wide: float, high: float, gaps: tuple[float, float], top: float
) -> tuple[Figure, NDArray[Any], Axes]:
    """Return a figure with axes of equal size, given in inches, and a colour bar no taller than needed."""
    (rows, columns), left, right, bottom = shape, 0.6, 1.0, 0.55
    width = left + columns * wide + (columns - 1) * gaps[0] + right
    height = bottom + rows * high + (rows - 1) * gaps[1] + top
    figure = Figure(figsize=(width, height), dpi=120)
    places = {"left": left / width, "right": 1.0 - right / width, "bottom": bottom / height, "top": 1.0 - top / height}
    spaces = {"wspace": gaps[0] / wide, "hspace": gaps[1] / high}
    grid = figure.subplots(*shape, sharex=True, squeeze=False, gridspec_kw={**places, **spaces})
    for axes in grid.flat:
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7)
        axes.locator_params(axis="y", nbins=3)
    tall = min(BAR, height - bottom - top)
    middle = 0.5 * (bottom + height - top)
    place = (1.0 - (right - 0.15) / width, (middle - 0.5 * tall) / height, 0.12 / width, tall / height)
    bar = figure.add_axes(place)
    bar.tick_params(labelsize=7)
    return figure, grid, bar


def _rhombi(joints: FloatArray, points: FloatArray, half: FloatArray, side: int, across: int) -> FloatArray:
    """Return the outlines of the chambers on one side (0 left, 1 right), seen along an axis, shape (N, 4, 2).

    In the side view, two corners are the upper and the lower apex; in the top view, the outward apex and its mirror
    image.
    """
    below, above, outward = (points[:, 3 * side + k] for k in range(3))
    centre = 0.5 * (below + above)
    edge = np.diff(joints, axis=0)
    reach = half[:, None] * edge / np.linalg.norm(edge, axis=1)[:, None]
    one, other = (above, below) if across == 2 else (outward, 2.0 * centre - outward)
    return np.stack([centre - reach, one, centre + reach, other], axis=1)[:, :, [0, across]]


def _section(axes: Axes, record: Record, world: World | None, com: FloatArray, across: int) -> None:
    """Draw vertical sections of solids through the centre of mass, and horizontal sections if there are walls."""
    if world is None or (across == 1 and scene_of(record).world.kind not in WALLED):
        return
    sides = [np.linspace(*limits, SAMPLES_PER_SIDE) for limits in (axes.get_xlim(), axes.get_ylim())]
    places = np.tile(com, (SAMPLES_PER_SIDE, SAMPLES_PER_SIDE, 1))
    places[..., 0], places[..., across] = np.meshgrid(*sides)
    distance = world.distance(in_its_frame(record, places, back=True))
    axes.contourf(*sides, distance, levels=[DEEP, 0.0], colors=["0.85"], zorder=0)
