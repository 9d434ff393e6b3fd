"""Recorded rows at instants between the ends of steps: values are interpolated, recorded, and restored.

Positions lie on the cubic through the positions and velocities at both ends of a step. All other values are
interpolated linearly. Sums since the previous row grow linearly within a step, so that the energy ledger of a row has
no larger residual than the ledger of the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine import vectors
from worm3d.machine.compiled import inner
from worm3d.machine.later import carray
from worm3d.machine.vectors import doubles_at
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import Block, address, combine, integers, matrix, rows, vector
from worm3d.solver.records import BEFORE, CURVED, NOW, REGIONS, SUMS, gather, record


@inner
def keep(records: Block, to: int) -> None:
    """Copy all regions of the core from which rows are recorded to the array `to` (`BEFORE` or `NOW`)."""
    for r in range(matrix(records, REGIONS).shape[0]):
        here, size, at = _region(records, r)
        vectors.move(address(records, to, 0) + 8 * at, here, size)


@inner
def write(core: Core, records: Block, row: int, share: float, h: float) -> None:
    """Write the row of an instant within the last finished step.

    `share` is the elapsed fraction of the step at this instant, and h is the length of the step [s].
    """
    if share >= 1.0 - 1e-9:
        record(core, records, row)
        return
    keep(records, NOW)
    before, now = vector(records, BEFORE), vector(records, NOW)
    regions = matrix(records, REGIONS).shape[0]
    _bend(core, a.JOINTS, a.JOINT_VELOCITY, share, h)
    _bend(core, a.POINTS_PAST, a.POINT_VELOCITY, share, h)
    for r in range(CURVED, regions):
        here, size, at = _region(records, r)
        values = carray(doubles_at(here), (size,))
        combine(values, 1.0 - share, before[at : at + size], share, values)
    gather(core, records, row)
    for r in range(regions):
        here, size, at = _region(records, r)
        if r >= regions - SUMS:  # this row now contains a part of the sums, which is subtracted from both ends
            values = carray(doubles_at(here), (size,))
            for sums in (before, now):
                combine(sums[at : at + size], 1.0, sums[at : at + size], -1.0, values)
        vectors.move(here, address(records, NOW, 0) + 8 * at, size)


@inner
def _region(records: Block, r: int) -> NDArray[np.int64]:
    """Return the address and the size of a region, and the position of its copy."""
    return integers(address(records, REGIONS, r), 3)


@inner
def _bend(core: Core, places: int, velocities: int, share: float, h: float) -> None:
    """Replace the positions at the end of a step by positions on the cubic, at the fraction `share` of the step."""
    x, x_n = rows(core.block, places, 0, 3), rows(core.block, places, 3, 3)
    v, v_n = rows(core.block, velocities, 0, 3), rows(core.block, velocities, 3, 3)
    left = 1.0 - share
    for k in range(len(x)):
        moved = x[k] - x_n[k]
        bend = left * (h * v_n[k] - moved) - share * (h * v[k] - moved)
        x[k] = x_n[k] + share * (moved + left * bend)
