"""Arrays, kernels and numbers of a step. Each is declared once, together with the constant for its index.

Lanes are segments. Their number S is a multiple of the vector width. In the arrays of contact points, the eight points
of segment i are in the lanes S slot + i. An array that is `inside` another array shares its memory, so that a kernel
writes directly into the inputs of the next kernel. For example, the points follow the chamber lengths and frames, and
the outputs of the world's kernel are rows of the points' inputs. Rows of the points' and joints' arrays contain their
past. The kernel point_after computes the state of a point after a step. The friction state and the force of the world
stay in its outputs; `worm3d.solver.step` copies the other outputs to the past.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from worm3d.machine import vectors
from worm3d.machine.banded import BAND_COLUMNS, B
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.actuators import COMMANDS, Actuator
from worm3d.physics.hysteresis import Hysteresis, chamber_states
from worm3d.physics.kernels import actuator, change, joint, load, medium, node, point, regime, segment
from worm3d.physics.kernels.layout import Layout
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.physics.load import Load
from worm3d.physics.media import Medium
from worm3d.physics.segment_laws.law import SegmentLaw
from worm3d.recorded import series
from worm3d.recorded.energy import TERMS
from worm3d.solver.block import Block, Memory, Plan
from worm3d.values.arrays import FloatArray
from worm3d.worlds.kernels import WORLD_ROWS

SHAPE = Layout({"lengths": 2, "tangent": 3, "director": 3, "points": 3 * POINTS_PER_SEGMENT})
"""Outputs of the kernel segment_shape."""
POINT_FORCES = Layout({"f": 3, "phi": 1, "load": 1, "f_ahead": 3, "K": 9})
"""Outputs of the kernel point_stiffness. The kernel point_force has only the outputs before "f_ahead"."""


class KernelRow(NamedTuple):
    """Declaration of a compiled function."""

    make: Callable[..., ca.Function | None] | None = None
    """Returns the function to compile, or None if the worm does not need it. Left out for the world's kernel, and for
    entries (`worm3d.solver.entry`)."""
    padded: bool = False
    """Whether the function is evaluated in all lanes. Lanes without a point or joint have neither mass nor stiffness.
    """
    of: Literal["", "law", "segment", "chamber", "hinge", "medium", "load"] = ""
    """Which classes are the arguments of `make`: the law of friction, the segment law, the actuator and joint friction
    of the chambers with the segment law, the actuator of the hinges, the medium, or all loads."""
    exact: bool = False
    """Whether the function is computed exactly as written, so that all bits equal the results of NumPy."""
    sensing: bool = False
    """Whether the function is needed only for sensitivities."""


KERNELS: dict[str, KernelRow] = {}
"""Compiled functions by name, in the order of `Core.kernels`."""


def _kernel(name: str, make: Callable[..., ca.Function | None] | None = None, **more: Any) -> int:
    """Declare a compiled function and return its index."""
    KERNELS[name] = KernelRow(make, **more)
    return len(KERNELS) - 1


WORLD = _kernel("world")
SEGMENT_SHAPE = _kernel("segment_shape", segment.shape, of="segment")
SEGMENT_RIMS = _kernel("segment_rims", segment.rims)
SEGMENT_MOTION = _kernel("segment_motion", segment.motion, of="segment")
SEGMENT_GRADIENT = _kernel("segment_gradient", actuator.gradient, of="chamber")
SEGMENT_HESSIAN = _kernel("segment_hessian", actuator.hessian, of="chamber")
SEGMENT_JACOBIAN = _kernel("segment_jacobian", segment.jacobian, of="segment")
SEGMENT_LEDGER = _kernel("segment_ledger", segment.ledger, of="segment")
ACTUATOR_START = _kernel("actuator_start", actuator.start, of="chamber", exact=True)
ACTUATOR_REST = _kernel("actuator_rest", actuator.rest, of="chamber")
ACTUATOR_END = _kernel("actuator_end", actuator.end, of="chamber")
HINGE_START = _kernel("hinge_start", actuator.hinge_start, of="hinge", exact=True)
JOINT_START = _kernel("joint_start", joint.start)
JOINT_GRADIENT = _kernel("joint_gradient", joint.gradient)
JOINT_HESSIAN = _kernel("joint_hessian", joint.hessian)
JOINT_ANGLES = _kernel("joint_angles", joint.angles)
JOINT_LEDGER = _kernel("joint_ledger", joint.ledger)
POINT_FORCE = _kernel("point_force", point.force, padded=True, of="law")
POINT_STIFFNESS = _kernel("point_stiffness", point.stiffness, padded=True, of="law")
POINT_AHEAD = _kernel("point_ahead", point.ahead, padded=True, of="law")
POINT_FREE_FORCE = _kernel("point_free_force", point.free_force, padded=True)
POINT_FREE_STIFFNESS = _kernel("point_free_stiffness", point.free_stiffness, padded=True)
POINT_START = _kernel("point_start", point.start, padded=True)
POINT_NEAR = _kernel("point_near", regime.near, padded=True, of="law")
POINT_YIELDING = _kernel("point_yielding", regime.yielding, padded=True, of="law")
POINT_EXPECTED = _kernel("point_expected", regime.expected, padded=True, of="law")
POINT_AFTER = _kernel("point_after", point.after, padded=True, of="law")
POINT_TOUCHES = _kernel("point_touches", point.touches, padded=True)
POINT_FREE_AFTER = _kernel("point_free_after", point.free_after, padded=True)
POINT_MOMENTA = _kernel("point_momenta", point.momenta, padded=True)
MEDIUM_RESISTANCE = _kernel("medium_resistance", medium.resistance, of="medium")
LOAD_GRADIENT = _kernel("load_gradient", load.gradient, of="load")
LOAD_HESSIAN = _kernel("load_hessian", load.hessian, of="load")
LOAD_TURN = _kernel("load_turn", load.turn, of="load")
LOAD_AFTER = _kernel("load_after", load.after, of="load")
NODE_START = _kernel("node_start", node.start, padded=True)
NODE_AFTER = _kernel("node_after", node.after, padded=True)
NODE_MOMENTA = _kernel("node_momenta", node.momenta, padded=True)
EVALUATE = _kernel("evaluate")
SOLVE = _kernel("solve")
STEP_ENTRY = _kernel("step")
PUT = _kernel("put")
POINT_RESIDUAL = _kernel("point_residual", change.point_residual, padded=True, of="law", sensing=True)
POINT_NEXT = _kernel("point_next", change.point_next, padded=True, of="law", sensing=True)
NODE_RESIDUAL = _kernel("node_residual", change.node_residual, padded=True, sensing=True)
NODE_NEXT = _kernel("node_next", change.node_next, padded=True, sensing=True)
CHAMBER_FACES = _kernel("chamber_faces", change.chamber_faces, of="chamber", sensing=True)
CHAMBER_POINTS = _kernel("chamber_points", change.chamber_points, of="chamber", sensing=True)
CHAMBER_RESIDUAL = _kernel("chamber_residual", change.chamber_residual, of="chamber", sensing=True)
CHAMBER_NEXT = _kernel("chamber_next", change.chamber_next, of="chamber", sensing=True)
JOINT_RESIDUAL = _kernel("joint_residual", change.joint_residual, of="hinge", sensing=True)
JOINT_NEXT = _kernel("joint_next", change.joint_next, of="hinge", sensing=True)

NUMBER_NAMES: list[str] = []
"""Names of the single numbers that describe a worm and a world."""


def _number(name: str) -> int:
    """Declare a number, and return its index in the array "numbers"."""
    NUMBER_NAMES.append(name)
    return len(NUMBER_NAMES) - 1


L0 = _number("l0")  # [m]
MAX_PENETRATION = _number("deepest")  # largest penetration of a joint [m]; a deeper joint counts as sunk
STATIC_RATIO = _number("static_ratio")
BODY_LENGTH = _number("length")  # body length, the unit of Newton's tolerances [m]
NEWTON_TOLERANCE = _number("tolerance")  # largest final step of Newton, as a fraction of the body length
LEVER = _number("lever")  # metres per radian in Newton's tolerances
CLAMPED = _number("clamped")  # 1 if the ground is the paper's, (P9) and (P10)
THRESHOLD = _number("threshold")  # eps of (P10) [m/s]
MASS = _number("mass")  # [kg]
RATIO = _number("ratio")  # length of this step divided by the length of the last step, for BDF2
ALLOWED = _number("allowed")  # limit of the estimated error of a step [m]
ERROR = _number("error")  # estimated error of the last step, if a limit is set [m]
GRAVITY = _number("gravity_x")  # [m/s^2]; y and z follow
_number("gravity_y")
_number("gravity_z")


class Sizes(NamedTuple):
    """Sizes of a core's arrays."""

    n: int
    """Number of segments."""
    lanes: int
    """Number of lanes for n segments."""
    joint_lanes: int
    """Number of lanes for the n - 1 joints between segments."""
    node_lanes: int
    """Number of lanes for all n + 1 joints."""
    world_rows: int
    """Number of inputs of the world's kernel: x (3) and the parameters."""
    bounds: int
    """Number of contractions at which the domain of the segment law has bounds of the length."""
    segment: type[SegmentLaw]
    """Segment law."""
    chamber: type[Actuator]
    """Actuator of the chambers."""
    hysteresis: type[Hysteresis]
    """Friction in the joints of the chambers."""
    hinge: type[Actuator]
    """Actuator of the hinges."""
    medium: type[Medium]
    """Medium that resists the motion of the joints."""
    loads: tuple[type[Load], ...]
    """External loads on the joints."""
    parameters: int = 0
    """Number of parameters of sensitivities."""


