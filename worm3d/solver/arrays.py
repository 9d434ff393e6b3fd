"""Everything that a step reads and writes, in the layout of the kernels.

Lanes are segments (S of them, a multiple of the vector width); the eight contact points of segment i are the lanes
S slot + i of point arrays. Some arrays share memory, so that one kernel writes where the next one reads:

    segment_shape -> REST | points      points are rows "x" of the point array
    segment_motion -> points            are its rows "first"
    segment_ledger -> ... | points      likewise, with terms and angles in the row before them
    world -> distance ... grip          are its rows 3 to 13
    point_start -> tangent ... deep     are rows of it too
    joint_start, node_start             write the last rows of the joint and of the node array
    point_stiffness -> f ... K          are the last rows of the segment array

The past of points and joints stands in rows of their arrays. What becomes of a point in a step is an output of
point_after; friction's state and the world's force stay there, the rest `worm3d.solver.step` makes the past.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worm3d.machine import vectors
from worm3d.machine.banded import WIDTH, B
from worm3d.physics.kernels import joint, node, point, segment
from worm3d.solver.block import Block, Memory

POINTS = segment.POINTS
BLOCK = 5
"""Coordinates of a joint's block: p (3), roll and bend of the segment ahead of it."""
WORLD_ROWS = 11
"""Outputs of a world: distance, gradient (3), curvature (6), grip."""

TERMS = (
    "work_contract",
    "work_external",
    "load_change",
    "kinetic",
    "elastic",
    "potential",
    "penetration",
    "anchor",
    "friction_loss",
    "viscous_loss",
    "impact",
    "numerical_loss",
    "drag_loss",
    "work_contract_positive",
    "work_contract_p11",
    "work_friction_p13",
)
"""Of the energy ledger, in the order of the records."""

KERNELS = (
    "world",
    "segment_shape",
    "segment_rims",
    "segment_motion",
    "segment_gradient",
    "segment_hessian",
    "segment_jacobian",
    "segment_ledger",
    "joint_start",
    "joint_gradient",
    "joint_hessian",
    "joint_angles",
    "joint_ledger",
    "point_force",
    "point_stiffness",
    "point_start",
    "point_yielding",
    "point_expected",
    "point_after",
    "point_momenta",
    "node_start",
    "node_after",
    "node_momenta",
    "evaluate",  # entries, `worm3d.solver.entry`
    "solve",
    "step",
)
"""Compiled functions, in the order of `Core.kernels`."""
(
    WORLD,
    SEGMENT_SHAPE,
    SEGMENT_RIMS,
    SEGMENT_MOTION,
    SEGMENT_GRADIENT,
    SEGMENT_HESSIAN,
    SEGMENT_JACOBIAN,
    SEGMENT_LEDGER,
    JOINT_START,
    JOINT_GRADIENT,
    JOINT_HESSIAN,
    JOINT_ANGLES,
    JOINT_LEDGER,
    POINT_FORCE,
    POINT_STIFFNESS,
    POINT_START,
    POINT_YIELDING,
    POINT_EXPECTED,
    POINT_AFTER,
    POINT_MOMENTA,
    NODE_START,
    NODE_AFTER,
    NODE_MOMENTA,
    EVALUATE,
    SOLVE,
    STEP,
) = range(len(KERNELS))

NUMBERS = (
    "l0",  # [m]
    "deepest",  # greatest penetration of a joint [m]; deeper it counts as sunk
    "static_ratio",
    "lag",  # [s]
    "rate_limit",  # [1/s]
    "least",  # of the stroke
    "greatest",
    "length",  # of the body, the unit of Newton's tolerances [m]
    "tolerance",  # of Newton: the last step, as a fraction of the body length
    "lever",  # metres per radian in Newton's tolerances
    "clamped",  # 1: the ground is the paper's, (P9) and (P10)
    "threshold",  # eps of (P10) [m/s]
    "mass",  # [kg]
    "gravity_x",  # [m/s^2]
    "gravity_y",
    "gravity_z",
)
"""What one number says of a worm and its world."""
(
    L0,
    DEEPEST,
    STATIC_RATIO,
    LAG,
    RATE_LIMIT,
    LEAST,
    GREATEST,
    LENGTH,
    TOLERANCE,
    LEVER,
    CLAMPED,
    THRESHOLD,
    MASS,
    GRAVITY,
    _,
    _,
) = range(len(NUMBERS))

