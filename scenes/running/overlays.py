"""Figures that compare several records, which may be simulations or measurements, or show a single measurement.

The argument of each function is a dictionary of records by label. A function returns None if no record has data for the
figure. Simulations are drawn as lines, and measurements as dots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from scenes.language.errors import SceneError
from scenes.models.base import Draw, Pictures
from scenes.records import measured
from scenes.records.columns import MARKER
from scenes.records.record import Record
from scenes.running.robot_page import chambers, is_shown, view
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Records = Mapping[str, Record]
Overlay = Callable[[Records], "tuple[Figure, Axes] | None"]
Curves = dict[str, tuple[FloatArray, FloatArray]]
"""Curves by the label of the record. Each has the instants, shape (T,) [s], and the values, shape (T,)."""

MOST_ROWS = 12
"""Largest number of panels in a figure."""
LEAST_RANGE = 1e-11
"""Smallest range of a vertical axis, in the axis's unit. Smaller variations are rounding errors."""
DRAWN_ENERGIES = (
    "work_contract",
    "work_external",
    "friction_loss",
    "viscous_loss",
    "actuator_loss",
    "impact",
    "numerical_loss",
)
"""Terms of the energy balance that are drawn, cumulative over the run."""
SEPARATE_QUANTITIES = ("strain", "heading", "com", *DRAWN_ENERGIES)
"""Quantities that have their own figures."""


def path(records: Records) -> tuple[Figure, Axes] | None:
    """Draw the paths of centres of mass and markers in the plane of x and y."""
    tracks = {label: _tracks(record, records) for label, record in records.items()}
    if not any(tracks.values()):
        return None
    figure, axes = _figure(6.4, 4.8)
    named = {"com"}
    for number, (label, found) in enumerate(tracks.items()):
        for k, (name, places) in enumerate(found.items()):
            style = _style(records[label], number)
            shade = 1.0 if name == "com" else 0.5
            axes.plot(*places[:, :2].T, **{**style, "alpha": shade}, label=label if k == 0 else None)
            if known := np.flatnonzero(np.isfinite(places[:, :2]).all(axis=1)).tolist():
                axes.plot(*places[known[0], :2], "o", color=style["color"], ms=5)
                if name not in named:
                    named.add(name)
                    at = tuple(places[known[0], :2])
                    axes.annotate(name, at, fontsize=7, textcoords="offset points", xytext=(4, 4))
    names = {name for found in tracks.values() for name in found}
    what = " and ".join(
        each for each in ("centre of mass" * ("com" in names), "markers" * bool(names - {"com"})) if each
    )
    axes.set(xlabel="x [m]", ylabel="y [m]", title=f"Path of {what}, from the dot")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8)
    return figure, axes


def centre_of_mass_and_heading(records: Records) -> tuple[Figure, Axes] | None:
    """Draw the centre of mass, relative to the first position, and the heading over time."""
    com, heading = _series(records, "com"), _series(records, "heading")
    rows: dict[str, Curves] = {
        f"centre of mass,\n{name} from the start [m]": {
            label: (time, x - x[np.isfinite(x)][0]) for label, (time, x) in _component(com, axis).items()
        }
        for axis, name in enumerate(AXES)
    }
    rows["heading [deg]"] = {label: (time, np.rad2deg(each)) for label, (time, each) in heading.items()}
    return _rows(records, rows, "Centre of mass and heading")


def strain(records: Records) -> tuple[Figure, Axes] | None:
    """Draw the strain of each segment over time, with the head at the top."""
    known = _series(records, "strain")
    most = max((each.shape[1] for _, each in known.values()), default=0)
    shown = sorted(set(np.linspace(0, most - 1, min(most, MOST_ROWS)).round().astype(int).tolist()), reverse=True)
    rows = {f"segment {k}": _component(known, k) for k in shown}
    return _rows(records, rows, "Strain of the segments (0 = tail)", same=True)


def markers(records: Records) -> tuple[Figure, Axes] | None:
    """Draw the coordinates of the markers over time."""
    tracks = {label: _tracks(record, records) for label, record in records.items()}
    rows: dict[str, Curves] = {}
    for name in dict.fromkeys(name for found in tracks.values() for name in found if name != "com"):
        places = {label: (records[label]["time"], found[name]) for label, found in tracks.items() if name in found}
        rows |= {f"{name},\n{letter} [m]": _component(places, axis) for axis, letter in enumerate(AXES)}
    return _rows(records, rows, "Markers")


def energy(records: Records) -> tuple[Figure, Axes] | None:
    """Draw the main terms of the energy balance, cumulative over the run."""
    known = {name: _series(records, name) for name in DRAWN_ENERGIES}
    rows = {
        f"{name.replace('_', ' ')} [J]": {label: (time, np.cumsum(each)) for label, (time, each) in found.items()}
        for name, found in known.items()
        if any(np.any(each) for _, each in found.values())
    }
    return _rows(records, rows, "Energy, summed over the run")


def single_numbers(records: Records) -> tuple[Figure, Axes] | None:
    """Draw all quantities that have a single number per instant in a measurement, such as a force."""
    rows = {
        f"{name.replace('_', ' ')} [{unit}]": {
            label: (time, each) for label, (time, each) in _series(records, name).items() if each.ndim == 1
        }
        for name, unit in _numbers(records).items()
    }
    return _rows(records, rows, "Over time")