@cache
def _extents(sizes: Sizes) -> dict[str, Any]:
    """Return the sizes in `sizes`, and sizes computed from them, by name."""
    size = BLOCK_SIZE * (sizes.n + 1)
    parts, law = (sizes.chamber, sizes.hysteresis), segment.law_rows(sizes.segment)
    chamber, hinge = 2 * actuator.ACTUATORS_PER_SEGMENT * len(chamber_states(*parts)), 2 * len(sizes.hinge.states)
    return {
        **sizes._asdict(),
        "domain_rows": 2 + 2 * sizes.bounds,
        "formed_rows": segment.layout(sizes.segment).rows,
        "chamber_rows": actuator.chambers(*parts, sizes.segment).rows,
        "chamber_states_begin": actuator.CHAMBER_COMMANDS[-1] + actuator.ACTUATORS_PER_SEGMENT + law,
        "hinge_rows": actuator.hinges(sizes.hinge).rows,
        "medium_rows": medium.layout(sizes.medium).rows,
        "loads": len(sizes.loads),
        "load_rows": load.layout(*sizes.loads).rows,
        "load_kept": load.kept(*sizes.loads),
        "load_out": 1 + 12 * len(sizes.loads),
        "load_after": len(load.LEDGER_TERMS) + load.kept(*sizes.loads),
        **_changes(sizes),
        "chamber_past": chamber,  # states at t_n and t_{n-1}
        "hinge_past": hinge,
        "chamber_states": chamber // 2,
        "chamber_out": actuator.LEDGER_ROWS + actuator.ACTUATORS_PER_SEGMENT + chamber // 2,
        "hinge_out": actuator.HINGE_ROWS + hinge // 2,
        "coordinates": size,  # with two unused coordinates of the last block
        "band_rows": size + B,
        "commands": 5 * sizes.n,
        "joints": sizes.n + 1,
        "vectors": sizes.lanes // vectors.VECTOR_WIDTH,
        "points": POINTS_PER_SEGMENT * sizes.lanes,
        "mass_points": max(POINTS_PER_SEGMENT * sizes.lanes, sizes.node_lanes),
        "moved": BLOCK_SIZE * (sizes.lanes + 1) + vectors.VECTOR_WIDTH,
    }


