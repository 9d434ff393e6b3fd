"""Records of a run: a row for every recorded instant.

The declarations in `worm3d.recorded.series` determine which numbers of a core's arrays fill a row. Python turns the
declarations into a plan, and compiled code executes the plan. An entry of the plan copies a block of numbers with
i < count_i, j < count_j, k < count_k:

    row[(i count_j + j) count_k + k] = source[i step_i + j step_j + k step_k]
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import accumulate
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from worm3d.machine import vectors
from worm3d.machine.compiled import inner, njit
from worm3d.machine.later import carray
from worm3d.machine.vectors import doubles_at
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.physics.worm import Worm
from worm3d.recorded.energy import TERMS
from worm3d.recorded.series import (
    Entries,
    Points,
    Recorded,
    Rows,
    Series,
    Source,
    part_classes,
    series_of,
    states_of_parts,
)
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core, CoreMemory
from worm3d.solver.block import Block, Memory, Plan, address, fill, integers, matrix, vector
from worm3d.solver.entry import run
from worm3d.values.arrays import FloatArray

STATE_PREFIX = "actuator_"
"""Prefix of the names of the actuators' states."""

PLAN, MOMENTA, REGIONS, BEFORE, NOW = range(5)
"""Arrays of the block of records other than the series: the plan; momentum, angular momentum and centre of mass; the
regions of the core's memory from which rows are filled; and copies of the regions at the start and at the end of a
step. Regions and copies are only used for rows between the ends of steps (`worm3d.solver.between`)."""
CURVED, SUMS = 2, 2
"""Number of regions at the beginning that contain positions, and at the end that contain sums since the previous row.
"""
MOMENTUM_SIZE = 9

ENTRY = 9
"""Numbers in an entry of the plan: addresses of the source and of the first row, width of a row, counts, steps."""


class _Piece(NamedTuple):
    """An entry of the plan whose source is given by the name of an array."""

    array: str
    first: int
    """Index of the first number in the array."""
    counts: tuple[int, int, int]
    steps: tuple[int, int, int]
    to: int = 0
    """Index of the first number in the row."""


class _Form(NamedTuple):
    """Common layout of the records of worms with the same kinds of parts."""

    shapes: dict[str, tuple[int, ...]]
    """Shape of each series at one instant."""
    plan: Plan
    entries: NDArray[np.int64]
    """Entries of the plan. Positions of sources are relative to the memory of the core or of the records, positions of
    rows to the memory of the records."""
    own: NDArray[np.bool_]
    """Whether the source of each entry is in the memory of the records."""
    regions: NDArray[np.int64]
    """Beginning of each region in the core's memory, its size, and the beginning of its copies."""


@lru_cache
def _form(sizes: a.Sizes, parts: tuple[Any, ...], clamped: bool, rows: int, between: bool) -> _Form:
    declared = {name: series for name, series in series_of(Recorded).items() if series.source is not None}
    declared |= {STATE_PREFIX + name: series for name, series in states_of_parts(*parts).items()}
    shapes = {name: series.shape(sizes.n) for name, series in declared.items()} | {"energy": (len(TERMS),)}
    core = a.plan(sizes).places()
    pieces = {name: _pieces(series, clamped, sizes.n, core) for name, series in declared.items()}
    pieces["energy"] = [_Piece("terms", 0, (len(TERMS), 1, 1), (1, 0, 0))]
    regions = np.array(_regions(declared, clamped, sizes.n, core) if between else [], dtype=np.int64).reshape(-1, 3)
    total = int(regions[:, 1].sum())
    kept = [(sum(map(len, pieces.values())), ENTRY), (1, MOMENTUM_SIZE), regions.shape, (1, total), (1, total)]
    kept += [(rows, prod(shape)) for shape in shapes.values()]
    plan = Plan.of(("plan", "momenta", "regions", "before", "now", *shapes), kept)
    here, own, entries = plan.places(), [], []
    for name, parts_of in pieces.items():
        for array, first, counts, steps, to in parts_of:
            own.append(array not in core)
            begin = (here if own[-1] else core)[array][0]
            entries.append([8 * (begin + first), 8 * (here[name][0] + to), here[name][2], *counts, *steps])
    return _Form(shapes, plan, np.array(entries), np.array(own), regions)