def force_and_cable(records: Records) -> tuple[Figure, Axes] | None:
    """Draw the force in a cable over the length of cable taken in."""
    known = {
        label: (1e3 * cable, force)
        for label, record in records.items()
        if (cable := _values(record, "cable")) is not None and (force := _values(record, "force")) is not None
        if cable.ndim == force.ndim == 1
    }
    if not known:
        return None
    figure, axes = _figure(6.4, 4.8)
    for number, label in enumerate(records):
        if label in known:
            axes.plot(*known[label], **_style(records[label], number), label=label)
    axes.set(xlabel="cable taken in [mm]", ylabel="force [N]", title="Force and cable")
    axes.legend(fontsize=8)
    return figure, axes


OVERLAYS: dict[str, Overlay] = {
    each.__name__: each
    for each in (path, centre_of_mass_and_heading, strain, markers, energy, single_numbers, force_and_cable)
}
"""Functions that draw the figures, by the name of the file without the ending."""


def drawn(records: Records) -> Iterator[tuple[str, Figure]]:
    """Yield the figures whose data the records contain, each with the name of the file without the ending."""
    for stem, draw in OVERLAYS.items():
        if (found := draw(records)) is not None:
            yield stem, found[0]


def measured_pictures(record: Record) -> Pictures:
    """Return the figures whose data a measurement contains."""
    present = [stem for stem, draw in OVERLAYS.items() if draw({record.title: record}) is not None]
    figures: dict[str, Draw] = {f"measured_{stem}": partial(_of_one, OVERLAYS[stem]) for stem in present}
    page = view if is_shown(record) else None
    if page is not None:
        figures["measured_chambers"] = chambers
    return Pictures(name=measured.MEASURED_MODEL, title="a measurement", figures=figures, overview=None, view=page)


def _of_one(draw: Overlay, record: Record) -> tuple[Figure, Axes]:
    found = draw({record.title: record})
    assert found is not None
    return found


def _values(record: Record, name: str) -> FloatArray | None:
    """Return the values of a quantity at the stored instants of a record, or None for a record without the quantity."""
    found = measured.series_of(record).get(name)
    return None if found is None else np.asarray(found.values, dtype=float)


def _series(records: Records, name: str) -> Curves:
    """Return a quantity over time for the records with this quantity. The values have the shape (T, ...)."""
    found = {label: _values(record, name) for label, record in records.items()}
    return {label: (records[label]["time"], values) for label, values in found.items() if values is not None}


def _component(curves: Curves, k: int) -> Curves:
    """Return component k of curves with values of shape (T, K), without the curves that have no finite value."""
    return {
        label: (time, values[:, k])
        for label, (time, values) in curves.items()
        if k < values.shape[1] and np.isfinite(values[:, k]).any()
    }


def _numbers(records: Records) -> dict[str, str]:
    """Return the quantities that have a single number per instant in a measurement, with their units."""
    return {
        name: variable.units
        for record in records.values()
        if measured.is_measured(record)
        for name, variable in measured.series_of(record).items()
        if variable.dims == ("time",) and name not in SEPARATE_QUANTITIES
    }


def _tracks(record: Record, records: Records) -> dict[str, FloatArray]:
    """Return the positions of the centre of mass and the markers of a record, by name.

    The positions have the shape (T, 2) or (T, 3) [m]. For a simulation, the markers are the markers of the measurements
    in `records`.
    """
    own = measured.series_of(record)
    found = {"com": np.asarray(own["com"].values, dtype=float)} if "com" in own else {}
    for other in records.values():
        for name, variable in measured.series_of(other).items():
            if name.startswith(MARKER) and name not in found:
                with suppress(SceneError):
                    found[name] = measured.counterpart(record, other, variable)
    return {name.removeprefix(MARKER): places for name, places in found.items()}


def _figure(wide: float, high: float) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(wide, high), layout="constrained", dpi=120)
    axes = figure.subplots()
    axes.grid(alpha=0.3)
    return figure, axes


def _style(record: Record, number: int) -> dict[str, Any]:
    """Return the style of the curves of a record. The colour depends on the number of the record in the figure."""
    dots: dict[str, Any] = {"ls": "", "marker": ".", "ms": 3} if measured.is_measured(record) else {"lw": 1.4}
    return {"color": f"C{number}", **dots}


def _rows(
    records: Records, rows: Mapping[str, Curves], title: str, *, same: bool = False
) -> tuple[Figure, Axes] | None:
    """Draw curves over time, with a panel for each entry of `rows`, by the label of the vertical axis.

    If `same` is true, all panels have the same vertical range.
    """
    from matplotlib.figure import Figure

    filled = {label: curves for label, curves in rows.items() if curves}
    shown = dict(list(filled.items())[:MOST_ROWS])
    if not shown:
        return None
    figure = Figure(figsize=(7.2, 1.0 + max(1.5, 2.6 - 0.2 * len(shown)) * len(shown)), layout="constrained", dpi=120)
    panels = np.ravel(figure.subplots(len(shown), 1, sharex=True, sharey=same))
    for axes, (label, curves) in zip(panels, shown.items(), strict=True):
        for number, name in enumerate(records):
            if name in curves:
                axes.plot(*curves[name], **_style(records[name], number), label=name)
        axes.set_ylabel(label, fontsize=8)
        axes.grid(alpha=0.3)
        low, high = axes.get_ylim()
        if high - low < LEAST_RANGE:
            axes.set_ylim((low + high - LEAST_RANGE) / 2, (low + high + LEAST_RANGE) / 2)
    handles = {text: line for axes in panels for line, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles, fontsize=8, loc="outside upper right", ncols=min(len(handles), 3))
    more = f" ({len(shown)} of {len(filled)})" if len(filled) > len(shown) else ""
    figure.suptitle(f"{title}{more}", fontsize=10, x=0.02, ha="left")
    panels[-1].set_xlabel("time [s]")
    return figure, panels[-1]
