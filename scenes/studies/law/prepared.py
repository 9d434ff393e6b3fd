"""States for the fit of a law, from a table of finite elements, of bench states, or of measured cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from scenes.language.errors import SceneError
from scenes.studies.law import bench
from scenes.studies.law.bench import Cycle
from scenes.studies.law.free import BoolArray, States
from scenes.studies.law.surface import Spline, Surface
from scenes.studies.law.table import Table
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

FEWEST_STATES = 40
"""Least number of states for a fit. A membrane in closed form needs 30 of them for an error of the force of 1 %."""

SPREAD_STATES = 150
"""Number of states to which the law is fitted if the elastic force is a known curve."""

EVEN_STEPS = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps, modulo 1, of points that fill a square evenly: powers of the inverse of the plastic number."""

LEVEL_STATES = 28
"""Number of states at each input of a record of cycles."""

STRAIGHT = 1e-6
"""Greatest bend of a state that counts as straight [rad]."""


@dataclass(frozen=True, eq=False)
class Prepared(ReadOnly):
    """States of a segment, and what is known about the segment."""

    table: Table
    states: States
    notes: tuple[str, ...] = ()
    """Sentences about assumptions."""
    cycle: Cycle | None = None
    """Friction and elastic force of a record of cycles."""
    bent: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    """Length [m], input, bend [rad] and moment [N m] of bent states, shape (B, 4)."""


def prepared(table: Table) -> Prepared:
    """Return the states of a table.

    Raises
    ------
    SceneError
        There are too few states, or a fact is missing.
    """
    record = bench.record_of(table)
    if record is not None:
        return _of_cycle(table, bench.fit_cycle(record))
    columns = table.columns
    if "length" not in columns:
        raise SceneError(
            "column 'cable' has a length of cable, but the rows are no cycle, must go there and back at least once; "
            "give the column length_m, or a record of a whole cycle in the order of time"
        )
    bend = columns.get("bend", np.zeros(len(table)))
    straight = np.abs(bend) <= STRAIGHT
    states = _require_enough(_states(table, straight))
    moment = columns.get("moment", np.full(len(table), np.nan))
    known = ~straight & np.isfinite(moment)
    bent = np.column_stack([columns["length"], table.input, bend, moment])[known]
    notes = _radius_note(table)
    if states.input.max() > states.input.min():
        return Prepared(table, states, notes, bent=bent)
    low, high = float(states.length.min()), float(states.length.max())
    flat = Spline(0.0, 1.0, 1)
    curve = Surface.fitted(Spline(low, high, 12), flat, states.length, 0.0 * states.length, states.force)
    elastic, lever = (lambda at: curve.at(at, 0.0 * at)), (lambda at: -np.ones(len(at)))
    expanded = _under_cable(table, elastic, (low, high), lever)
    return Prepared(table, expanded, (*notes, AXIAL_NOTE), bent=bent)


AXIAL_NOTE = "The states have one input. The law has the force of a cable along the axis as its input."
HOOP_NOTE = "The law's input is the force of the hoop cable, with the lever of a rhombus of inextensible links."


def _states(table: Table, rows: BoolArray) -> States:
    """Return the chosen rows as states."""
    columns = {name: values[rows] for name, values in table.columns.items()}
    length, level = columns["length"], table.input[rows]
    radius = columns["radius"] if "radius" in columns else _radii(table, length, level)
    return States(length, level, columns["force"], radius, columns.get("volume"))


def _radii(table: Table, length: FloatArray, level: FloatArray) -> FloatArray:
    """Return radii at other lengths and inputs: a smooth surface through measured radii, or a constant volume."""
    if "radius" not in table.columns:
        found: FloatArray = table.fact("rest_radius_m") * np.sqrt(table.fact("rest_length_m") / length)
        return found
    measured = [table.columns["length"], table.input]
    along, across = (Spline(float(each.min()), float(each.max()), 4 if np.ptp(each) else 1) for each in measured)
    return Surface.fitted(along, across, measured[0], measured[1], table.columns["radius"]).at(length, level)


def _radius_note(table: Table) -> tuple[str, ...]:
    if "radius" in table.columns:
        return ()
    return ("The table has no radius. The radius follows from the rest radius and a constant volume.",)


def _require_enough(states: States) -> States:
    if len(states) < FEWEST_STATES:
        raise SceneError(
            f"got {len(states)} straight states that can be used, must be {FEWEST_STATES} or more; add states, 100 are "
            "a good number"
        )
    return states


def _of_cycle(table: Table, cycle: Cycle) -> Prepared:
    """Return states on a grid, from the elastic force of a record of cycles."""
    record, spline = cycle.record, cycle.spline
    hoop = "length" not in table.columns
    notes = _radius_note(table)
    if len(record.inputs) > 1:
        rows = [_level(cycle, k) for k in range(len(record.inputs))]
        length, level, force = (np.concatenate(each) for each in zip(*rows, strict=True))
        states = States(length, level, force, _radii(table, length, level), None)
        return Prepared(table, _require_enough(states), notes, cycle)

    def lever(length: FloatArray) -> FloatArray:
        return record.lever(length) if hoop else -np.ones(len(length))

    states = _under_cable(table, lambda length: cycle.force(length, 0), (spline.low, spline.high), lever)
    if hoop:
        states = replace(states, radius=record.height(states.length))
    return Prepared(table, states, (HOOP_NOTE,) if hoop else (*notes, AXIAL_NOTE), cycle)


def _level(cycle: Cycle, level: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return lengths, inputs and elastic forces of one input of a record, each of shape (LEVEL_STATES,)."""
    own = cycle.record.length[cycle.record.level == level]
    length = np.linspace(own.min(), own.max(), LEVEL_STATES)
    return length, np.full(len(length), cycle.record.inputs[level]), cycle.force(length, level)


def _under_cable(
    table: Table,
    elastic: Callable[[FloatArray], FloatArray],
    lengths: tuple[float, float],
    lever: Callable[[FloatArray], FloatArray],
) -> States:
    """Return states of a segment with a known elastic force under a cable, F = P(l) - T du/dl, spread evenly.

    The greatest cable force T has its free length at the end of the measured lengths.
    """
    length = np.linspace(*lengths, 50)
    balance = elastic(length) / lever(length)
    most = float(balance.max())
    if most <= 0.0:
        raise SceneError(
            f"without an input, the force must change its sign at the rest length; got {elastic(length).min():.3g} to "
            f"{elastic(length).max():.3g} N; measure lengths below the rest length, or give the column of the input"
        )
    spread = (0.5 + np.arange(SPREAD_STATES)[:, None] * EVEN_STEPS) % 1.0
    unit = np.vstack([spread, [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]])
    at, tension = lengths[0] + np.ptp(lengths) * unit[:, 0], most * unit[:, 1]
    return States(at, tension, elastic(at) - tension * lever(at), _radii(table, at, 0.0 * at), None)