def _changes(sizes: Sizes) -> dict[str, int]:
    """Return the numbers of rows for sensitivities by name: all inputs, changes, and changes of the past for each p."""
    chamber, own, hinge = sizes.chamber, sizes.hysteresis, sizes.hinge
    parts = {  # layout of the inputs without changes, changes that are filled, changes of the past
        "point": (point.POINT_LAYOUT, change.POINT_FILLED, change.POINT_PAST),
        "node": (node.NODE_LAYOUT, change.NODE_FILLED, change.NODE_PAST),
        "chamber": (
            actuator.chambers(chamber, own, sizes.segment),
            change.CHAMBER_FILLED,
            change.chamber_past(chamber, own),
        ),
        "joint": (actuator.hinges(hinge), change.JOINT_FILLED, change.joint_past(hinge)),
    }
    found = {}
    for name, (layout, filled, past) in parts.items():
        count, size = sizes.parameters, sum(past.values())
        found[f"{name}_changes"] = (sum(filled.values()) + size) * (count > 0)
        found[f"{name}_sensed"] = layout.rows + found[f"{name}_changes"]
        found[f"{name}_kept"] = count * size
    return found


Extent = int | str | Layout
"""Number of rows or columns: a number, the name of a size in `_extents`, or a layout, whose rows have names."""


