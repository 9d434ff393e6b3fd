"""Parts of a step, each in a compiled loop of its own, so that they can be timed."""

from __future__ import annotations

from worm3d.machine.banded_lu import lu_factor, lu_solve
from worm3d.machine.codegen import evaluate as run
from worm3d.machine.compiled import njit
from worm3d.solver import arrays as a
from worm3d.solver import fronts, ledger, regimes
from worm3d.solver.advance import actuate
from worm3d.solver.arrays import Core
from worm3d.solver.block import Block, copy, matrix, vector
from worm3d.solver.entry import reset
from worm3d.solver.evaluate import LOCAL, WHOLE, evaluate, hold
from worm3d.solver.newton import _newton_step
from worm3d.solver.records import record
from worm3d.solver.step import _commit, begin, place_start
from worm3d.values.arrays import FloatArray


@njit
def ready(core: Core, dt: float) -> None:
    """Begin a step by BDF2, go as far as Newton's first direction, and keep the ledger of that."""
    place_start(core)
    begin(core, dt, True)
    regimes.last(core)
    _newton_step(core, WHOLE, False)
    ledger.prepare(core)
    ledger.add(core, vector(core.block, a.TERMS_))


@njit
def evaluate_loop(core: Core, hessian: int, times: int) -> None:
    """Compute potential, gradient and perhaps band: the kernels."""
    for _ in range(times):
        evaluate(core, a.X, True, hessian)


@njit
def exchange_loop(core: Core, times: int) -> None:
    """Compute the residual, and exchange what a contact in the middle of the body contributes to the band."""
    for _ in range(times):
        vector(core.block, a.CHANGED)[core.n // 2] = 1.0
        evaluate(core, a.X, True, LOCAL)


@njit
def linear_loop(core: Core, first: int, times: int) -> None:
    """Solve for the direction as Newton does, with factors that are made anew from this row on; -1: none is."""
    factor, step = matrix(core.block, a.FACTOR), vector(core.block, a.DIRECTION)
    for _ in range(times):
        hold(core, first >= 0)
        copy(step, vector(core.block, a.GRADIENT))
        if first >= 0:
            lu_factor(matrix(core.block, a.BAND), factor, first)
        lu_solve(factor, step)


@njit
def ahead_loop(core: Core, times: int) -> None:
    """Ask what contacts do next, in an iteration; the error is so large that nothing changes."""
    for _ in range(times):
        regimes.look_ahead(core, vector(core.block, a.DIRECTION), 1e9)
        regimes.change(core, regimes.lands(core))


@njit
def expect_loop(core: Core, times: int) -> None:
    """Take contacts for what is expected of them before the first iteration, and note what they have done."""
    for _ in range(times):
        regimes.last(core)
        fronts.expect(core)
        fronts.note(core)


@njit
def start_loop(core: Core, command: FloatArray, dt: float, times: int) -> None:
    """Do everything before Newton."""
    for _ in range(times):
        actuate(core, command, dt)
        place_start(core)
        begin(core, dt, True)


@njit
def end_loop(core: Core, times: int) -> None:
    """Renew histories, anchors and directors after the step."""
    for _ in range(times):
        _commit(core)


@njit
def ledger_loop(core: Core, times: int) -> None:
    """Keep the energy ledger."""
    for _ in range(times):
        ledger.prepare(core)
        ledger.add(core, vector(core.block, a.TERMS_))


@njit
def record_loop(core: Core, records: Block, times: int) -> None:
    """Write a row of the result."""
    for _ in range(times):
        reset(core)
        record(core, records, 1)


@njit
def kernel_loop(address: int, inputs: FloatArray, outputs: FloatArray, count: int, times: int) -> None:
    """Run one kernel."""
    for _ in range(times):
        run(address, inputs, outputs, count)