ARRAYS = (
    "numbers",
    "x",  # coordinates; rolls count from the start of the step
    "x_n",  # x at the start of the step
    "held",  # 1 where a coordinate is held
    "gradient",
    "direction",
    "trial",
    "best",
    "curve",  # change of "last" in the last step
    "last",  # change of x in the last step
    "band",
    "joint_band",  # what the joints contribute to it
    "factor",  # of the linear solver
    "segment_in",  # inputs of the segment's kernels
    "point_out",  # f (3), potential, load, f foreseen (3), K (9); inside segment_in
    "point_anew",  # likewise, where contacts have changed; of these the change of K
    "segment_out",
    "segment_blocks",  # the segments' Hessians, one after the other
    "changed",  # 1 where a contact has changed what it does since the Jacobian was made
    "points_jacobian",  # derivatives of the points in the coordinates
    "jacobians",  # the same, segments one after the other
    "known",  # 1 where those of a vector of segments stand there, made since the Jacobian was
    "rest",  # chamber lengths (2), tangent (3), director (3), points (24)
    "point_in",  # inputs of the point's kernels; begins inside rest
    "point_rows",  # the same memory with the lanes of segments, row 8 r + slot
    "world_in",
    "world_out",  # inside point_in
    "started",  # inside point_in: from tangent to deep
    "first",  # inside point_in, with the lanes of segments
    "segment_ledger",  # terms, hinge angles and "first", inside point_in
    "yielding_out",  # y (2), excess, penetration, pull (2), load, swing, regime, whether stale, reach, recent
    "after_out",  # terms of the ledger, and what becomes of the point, as in `point.AFTER`
    "joint_in",
    "joint_presets",  # inside joint_in: its last rows
    "joint_out",
    "joint_blocks",
    "kinks",
    "y_start",  # working memory of the line search, and of `worm3d.solver.fronts`
    "moved",  # change of x in the step, with zeros behind it
    "sums",  # of 8 rows
    "momenta_out",
    "node_in",  # inputs of the kernels of the joints as mass points
    "node_out",
    "node_presets",  # inside node_in: its last rows
    "turned",  # rows of the records, segments one after the other
    "point_mass",  # (8, S), inside point_in [kg]
    "longest",  # length of a chamber at which its rhombus counts as flattened [m]
    "joint_mass",  # inside node_in, as the following up to joint_friction but joint_mu [kg]
    "drag",  # [N s/m]
    "joint_mu",  # forward, backward, lateral, for the clamped worm
    "joint_hat",
    "joint_drag_hat",
    "joint_inertia",  # m/(beta dt)^2
    "joint_drag",  # drag/(beta dt)
    "external",  # force on the joints [N]
    "joint_friction",  # (P10) on the joints of the clamped worm [N]
    "joint_load",  # (P9) [N]
    "stuck",  # 1 where the static coefficient holds; inside after_out
    "stuck_n",
    "pull_n",  # f of (C5) at the start of the step
    "fronts",  # of each contact, `worm3d.solver.fronts`
    "stored",  # energy of the anchors at the end of the last step, inside point_in [J]
    "contact_force",  # of the world on each point at the end of the last step, inside after_out [N]
    "asked",  # of the actuators: contraction (2 N), force (2 N), hinge (N, the first unused)
    "given",  # by them, after lag and limits
    "joints",  # rows 3 k + axis at t_n (k = 0) and t_{n-1} (k = 1), inside node_in [m]; likewise the following
    "joint_velocity",
    "points",  # inside point_in
    "point_velocity",
    "lengths",  # of the chambers [m]
    "hinges",  # angles of the apex hinges [rad]
    "joint_angles",  # c.d, c.u, twist, sum of the bends; inside joint_in
    "terms",  # energy ledger since the last record [J]
    "slid",  # slip since the last record [m]
)
"""Arrays of a core, in the order of its block."""
(
    NUMBERS_,
    X,
    X_N,
    HELD,
    GRADIENT,
    DIRECTION,
    TRIAL,
    BEST,
    CURVE,
    LAST,
    BAND,
    JOINT_BAND,
    FACTOR,
    SEGMENT_IN,
    POINT_OUT,
    POINT_ANEW,
    SEGMENT_OUT,
    SEGMENT_BLOCKS,
    CHANGED,
    POINTS_JACOBIAN,
    JACOBIANS,
    KNOWN,
    REST,
    POINT_IN,
    POINT_ROWS,
    WORLD_IN,
    WORLD_OUT,
    STARTED,
    FIRST,
    SEGMENT_LEDGER_,
    YIELDING_OUT,
    AFTER_OUT,
    JOINT_IN,
    JOINT_PRESETS,
    JOINT_OUT,
    JOINT_BLOCKS,
    KINKS,
    Y_START,
    MOVED,
    SUMS,
    MOMENTA_OUT,
    NODE_IN,
    NODE_OUT,
    NODE_PRESETS,
    TURNED,
    POINT_MASS,
    LONGEST,
    JOINT_MASS,
    DRAG,
    JOINT_MU,
    JOINT_HAT,
    JOINT_DRAG_HAT,
    JOINT_INERTIA,
    JOINT_DRAG,
    EXTERNAL,
    JOINT_FRICTION,
    JOINT_LOAD,
    STUCK,
    STUCK_N,
    PULL_N,
    FRONTS,
    STORED,
    CONTACT_FORCE,
    ASKED,
    GIVEN,
    JOINTS,
    JOINT_VELOCITY,
    POINTS_PAST,
    POINT_VELOCITY,
    LENGTHS,
    HINGES,
    JOINT_ANGLES_PAST,
    TERMS_,
    SLID,
) = range(len(ARRAYS))