class ArrayRow(NamedTuple):
    """Declaration of an array of a core."""

    rows: Extent
    columns: Extent
    inside: tuple[str, str | int] | None = None
    """Name of an earlier array whose memory this array shares, and the row of the earlier array where this one begins.
    """
    remembered: bool | tuple[str, ...] = False
    """Whether the next step depends on the array, or the names of the rows on which the next step depends."""
    history: bool = False
    """Whether the array contains two instants, the present first. The next step depends on such an array."""

    def shape(self, sizes: Sizes) -> tuple[int, int]:
        """Return the shape in a core of these sizes."""
        return _extent(self.rows, sizes), _extent(self.columns, sizes)

    def first(self, row: str | int) -> int:
        """Return the index of a row, which is given by its name or number."""
        return self.rows.first(row) if isinstance(self.rows, Layout) and isinstance(row, str) else int(row)

    def begin(self, row: str | int, sizes: Sizes) -> int:
        """Return the index of a row as `first`. In an array without named rows, `row` may be the name of a size."""
        return self.first(row) if isinstance(self.rows, Layout) else _extent(row, sizes)


def _extent(extent: Extent, sizes: Sizes) -> int:
    if isinstance(extent, Layout):
        return extent.rows
    return int(_extents(sizes)[extent]) if isinstance(extent, str) else extent


ARRAYS: dict[str, ArrayRow] = {}
"""Arrays of a core by name, in the order of their constants."""


def _array(name: str, rows: Extent, columns: Extent, **more: Any) -> int:
    """Declare an array and return its index."""
    ARRAYS[name] = ArrayRow(rows, columns, **more)
    return len(ARRAYS) - 1


