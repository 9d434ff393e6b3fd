"""Faults that a controller found, as rows of the summary of a run."""

from __future__ import annotations

from collections import Counter
from itertools import groupby
from operator import itemgetter

from control.guest import Guest
from control.loop import Decision, Driver
from control.planning.mpc import PlanStatus
from control.sensing.gate import Gate
from control.sensing.sensors import QUANTITIES
from control.supervisor import MOST_SHIFTED
from scenes.records.record import Cell, fault_row

Row = dict[str, Cell]

SOLVERS = {status.value for status in PlanStatus}
"""Ends of a search that the fallback is made for; if it does not help for long, that is a fault."""


def of_controller(controller: Driver) -> list[Row]:
    """Return what a controller found, and what became of its measurements and plans."""
    found = [fault_row(fault.time, fault.kind, fault.what, fault.advice) for fault in controller.faults]
    plans = [] if isinstance(controller, Guest) else _of_plans(controller.decisions)  # a guest has no fallback
    return [*found, *plans, *_of_gate(controller.gate)]


def in_turn(rows: list[Row]) -> list[Row]:
    """Return rows in the order of their times."""
    return sorted(rows, key=itemgetter("time_s"))


def refused(controller: Driver) -> int:
    """Return how many samples the gate and the estimator refused."""
    last = controller.decisions[-1].estimate if controller.decisions else None
    return controller.gate.refused.total() + (last.refused if last is not None else 0)


def _of_plans(decisions: list[Decision]) -> list[Row]:
    failed: Counter[str] = Counter(decision.status for decision in decisions if decision.failed)
    runs = [list(run) for bad, run in groupby(decisions, key=lambda each: each.failed) if bad]
    lasting = {run[0].status for run in runs if len(run) > MOST_SHIFTED}
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
