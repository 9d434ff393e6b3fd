"""Faults of a run as rows of its summary: what the controller found, and what the plant knows."""

from __future__ import annotations

from collections import Counter
from itertools import groupby
from operator import itemgetter

import worm3d
from control.guest import Guest
from control.loop import Decision, WaveController
from control.planning.mpc import PlanStatus
from control.sensing.gate import Gate
from control.sensing.sensors import QUANTITIES
from control.supervisor import MOST_SHIFTED
from scenes.records.record import Cell
from worm3d.recorded.estimate import ROUGH, rough

Row = dict[str, Cell]
"""`time_s` [s], when it was found, `kind`, `what` and `advice`."""

SOLVERS = {status.value for status in PlanStatus}
"""Ends of a search that the fallback is made for; if it does not help for long, that is a fault."""


def of_plant(result: worm3d.Result) -> list[Row]:
    """Return what the plant knows that no controller has to tell."""
    since, error, found = result.on_its_side, result.error_estimate, []
    if since is not None:
        advice = "what it does then is not what its gait means: ask for gentler turns, less slope or less of a push"
        found.append(_row(since, "on its side", "the worm lies on its side", advice))
    if error is not None and not error.met:
        advice = (
            ROUGH if rough(result) else "small causes decide here: ask for less, or take the mean of several starts"
        )
        found.append(_row(float(result.time[-1]), "not accurate", error.sentence, advice))
    return found


def of_controller(controller: WaveController) -> list[Row]:
    """Return what a controller found, and what became of its measurements and plans."""
    found = [_row(fault.time, fault.kind, fault.what, fault.advice) for fault in controller.faults]
    plans = [] if isinstance(controller, Guest) else _of_plans(controller.decisions)  # a guest has no fallback
    return [*found, *plans, *_of_gate(controller.gate)]


def in_turn(rows: list[Row]) -> list[Row]:
    """Return rows in the order of their times."""
    return sorted(rows, key=itemgetter("time_s"))


def refused(controller: WaveController) -> int:
    """Return how many samples the gate and the estimator refused."""
    last = controller.decisions[-1].estimate if controller.decisions else None
    return controller.gate.refused.total() + (last.refused if last is not None else 0)


def _of_plans(decisions: list[Decision]) -> list[Row]:
    failed: Counter[str] = Counter(decision.status for decision in decisions if decision.failed)
    runs = [list(run) for bad, run in groupby(decisions, key=lambda each: each.failed) if bad]
    lasting = {run[0].status for run in runs if len(run) > MOST_SHIFTED}
    first = {decision.status: decision.time for decision in reversed(decisions) if decision.failed}
    return [
        _row(
            first[reason], "no plan", f"{_times(count)} no plan could be used: {reason}", "the fallback drove the worm"
        )
        for reason, count in failed.items()
        if reason not in SOLVERS or reason in lasting
    ]


def _of_gate(gate: Gate) -> list[Row]:
    advice = "look at the sensor, its wiring and its clock"
    return [
        _row(
            gate.first[name, why],
            f"refused {name}",
            f"{_times(count)} the {QUANTITIES[name].meaning} came {why.value}",
            advice,
        )
        for (name, why), count in gate.refused.items()
    ]


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _row(time: float, kind: str, what: str, advice: str) -> Row:
    return {"time_s": time, "kind": kind, "what": what, "advice": advice}