NUMBERS_ = _array("numbers", 1, len(NUMBER_NAMES))
X = _array("x", 1, "coordinates", remembered=True)  # coordinates; rolls count from the start of the step
X_N = _array("x_n", 1, "coordinates")  # x at the start of the step
HELD = _array("held", 1, "coordinates")  # 1 where a coordinate is held
GRADIENT = _array("gradient", 1, "coordinates")
DIRECTION = _array("direction", 1, "coordinates")
TRIAL = _array("trial", 1, "coordinates")
BEST = _array("best", 1, "coordinates")
CURVE = _array("curve", 1, "coordinates", remembered=True)  # change of "last" in the last step
LAST = _array("last", 1, "coordinates", remembered=True)  # change of x in the last step
BANDED_JACOBIAN = _array("band", "band_rows", BAND_COLUMNS)
FACTOR = _array("factor", "band_rows", BAND_COLUMNS)  # factors of the linear solver
# inputs of the segment's kernels
SEGMENT_IN = _array("segment_in", segment.SEGMENT_LAYOUT, "lanes", remembered=("t_ref", "d_ref", "rim", "commanded_n"))
POINT_OUT = _array("point_out", POINT_FORCES, "points", inside=("segment_in", "f"))
POINT_ANEW = _array("point_anew", POINT_FORCES, "points")  # as "point_out", for changed contacts, with the change of K
SEGMENT_OUT = _array("segment_out", 1 + segment.COORDINATES + segment.COORDINATES**2, "lanes")
# gradients and Hessians of the segments, one segment after the other
SEGMENT_BLOCKS = _array("segment_blocks", "lanes", segment.COORDINATES + segment.COORDINATES**2)
CHANGED = _array("changed", 1, "points")  # 1 if a contact has changed since the Jacobian was made
# derivatives of the points with respect to the coordinates
POINTS_JACOBIAN = _array("points_jacobian", 3 * POINTS_PER_SEGMENT * segment.COORDINATES, "lanes")
# as "points_jacobian", but one segment after the other
JACOBIANS = _array("jacobians", "lanes", 3 * POINTS_PER_SEGMENT * segment.COORDINATES)
DERIVATIVES_KNOWN = _array("known", 1, "vectors")  # 1 if "jacobians" of 8 segments are newer than "band"
SEGMENT_SHAPE_OUT = _array("rest", SHAPE, "lanes")
# inputs of the point's kernels
POINT_IN = _array(
    "point_in",
    point.POINT_LAYOUT,
    "points",
    inside=("rest", "points"),
    remembered=("anchor", "load_n", "load_m", "pull", "pull_m"),
)
# the same memory as "point_in", with the lanes of segments: row 8 r + slot
POINT_ROWS = _array("point_rows", point.POINT_LAYOUT.rows * POINTS_PER_SEGMENT, "lanes", inside=("point_in", 0))
WORLD_IN = _array("world_in", "world_rows", "points")
WORLD_OUT = _array("world_out", WORLD_ROWS, "points", inside=("point_in", "distance"))
# from tangent to deep
STARTED = _array(
    "started",
    point.POINT_LAYOUT.first("anchor") - point.POINT_LAYOUT.first("tangent"),
    "points",
    inside=("point_in", "tangent"),
)
FIRST = _array("first", 3 * POINTS_PER_SEGMENT, "lanes", inside=("point_in", "first"))  # with the lanes of segments
# terms, hinge angles and "first"
SEGMENT_LEDGER_ = _array(
    "segment_ledger", segment.LEDGER_ROWS + 3 * POINTS_PER_SEGMENT, "lanes", inside=("point_in", "of_segment")
)
# rows as in `worm3d.physics.kernels.regime.yielding`
YIELDING_OUT = _array("yielding_out", 12, "points")
# terms of the ledger, and the new state of the point, as in `point.AFTER`
AFTER_OUT = _array("after_out", point.AFTER, "points")
JOINT_IN = _array("joint_in", joint.JOINT_LAYOUT, "joint_lanes", remembered=("hinge_n",))
JOINT_PRESETS = _array("joint_presets", 9, "joint_lanes", inside=("joint_in", "strain_hat"))  # the last rows
JOINT_OUT = _array("joint_out", 1 + (1 + joint.COORDINATES) * joint.ROW, "joint_lanes")
# gradients and Hessians of the joints, one joint after the other
JOINT_BLOCKS = _array("joint_blocks", "joint_lanes", (1 + joint.COORDINATES) * joint.ROW)
KINKS = _array("kinks", 1, "points")
Y_START = _array("y_start", 3, "points")  # working memory of the line search
STEP_CHANGE = _array("moved", 1, "moved")  # change of x in the step, followed by zeros
SUMS = _array("sums", 1, vectors.VECTOR_WIDTH)  # of 8 rows
MOMENTA_OUT = _array("momenta_out", 9, "mass_points")
NODE_IN = _array("node_in", node.NODE_LAYOUT, "node_lanes")  # inputs of the kernels of the joints as mass points
NODE_OUT = _array("node_out", len(node.LEDGER_TERMS) + 3, "node_lanes")
NODE_PRESETS = _array("node_presets", 8, "node_lanes", inside=("node_in", "drag_hat"))  # the last rows
# rows of the records, segments one after the other
TRANSPOSED_RECORDS = _array("turned", "lanes", 3 * POINTS_PER_SEGMENT)
POINT_MASS = _array("point_mass", POINTS_PER_SEGMENT, "lanes", inside=("point_in", "mass"))  # [kg]
FLATTENED_LENGTH = _array("longest", 1, "n")  # length of a chamber that counts as flattened [m]
# domain of the segment law: least and greatest commanded rest length of a chamber, then its least and its greatest
# lengths at equal steps from the greatest to the least commanded rest length [m]
DOMAIN = _array("domain", "domain_rows", "n")
# [kg]
JOINT_MASS = _array("joint_mass", 1, "node_lanes", inside=("node_in", "mass"))
DRAG = _array("drag", 1, "node_lanes", inside=("node_in", "drag"))  # [N s/m]
JOINT_MU = _array("joint_mu", 3, "joints")  # forward, backward, lateral, for the clamped worm
JOINT_HAT = _array("joint_hat", 3, "node_lanes", inside=("node_in", "x_hat"))
JOINT_DRAG_HAT = _array("joint_drag_hat", 3, "node_lanes", inside=("node_in", "drag_hat"))
JOINT_INERTIA = _array("joint_inertia", 1, "node_lanes", inside=("node_in", "inertia"))  # m/(beta dt)^2
JOINT_DRAG = _array("joint_drag", 1, "node_lanes", inside=("node_in", "drag_rate"))  # drag/(beta dt)
EXTERNAL = _array("external", 3, "node_lanes", inside=("node_in", "external"))  # force on the joints [N]
# (P10) on the joints of the clamped worm [N]
JOINT_FRICTION = _array("joint_friction", 3, "node_lanes", inside=("node_in", "friction"), remembered=True)
JOINT_LOAD = _array("joint_load", 1, "joints", remembered=True)  # (P9) [N]
# 1 if the static coefficient holds
STUCK = _array("stuck", 1, "points", inside=("after_out", "stuck"), remembered=True)
STUCK_N = _array("stuck_n", 1, "points")
PULL_N = _array("pull_n", 2, "points")  # f of (C5) at the start of the step
# energy of the anchors at the end of the last step [J]
ANCHOR_ENERGY = _array("stored", 1, "points", inside=("point_in", "stored_n"), remembered=True)
# force of the world on each point at the end of the last step [N]
CONTACT_FORCE = _array("contact_force", 3, "points", inside=("after_out", "force"), remembered=True)
# commands of the actuators: contraction (2 N), force (2 N), hinge (N, the first unused)
ACTUATOR_COMMANDS = _array("asked", 1, "commands", remembered=True)
GIVEN = _array("given", 1, "commands", remembered=True)  # outputs of the actuators, after lag and limits
# rows 3 k + axis at t_n (k = 0) and t_{n-1} (k = 1) [m]; the following arrays have the same rows
JOINTS = _array("joints", 6, "node_lanes", inside=("node_in", "past"), history=True)
JOINT_VELOCITY = _array("joint_velocity", 6, "node_lanes", inside=("node_in", "velocity"), history=True)
POINTS_PAST = _array("points", 6, "points", inside=("point_in", "past"), history=True)
POINT_VELOCITY = _array("point_velocity", 6, "points", inside=("point_in", "velocity"), history=True)
MEDIUM_IN = _array("medium_in", "medium_rows", "lanes")  # as in `worm3d.physics.kernels.medium`
RESISTANCE = _array("resistance", 1, "lanes")  # resistance of the medium to a segment [N s/m]
LOADED = _array("loaded", 1, "loads")  # joints that loads act on
LOAD_STATES = _array("loads", 1, "load_kept", remembered=True)  # regime of each load, then states of the loads
LOAD_IN = _array("load_in", "load_rows", vectors.VECTOR_WIDTH)  # as in `worm3d.physics.kernels.load`, in the first lane
LOAD_OUT = _array("load_out", "load_out", vectors.VECTOR_WIDTH)  # potential, gradient, Hessian
LOAD_ENDS = _array("load_ends", "load_after", vectors.VECTOR_WIDTH)  # terms of the ledger, memory of the loads
LENGTHS = _array("lengths", 4, "lanes", history=True)  # lengths of the chambers [m]
# inputs of the segments' kernels that depend on the segment law
FORMED = _array("formed", "formed_rows", "lanes", inside=("segment_in", 0))
# inputs of the segments' kernels, followed by the inputs of the actuators
ACTUATED = _array("actuated", "chamber_rows", "lanes", inside=("segment_in", 0))
ACTUATOR_PAST = _array(
    "actuator",
    "chamber_past",
    "lanes",
    inside=("actuated", "chamber_states_begin"),
    history=True,
)
STARTED_ACTUATORS = _array("actuator_start", actuator.START_ROWS, "lanes")  # known outputs at the start of the step
ACTUATOR_OUT = _array("actuator_out", "chamber_out", "lanes")  # terms of the ledger, outputs, states
HINGED = _array("hinged", "hinge_rows", "joint_lanes", inside=("joint_in", 0))  # inputs of joints and hinge actuators
HINGE_PAST = _array(
    "hinge_states",
    "hinge_past",
    "joint_lanes",
    inside=("joint_in", joint.JOINT_LAYOUT.rows + len(COMMANDS)),
    history=True,
)
HINGE_OUT = _array("hinge_out", "hinge_out", "joint_lanes")  # command, output, states
HINGES = _array("hinges", 4, "lanes", history=True)  # angles of the chambers [rad]
# c.d, c.u, twist, sum of the bends
JOINT_ANGLES_PAST = _array("joint_angles", 8, "joint_lanes", inside=("joint_in", "angles_n"), history=True)
TERMS_ = _array("terms", 1, len(TERMS))  # energy ledger since the last record [J]
SLID = _array("slid", POINTS_PER_SEGMENT, "lanes")  # slip since the last record [m]
# changes of the inputs of the kernels, which follow the inputs, and inputs together with changes; empty without
# sensitivities. The changes of the past are kept for each parameter
POINT_CHANGE = _array("point_change", "point_changes", "points", inside=("point_in", point.POINT_LAYOUT.rows))
NODE_CHANGE = _array("node_change", "node_changes", "node_lanes", inside=("node_in", node.NODE_LAYOUT.rows))
CHAMBER_CHANGE = _array("chamber_change", "chamber_changes", "lanes", inside=("actuated", "chamber_rows"))
JOINT_CHANGE = _array("joint_change", "joint_changes", "joint_lanes", inside=("hinged", "hinge_rows"))
POINT_SENSED = _array("point_sensed", "point_sensed", "points", inside=("point_in", 0))
NODE_SENSED = _array("node_sensed", "node_sensed", "node_lanes", inside=("node_in", 0))
CHAMBER_SENSED = _array("chamber_sensed", "chamber_sensed", "lanes", inside=("actuated", 0))
JOINT_SENSED = _array("joint_sensed", "joint_sensed", "joint_lanes", inside=("hinged", 0))
POINT_KEPT = _array("point_kept", "point_kept", "points")
NODE_KEPT = _array("node_kept", "node_kept", "node_lanes")
CHAMBER_KEPT = _array("chamber_kept", "chamber_kept", "lanes")
JOINT_KEPT = _array("joint_kept", "joint_kept", "joint_lanes")

