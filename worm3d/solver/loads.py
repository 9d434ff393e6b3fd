"""Loads on joints in a step: forces, regimes in Newton's method, and energy."""

from __future__ import annotations

import numpy as np

from worm3d.machine.banded import B
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import load, node, point, segment
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.physics.load import LOAD_FREE
from worm3d.recorded.energy import TERMS
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import matrix, vector
from worm3d.solver.entry import kernel, run
from worm3d.values.arrays import FloatArray

_DT, _SPAN, _RATIO, _LANDS = (list(load.SHARED_INPUTS).index(name) for name in ("dt", "span", "ratio", "lands"))
_OWN = sum(load.SHARED_INPUTS.values())
_X, _PAST, _VELOCITY, _TANGENT, _NORMAL, _REGIME, _KEPT = (
    sum(list(load.INPUTS_PER_LOAD.values())[:k]) for k in range(len(load.INPUTS_PER_LOAD))
)
"""Position of each input of the loads: first row = `_OWN` + this number times the number of loads."""
_OF_LOAD = np.array([TERMS.index(name) for name in load.LEDGER_TERMS])
_T_REF, _NODE_LANDS = segment.SEGMENT_LAYOUT.first("t_ref"), node.NODE_LAYOUT.first("lands")
_WORLD = point.POINT_LAYOUT.first("normal")
_COUNT = len(load.LEDGER_TERMS)


@inner
def loaded(core: Core) -> bool:
    """Return whether the worm has loads."""
    return kernel(core, a.LOAD_GRADIENT) != 0


@inner
def begin(core: Core, dt: float, span: float, ratio: float) -> None:
    """Fill the inputs of the loads that are known at the start of a step."""
    block, at = core.block, vector(core.block, a.LOADED)
    given, count, kept = matrix(block, a.LOAD_IN), len(at), vector(block, a.LOAD_STATES)
    joints, velocity, segments = matrix(block, a.JOINTS), matrix(block, a.JOINT_VELOCITY), matrix(block, a.SEGMENT_IN)
    points = matrix(block, a.POINT_IN)
    given[_DT, 0], given[_SPAN, 0], given[_RATIO, 0] = dt, span, ratio
    for k in range(count):
        j = int(at[k])
        for r in range(6):
            given[_OWN + _PAST * count + 6 * k + r, 0] = joints[r, j]
            given[_OWN + _VELOCITY * count + 6 * k + r, 0] = velocity[r, j]
        i, slot = min(j, core.n - 1), POINTS_PER_SEGMENT - 2 if j < core.n else POINTS_PER_SEGMENT - 1
        for d in range(3):
            given[_OWN + _TANGENT * count + 3 * k + d, 0] = segments[_T_REF + d, i]
            given[_OWN + _NORMAL * count + 3 * k + d, 0] = points[
                _WORLD + d, points.shape[1] // POINTS_PER_SEGMENT * slot + i
            ]
        given[_OWN + _REGIME * count + k, 0] = kept[k]
    for k in range(len(kept)):
        given[_OWN + _KEPT * count + k, 0] = kept[k]


@inner
def release(core: Core) -> None:
    """Set the regimes of all loads to `LOAD_FREE`, so that the positions determine the regimes."""
    given, count = matrix(core.block, a.LOAD_IN), len(vector(core.block, a.LOADED))
    for k in range(count):
        given[_OWN + _REGIME * count + k, 0] = LOAD_FREE


@inner
def _place(core: Core, x: FloatArray, share: float, step: FloatArray) -> None:
    """Set the positions of the loads' joints to the positions at x minus `share` times a step."""
    at, given = vector(core.block, a.LOADED), matrix(core.block, a.LOAD_IN)
    for k in range(len(at)):
        for d in range(3):
            r = BLOCK_SIZE * int(at[k]) + d
            given[_OWN + _X * len(at) + 3 * k + d, 0] = x[r] - share * step[r]


@inner
def add(core: Core, x: FloatArray, in_band: bool) -> float:
    """Add the loads to the gradient and, if `in_band`, to the band; return the potential of the loads."""
    at, out = vector(core.block, a.LOADED), matrix(core.block, a.LOAD_OUT)
    gradient, band, count = vector(core.block, a.GRADIENT), matrix(core.block, a.BANDED_JACOBIAN), len(at)
    _place(core, x, 0.0, x)
    if in_band:
        run(core, a.LOAD_HESSIAN, a.LOAD_IN, a.LOAD_OUT, 1)
    else:
        given = matrix(core.block, a.LOAD_IN)
        evaluate_kernel(kernel(core, a.LOAD_GRADIENT), given, out[: 1 + 3 * count], 1)
    for k in range(count):
        for d in range(3):
            r = BLOCK_SIZE * int(at[k]) + d
            gradient[r] += out[1 + 3 * k + d, 0]
            if in_band:
                for e in range(3):
                    band[r, B + e - d] += out[1 + 3 * count + 9 * k + 3 * e + d, 0]
    return float(out[0, 0])


@inner
def turn(core: Core, step: FloatArray) -> bool:
    """Set each load to its next regime at x minus a step, and return whether a regime changes."""
    given, out, count = matrix(core.block, a.LOAD_IN), matrix(core.block, a.LOAD_OUT), len(vector(core.block, a.LOADED))
    _place(core, vector(core.block, a.X), 1.0, step)
    evaluate_kernel(kernel(core, a.LOAD_TURN), given, out[:count], 1)
    turned = False
    for k in range(count):
        r = _OWN + _REGIME * count + k
        turned = turned or out[k, 0] != given[r, 0]
        given[r, 0] = out[k, 0]
    return turned


@inner
def finish(core: Core, terms: FloatArray) -> None:
    """Add the loads' terms of the ledger, and store the loads' states. The inputs must belong to the solution."""
    given, out, kept = matrix(core.block, a.LOAD_IN), matrix(core.block, a.LOAD_ENDS), vector(core.block, a.LOAD_STATES)
    x, nodes = vector(core.block, a.X), matrix(core.block, a.NODE_IN)
    given[_LANDS, 0] = nodes[_NODE_LANDS, 0]
    _place(core, x, 0.0, x)
    run(core, a.LOAD_AFTER, a.LOAD_IN, a.LOAD_ENDS, 1)
    for k in range(len(_OF_LOAD)):
        terms[_OF_LOAD[k]] += out[k, 0]
    for k in range(len(kept)):
        kept[k] = out[_COUNT + k, 0]
