"""Measures of the work and the energy input of actuators."""

from __future__ import annotations

from functools import partial

import numpy as np

from worm3d.measures.general import carried
from worm3d.measures.table import NoValueError, measure
from worm3d.measures.waves import waves_of
from worm3d.recorded.finished import FinishedRun


@measure("effort", "rms of the contraction that chambers give, as a fraction of their stroke")
def _effort(result: FinishedRun) -> float:
    """Return the rms of c + f/(k/2) over the largest stroke. An extra force f counts as a contraction f/(k/2)."""
    waves, worm = waves_of(result), result.worm
    rows = slice(waves.first + 1, None)
    stiffness = np.asarray(worm.k_spring, dtype=float)[:, None] / 2.0
    given = result.contraction[rows] + result.force[rows] / stiffness
    stroke = max(abs(end) for end in worm.stroke)
    if stroke == 0.0:
        raise NoValueError("the chambers have no stroke")
    return float(np.sqrt(waves.mean((given**2).mean(axis=(1, 2))))) / stroke


@measure("commands_at_limit", "number of rows with a commanded contraction at an end of the stroke")
def _at_limit(result: FinishedRun) -> float:
    """Return the number of rows with a command at an end of the stroke. An end at 0, the rest position, is ignored."""
    worm = result.worm
    acting = worm.actuator.values(worm, hinge=False)
    least, greatest = (
        np.reshape(acting.get(name, end), (-1, 1)) for name, end in zip(("least", "greatest"), worm.stroke, strict=True)
    )
    low, high = (result.command <= least) & (least < 0.0), (result.command >= greatest) & (greatest > 0.0)
    return float((low | high).any(axis=(1, 2)).sum())


def _peak(result: FinishedRun, name: str) -> float:
    """Return the greatest input of the segment law in the run [Pa or N]."""
    table = result.worm.segment.input_table
    if table is None or table.name != name:
        raise NoValueError(f"the segment law has no {name}")
    return float(np.max(result.chamber_input))


measure("peak_pressure_Pa", "greatest pressure of a chamber, from the table of the segment law")(
    partial(_peak, name="pressure")
)
measure("peak_cable_N", "greatest force of a cable, from the table of the segment law")(partial(_peak, name="cable"))


@measure("work_input_J", "energy that the actuators drew from their sources of energy")
def _input(result: FinishedRun) -> float:
    actuator = result.worm.actuator
    if not actuator.has_source:
        name = actuator.name or type(actuator).__name__
        raise NoValueError(f"the actuator {name!r} has no source of energy, so that only its work is known")
    return float(result.energy.work_contract.sum())


@measure("cost_of_transport_input", "energy that the actuators drew, divided by (weight times distance)")
def _cost_of_input(result: FinishedRun) -> float:
    return _input(result) / carried(result)