class Records:
    """Series of a run in progress, with their addresses for compiled code.

    Parameters
    ----------
    core : CoreMemory
        Core whose arrays are read whenever a row is written.
    worm : Worm
    clamped : bool
        Whether the ground is the clamped ground of the paper.
    rows : int
        Number of instants. The memory is not cleared; `record` writes every number of a row.
    between : bool
        Whether instants may lie between the ends of steps.
    """

    def __init__(self, core: CoreMemory, worm: Worm, clamped: bool, rows: int, between: bool = False) -> None:
        self._core = core
        form = _form(core.sizes, part_classes(worm), clamped, rows, between)
        self._shapes, self._memory = form.shapes, Memory(form.plan, cleared=False)
        self.block, own = self._memory.block, self._memory.arrays()
        plan, there, here = own["plan"].view(np.int64), core.core.block.memory, self.block.memory
        plan[:] = form.entries
        plan[:, 0] += np.where(form.own, here, there)
        plan[:, 1] += here
        own["regions"].view(np.int64)[:] = form.regions + np.array([there, 0, 0])

    def arrays(self, rows: slice = slice(None)) -> dict[str, FloatArray]:
        """Return views of rows of each series, and of the energy ledger, by name."""
        found = {name: array[rows] for name, array in self._memory.arrays().items() if name in self._shapes}
        return {name: array.reshape(len(array), *self._shapes[name]) for name, array in found.items()}

    def fields(self, rows: slice) -> dict[str, Any]:
        """Return rows of each series as fields of `Recorded`, and rows of the energy ledger."""
        found, states = {}, {}
        for name, array in self.arrays(rows).items():
            if name.startswith(STATE_PREFIX):
                states[name.removeprefix(STATE_PREFIX)] = array
            else:
                found[name] = array
        return {**found, "actuator_states": states}


def _pieces(series: Series, clamped: bool, n: int, core: Mapping[str, list[int]]) -> list[_Piece]:
    """Return the entries of the plan for a series."""
    source, shape = _source(series, clamped), series.shape(n)
    if isinstance(source, Entries):
        first = source.first + source.first_per_segment * n
        return [_Piece(source.array, first, (prod(shape), 1, 1), (source.step, 0, 0))]
    columns = core[source.array][2]
    if not isinstance(source, Points):
        return [_Piece(source.array, _row(source) * columns, (shape[0], 1, prod(shape[1:])), (1, 0, columns))]
    lanes = core["rest"][2]
    first, steps = _row(source) * POINTS_PER_SEGMENT * lanes, (1, lanes, POINTS_PER_SEGMENT * lanes)
    if series.dims[1] == "segment":
        return [_Piece(source.array, first, (n, shape[1], prod(shape[2:])), steps)]
    # a joint is the tail face of its segment; the last joint is the head face of the last segment
    tail, head = POINTS_PER_SEGMENT - 2, POINTS_PER_SEGMENT - 1
    return [
        _Piece(source.array, first + tail * lanes, (n, 1, 1), steps),
        _Piece(source.array, first + head * lanes + n - 1, (1, 1, 1), steps, to=n),
    ]


def _regions(
    declared: Mapping[str, Series], clamped: bool, n: int, core: Mapping[str, list[int]]
) -> list[tuple[int, int, int]]:
    """Return beginning, size and position of the copy of each region, with positions first and sums last."""
    first, last = [("joints", 0, 3), ("points", 0, 3)], [("slid", 0, POINTS_PER_SEGMENT), ("terms", 0, 1)]
    found = dict.fromkeys([*first, ("joint_velocity", 0, 3), ("point_velocity", 0, 3)])
    for series in declared.values():
        source = _source(series, clamped)
        if isinstance(source, Rows):
            axes = series.shape(n)[2 if isinstance(source, Points) else 1 :]
            found[source.array, _row(source), prod(axes)] = None
        elif source.array in core:
            found[source.array, 0, 1] = None
    parts = [part for part in found if part[0] != "slid"] + last
    begins = [8 * (core[name][0] + row * core[name][2]) for name, row, _ in parts]
    sizes = [count * core[name][2] for name, _, count in parts]
    return list(zip(begins, sizes, accumulate(sizes, initial=0), strict=False))