REMEMBERED = (
    "x",
    "curve",
    "last",
    "stuck",
    "stored",
    "fronts",
    "contact_force",
    "asked",
    "given",
    "joints",
    "joint_velocity",
    "points",
    "point_velocity",
    "lengths",
    "hinges",
    "joint_angles",
    "joint_load",
    "joint_friction",
)
"""Arrays on which the next step depends; beside them the rows of the kernels' inputs in `worm3d.plant`."""


HANDLE = 5
"""Numbers in the handle of a core: n and the addresses of memory, table, kernels and counters."""
COUNTERS = 4
"""Evaluations with a new Jacobian, whole or in part, further ones of the residual, rounds of contacts that broke away,
and falls back to descent."""


class Core(NamedTuple):
    """What compiled code receives: the number of segments, and where everything stands."""

    n: int
    kernels: int
    """Addresses of `KERNELS`."""
    block: Block
    """Of `ARRAYS`."""
    counters: int
    handle: int


class CoreMemory:
    """Owner of a core: zero arrays for n segments.

    Parameters
    ----------
    n : int
        Segments.
    lanes, joint_lanes, node_lanes : int
        Lanes for n segments, for the n - 1 joints between them and for all n + 1 joints.
    world_rows : int
        Inputs of the world's kernel: x (3) and its parameters.
    kernels : ndarray of int, shape (26,)
        Addresses.
    """

    def __init__(
        self, n: int, lanes: int, joint_lanes: int, node_lanes: int, world_rows: int, kernels: NDArray[np.int64]
    ) -> None:
        self._sizes = n, lanes, joint_lanes, node_lanes, world_rows
        shapes = _shapes(n, lanes, joint_lanes, node_lanes, world_rows)
        self._memory = Memory(ARRAYS, [shapes[name] for name in ARRAYS])
        table = self._memory.table
        points = table[REST, 0] + POINTS * lanes  # behind lengths, tangents and directors
        table[POINT_IN, 0] = table[POINT_ROWS, 0] = points
        table[WORLD_OUT, 0] = points + 3 * POINTS * lanes
        for array, name in _OF_POINTS.items():
            table[array, 0] = points + point.LAYOUT.first(name) * POINTS * lanes
        for array, name in _OF_NODES.items():
            table[array, 0] = table[NODE_IN, 0] + node.LAYOUT.first(name) * node_lanes
        for array, name in ((JOINT_PRESETS, "strain_hat"), (JOINT_ANGLES_PAST, "angles_n")):
            table[array, 0] = table[JOINT_IN, 0] + joint.LAYOUT.first(name) * joint_lanes
        for array, name in ((STUCK, "stuck"), (CONTACT_FORCE, "force")):
            table[array, 0] = table[AFTER_OUT, 0] + point.AFTER.first(name) * POINTS * lanes
        table[POINT_OUT, 0] = table[SEGMENT_IN, 0] + segment.LAYOUT.first("f") * lanes
        block, self.counters, self.kernels = self._memory.block, np.zeros(COUNTERS, dtype=np.int64), kernels
        at = (*block, kernels.ctypes.data, self.counters.ctypes.data)
        self._handle = np.array([n, *at], dtype=np.int64)
        self.core = Core(n, kernels.ctypes.data, block, self.counters.ctypes.data, self._handle.ctypes.data)
        self.arrays = self._memory.arrays()

    def copy(self, kernels: NDArray[np.int64]) -> CoreMemory:
        """Return another core with the same numbers, and these addresses."""
        other = CoreMemory(*self._sizes, kernels)
        other._memory.take(self._memory)
        return other


