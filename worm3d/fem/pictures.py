"""Pictures of a sweep: the deformed mesh in some states, the states over length and input, and a wall on the ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from worm3d.fem.axisymmetric import State
from worm3d.fem.bending import BentState, QuarterModel
from worm3d.values.arrays import FloatArray

SHAPES = 6
"""Number of states whose mesh is drawn."""
CRUMPLED_COLOUR = "#d1495b"
WIDTH, HEIGHT = 11.0, 7.0
"""Size of a picture [inch]."""


def shapes(states: Sequence[State]) -> Figure:
    """Return a figure of the deformed meshes: states without axial force first, then the ends of the domain."""
    chosen = _chosen([state for state in states if state.stable])
    figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    axes = figure.subplots(2, (SHAPES + 1) // 2, sharex=True, sharey=True, squeeze=False).ravel()
    for axis, state in zip(axes, chosen, strict=False):
        _draw(axis, state)
    for axis in axes[len(chosen) :]:
        axis.set_axis_off()
    return figure


def _chosen(states: list[State]) -> list[State]:
    """Return states with the least and greatest length, force, radius and input, without repetition."""
    found = []
    for name in ("input", "length", "force", "radius"):
        values = [getattr(state, name) for state in states]
        found += [states[int(np.argmin(values))], states[int(np.argmax(values))]]
    return list({id(state): state for state in found}.values())[:SHAPES]


def _draw(axis: Axes, state: State) -> None:
    corners, elements = state.wall.shape(state.x)
    half = corners[:, elements].transpose(2, 1, 0) * 1e3  # (elements, 4, 2) [mm]
    whole = np.concatenate([half * signs for signs in _mirrored()])[:, :, ::-1]
    axis.add_collection(PolyCollection(list(whole), facecolor="#a9d6e5", edgecolor="#013a63", linewidth=0.4))
    for side in (-1.0, 1.0):
        radius, place = state.wall.segment.plate_radius * 1e3, side * state.length * 5e2
        axis.plot([place, place], [-radius, radius], color="#444444", linewidth=2.0)
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.set_title(f"{_input(state)}, {state.length * 1e3:.1f} mm, {state.force:.2f} N", fontsize=9)
    axis.set_xlabel("axis [mm]")
    axis.set_ylabel("radius [mm]")


def _mirrored() -> list[FloatArray]:
    return [np.array([a, b]) for a in (1.0, -1.0) for b in (1.0, -1.0)]


def _input(state: State) -> str:
    return f"cable {state.input:.2f} N" if state.is_cable else f"{state.input / 1e3:.2f} kPa"


def states(every: Sequence[State]) -> Figure:
    """Return a figure of the states in the plane of length and input, with force and radius as colours."""
    figure = Figure(figsize=(WIDTH, HEIGHT / 1.6), layout="constrained")
    stable, crumpled = ([state for state in every if state.stable is kind] for kind in (True, False))
    columns = (("force", "axial force [N]", 1.0), ("radius", "greatest outer radius [mm]", 1e3))
    for axis, (name, label, unit) in zip(figure.subplots(1, 2), columns, strict=True):
        points = np.array([[state.length * 1e3, state.input, getattr(state, name) * unit] for state in stable])
        shown = axis.scatter(*points[:, :2].T, c=points[:, 2], cmap="viridis", s=24)
        figure.colorbar(shown, ax=axis, label=label)
        if crumpled:
            places = np.array([[state.length * 1e3, state.input] for state in crumpled])
            axis.plot(*places.T, "x", color=CRUMPLED_COLOUR, label="crumpled")
            axis.legend(loc="lower left")
        axis.set_xlabel("length [mm]")
        axis.set_ylabel("tension of the cable [N]" if stable[0].is_cable else "pressure [Pa]")
    return figure


def patch(model: QuarterModel, indentation: float, state: BentState) -> Figure:
    """Return a figure of a pressed wall: the cross-section in the middle, and the section along the axis.

    Parameters
    ----------
    model : QuarterModel
    indentation : float
        Indentation [m].
    state : BentState
        State that flat ground presses, which is drawn below.
    """
    figure = Figure(figsize=(WIDTH, HEIGHT / 1.4), layout="constrained")
    points = state.unknowns[: 3 * model.nodes].reshape(-1, 3) * 1e3
    s, depth, turn = model.grid
    sections = ((turn, s == 0.0, 1, "across [mm]"), (s, turn == 0.0, 2, "axis [mm]"), (s, turn == 1.0, 2, "axis [mm]"))
    for axis, chosen in zip(figure.subplots(1, 2), (sections[:1], sections[1:]), strict=True):
        for along, plane, across, label in chosen:
            for surface in (0.0, 1.0):
                nodes = np.flatnonzero(plane & (depth == surface))
                line = points[nodes[np.argsort(along[nodes])]]
                for side in (-1.0, 1.0):
                    axis.plot(side * line[:, across], -line[:, 0], ".-", color="#013a63", markersize=3.0, linewidth=1.0)
            axis.set_xlabel(label)
        axis.axhline(-state.condition.ground_m * 1e3, color="#444444", linewidth=2.0)
        axis.set_aspect("equal")
    figure.axes[0].set_ylabel("height above the axis [mm]")
    figure.suptitle(
        f"{state.condition.pressure_Pa / 1e3:.2f} kPa, {state.condition.length_m * 1e3:.1f} mm: the ground presses by "
        f"{indentation * 1e3:.2f} mm with {state.load_N:.2f} N",
        fontsize=10,
    )
    return figure