def _source(series: Series, clamped: bool) -> Source:
    source = series.clamped if clamped and series.clamped is not None else series.source
    assert source is not None
    return source


def _row(source: Rows) -> int:
    return a.ARRAYS[source.array].first(source.row)


@njit
def record(core: Core, records: Block, row: int) -> None:
    """Write a row, and restart the sums for the next row."""
    gather(core, records, row)
    fill(vector(core.block, a.TERMS_), 0.0)
    fill(vector(core.block, a.SLID), 0.0)


@njit
def gather(core: Core, records: Block, row: int) -> None:
    """Write a row."""
    momenta = vector(records, MOMENTA)
    _momenta(core, momenta[:6], momenta[6:])
    for entry in range(matrix(records, PLAN).shape[0]):
        source, to, width, i, j, k, step_i, step_j, step_k = integers(address(records, PLAN, entry), ENTRY)
        to += 8 * width * row
        if j == POINTS_PER_SEGMENT and k == 3:
            _places(core, source, to)
        elif step_i == 1 and j * k == 1:
            vectors.move(to, source, i)
        else:
            _gather(source, to, i, j, k, step_i, step_j, step_k)


@inner
def _gather(
    source: int, to: int, count_i: int, count_j: int, count_k: int, step_i: int, step_j: int, step_k: int
) -> None:
    here = carray(doubles_at(source), (1 + count_i * step_i + count_j * step_j + count_k * step_k,))
    there, at = carray(doubles_at(to), (count_i * count_j * count_k,)), 0
    for i in range(count_i):
        for j in range(count_j):
            for k in range(count_k):
                there[at] = here[i * step_i + j * step_j + k * step_k]
                at += 1


@inner
def _places(core: Core, rows: int, to: int) -> None:
    """Write three rows of the points (x, y, z), which begin at the address `rows`, to `to` in the order (N, 8, 3)."""
    lanes, turned = matrix(core.block, a.SEGMENT_SHAPE_OUT).shape[1], address(core.block, a.TRANSPOSED_RECORDS, 0)
    for i in range(0, core.n, vectors.VECTOR_WIDTH):
        vectors.transpose_places(turned + 8 * 3 * POINTS_PER_SEGMENT * i, 3 * POINTS_PER_SEGMENT, rows + 8 * i, lanes)
    vectors.move(to, turned, 3 * POINTS_PER_SEGMENT * core.n)


def mass_centre(core: Core) -> tuple[FloatArray, FloatArray]:
    """Return linear and angular momentum, shape (6,), and the centre of mass, shape (3,)."""
    momentum, com = np.zeros(6), np.zeros(3)
    _momenta(core, momentum, com)
    return momentum, com


@njit
def _momenta(core: Core, momentum: FloatArray, com: FloatArray) -> None:
    """Compute the momentum, angular momentum and centre of mass of all mass points together."""
    points = matrix(core.block, a.POINT_IN).shape[1]
    fill(momentum, 0.0)
    fill(com, 0.0)
    run(core, a.POINT_MOMENTA, a.POINT_IN, a.MOMENTA_OUT, points)
    _add_sums(core, points, momentum, com)
    run(core, a.NODE_MOMENTA, a.NODE_IN, a.MOMENTA_OUT, core.n + 1)
    _add_sums(core, core.n + 1, momentum, com)
    for d in range(3):
        com[d] /= vector(core.block, a.NUMBERS_)[a.MASS]


@inner
def _add_sums(core: Core, count: int, momentum: FloatArray, com: FloatArray) -> None:
    """Add the sums over the outputs of a kernel: momenta, and mass times position."""
    sums, lanes = vector(core.block, a.SUMS), matrix(core.block, a.MOMENTA_OUT).shape[1]
    vectors.totals(address(core.block, a.SUMS, 0), address(core.block, a.MOMENTA_OUT, 0), lanes, count)
    for k in range(6):
        momentum[k] += sums[k]
    com[0] += sums[6]
    com[1] += sums[7]
    com[2] += vectors.total(address(core.block, a.MOMENTA_OUT, vectors.VECTOR_WIDTH), count)