_OF_POINTS = {
    POINT_MASS: "mass",
    POINTS_PAST: "past",
    POINT_VELOCITY: "velocity",
    STARTED: "tangent",
    STORED: "stored_n",
    FIRST: "first",
    SEGMENT_LEDGER_: "of_segment",
}
"""Arrays inside point_in, and the row with which each begins; likewise inside node_in."""
_OF_NODES = {
    JOINTS: "past",
    JOINT_VELOCITY: "velocity",
    JOINT_MASS: "mass",
    DRAG: "drag",
    EXTERNAL: "external",
    JOINT_FRICTION: "friction",
    NODE_PRESETS: "drag_hat",
    JOINT_DRAG_HAT: "drag_hat",
    JOINT_HAT: "x_hat",
    JOINT_INERTIA: "inertia",
    JOINT_DRAG: "drag_rate",
}


def _shapes(n: int, lanes: int, joint_lanes: int, node_lanes: int, world_rows: int) -> dict[str, tuple[int, int]]:
    """Return the shape of each array; those inside another one only say how it is seen, the other has their room."""
    size, p = BLOCK * (n + 1), POINTS * lanes
    return {
        "numbers": (1, len(NUMBERS)),
        **dict.fromkeys(("x", "x_n", "held", "gradient", "direction", "trial", "best", "curve", "last"), (1, size)),
        "band": (size + B, WIDTH),
        "joint_band": (size + B, WIDTH),
        "factor": (size + B, WIDTH),
        "segment_in": (segment.LAYOUT.rows, lanes),
        **dict.fromkeys(("point_out", "point_anew"), (17, p)),
        "segment_out": (1 + segment.COORDINATES + segment.COORDINATES**2, lanes),
        "segment_blocks": (lanes, segment.COORDINATES**2),
        "changed": (1, p),
        "points_jacobian": (3 * POINTS * segment.COORDINATES, lanes),
        "jacobians": (lanes, 3 * POINTS * segment.COORDINATES),
        "known": (1, lanes // vectors.WIDTH),
        "rest": (8 + 3 * POINTS, lanes),
        "point_in": (point.LAYOUT.rows, p),
        "point_rows": (point.LAYOUT.rows * POINTS, lanes),
        "world_in": (world_rows, p),
        "world_out": (WORLD_ROWS, p),
        "started": (point.LAYOUT.first("anchor") - point.LAYOUT.first("tangent"), p),
        "first": (3 * POINTS, lanes),
        "segment_ledger": (segment.LEDGER_ROWS + 3 * POINTS, lanes),
        "yielding_out": (12, p),
        "after_out": (point.AFTER.rows, p),
        "moved": (1, BLOCK * (lanes + 1) + vectors.WIDTH),
        "sums": (1, vectors.WIDTH),
        "momenta_out": (9, max(p, node_lanes)),
        "node_in": (node.LAYOUT.rows, node_lanes),
        "node_out": (len(node.LEDGER_TERMS) + 3, node_lanes),
        "node_presets": (8, node_lanes),
        "turned": (lanes, 3 * POINTS),
        "joint_in": (joint.LAYOUT.rows, joint_lanes),
        "joint_presets": (9, joint_lanes),
        "joint_out": (1 + joint.COORDINATES + joint.COORDINATES * joint.ROW, joint_lanes),
        "joint_blocks": (joint_lanes, joint.COORDINATES * joint.ROW),
        "kinks": (1, p),
        "y_start": (3, p),
        "point_mass": (POINTS, lanes),
        "longest": (1, n),
        **dict.fromkeys(("joint_mass", "drag", "joint_inertia", "joint_drag"), (1, node_lanes)),
        **dict.fromkeys(("joint_hat", "joint_drag_hat", "external", "joint_friction"), (3, node_lanes)),
        "joint_load": (1, n + 1),
        "joint_mu": (3, n + 1),
        **dict.fromkeys(("stuck", "stuck_n", "stored"), (1, p)),
        "contact_force": (3, p),
        "pull_n": (2, p),
        "fronts": (6, p),
        **dict.fromkeys(("asked", "given"), (1, 5 * n)),
        **dict.fromkeys(("joints", "joint_velocity"), (6, node_lanes)),
        **dict.fromkeys(("points", "point_velocity"), (6, p)),
        **dict.fromkeys(("lengths", "hinges"), (4, lanes)),
        "joint_angles": (8, joint_lanes),
        "terms": (1, len(TERMS)),
        "slid": (POINTS, lanes),
    }