HANDLE = 5
"""Number of integers in the handle of a core: n, and the addresses of memory, table, kernels and counters."""
COUNTERS = len(series.COUNTERS)
"""Number of quantities that are counted in a step."""


class Core(NamedTuple):
    """Argument of compiled functions: the number of segments, and the addresses of all data."""

    n: int
    kernels: int
    """Address of the table of the addresses of `KERNELS`."""
    block: Block
    """Memory of `ARRAYS`."""
    counters: int
    handle: int


@cache
def plan(sizes: Sizes) -> Plan:
    """Return the layout of the arrays in the memory of a core of these sizes."""
    inside = {}
    for name, row in ARRAYS.items():
        if row.inside is not None:
            host = ARRAYS[row.inside[0]]
            inside[name] = row.inside[0], host.begin(row.inside[1], sizes) * host.shape(sizes)[1]
    return Plan.of(list(ARRAYS), [row.shape(sizes) for row in ARRAYS.values()], inside)


class CoreMemory:
    """Owner of the memory of a core. The arrays are zero at first.

    Parameters
    ----------
    sizes : Sizes
    kernels : ndarray of int, shape (K,)
        Addresses of `KERNELS`.
    """

    def __init__(self, sizes: Sizes, kernels: NDArray[np.int64]) -> None:
        self.sizes = sizes
        self._memory = Memory(plan(sizes))
        block, self.counters, self.kernels = self._memory.block, np.zeros(COUNTERS, dtype=np.int64), kernels
        at = (*block, kernels.ctypes.data, self.counters.ctypes.data)
        self._handle = np.array([sizes.n, *at], dtype=np.int64)
        self.core = Core(sizes.n, kernels.ctypes.data, block, self.counters.ctypes.data, self._handle.ctypes.data)
        self.arrays = self._memory.arrays()

    def copy(self, kernels: NDArray[np.int64]) -> CoreMemory:
        """Return another core with the same numbers, and with kernels at the given addresses."""
        other = CoreMemory(self.sizes, kernels)
        other._memory.take(self._memory)
        return other

    def remembered(self) -> dict[str, FloatArray]:
        """Return views, by name, of everything on which the next step depends."""
        views = {}
        for name, row in ARRAYS.items():
            if (row.remembered is True or row.history) and self.arrays[name].size > 0:
                views[name] = self.arrays[name]
            elif isinstance(row.remembered, tuple) and isinstance(row.rows, Layout):
                views |= {each: row.rows.of(each, self.arrays[name]) for each in row.remembered}
        return views
