"""Faults that were detected during a run with a controller, as rows of the summary."""

from __future__ import annotations

from collections import Counter
from itertools import groupby
from operator import itemgetter

import numpy as np

import worm3d
from control.guest import Guest
from control.loop import MOST_KEPT, Decision, Driver
from control.planning.gauss_newton import PlanStatus
from control.sensing.gate import Gate
from control.sensing.sensors import QUANTITIES
from control.tracking.metrics import clearances
from control.tracking.references import Reference
from scenes.records.record import Cell, fault_row
from worm3d.values.arrays import FloatArray

Row = dict[str, Cell]

SOLVERS = {status.value for status in PlanStatus}
"""Results of the planner without a plan. The fallback handles them, so that only a long series of them is a fault."""


def of_controller(controller: Driver) -> list[Row]:
    """Return rows for the faults that a controller detected, for its failed plans and for rejected measurements."""
    found = [fault_row(fault.time, fault.kind, fault.what, fault.advice) for fault in controller.faults]
    plans = [] if isinstance(controller, Guest) else _of_plans(controller.decisions)  # a guest has no fallback
    return [*found, *plans, *_of_gate(controller.gate)]


def entered(result: worm3d.Result, outline: FloatArray | None, reference: Reference) -> list[Row]:
    """Return a row if the body was inside an obstacle.

    `outline` are the C corners of the true outline of the body, shape (T, C, 2) [m], or None without obstacles.
    """
    if outline is None:
        return []
    clear = clearances(outline, reference) / result.worm.length
    if clear.min() >= 0.0:
        return []
    what = f"the body is up to {-clear.min():.2g} body lengths inside an obstacle"
    advice = "ask for less speed or a wider way, or let a controller lead it that looks at its place"
    return [fault_row(float(result.time[np.argmax(clear < 0.0)]), "inside an obstacle", what, advice)]


def in_turn(rows: list[Row]) -> list[Row]:
    """Return the rows sorted by time."""
    return sorted(rows, key=itemgetter("time_s"))


def refused(controller: Driver) -> int:
    """Return the number of measurements that the gate or the estimator rejected."""
    last = controller.decisions[-1].estimate if controller.decisions else None
    return controller.gate.refused.total() + (last.refused if last is not None else 0)


def _of_plans(decisions: list[Decision]) -> list[Row]:
    failed: Counter[str] = Counter(decision.status for decision in decisions if decision.failed)
    runs = [list(run) for bad, run in groupby(decisions, key=lambda each: each.failed) if bad]
    lasting = {run[0].status for run in runs if len(run) > MOST_KEPT}
    first = {decision.status: decision.time for decision in reversed(decisions) if decision.failed}
    return [
        fault_row(
            first[reason], "no plan", f"{_times(count)} no plan could be used: {reason}", "the fallback drove the worm"
        )
        for reason, count in failed.items()
        if reason not in SOLVERS or reason in lasting
    ]


def _of_gate(gate: Gate) -> list[Row]:
    advice = "look at the sensor, its wiring and its clock"
    return [
        fault_row(
            gate.first[name, why],
            f"refused {name}",
            f"{_times(count)} the {QUANTITIES[name].meaning} came {why.value}",
            advice,
        )
        for (name, why), count in gate.refused.items()
    ]


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
