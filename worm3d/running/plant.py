"""A worm on a world, ready for time steps: the compiled kernels, and the arrays of `worm3d.solver` with values."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from worm3d.machine import vectors
from worm3d.machine.codegen import Kernel, compile_kernel
from worm3d.machine.compiled import announce, cfunc
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.actuators import Actuator, FirstOrder
from worm3d.physics.balance import warn_of_imbalance
from worm3d.physics.friction import TANGENTIAL_DAMPING_RATIO, ContactConstants, Friction, natural_time
from worm3d.physics.friction_laws import Coulomb, FrictionLaw
from worm3d.physics.hysteresis import HYSTERESIS_PREFIX, Hysteresis, chamber_states
from worm3d.physics.kernels import GREATEST_CONTRACTION, actuator, joint, load, medium, node, point, segment
from worm3d.physics.kernels.layout import Layout, once
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.physics.load import LOAD_STICKING, Load
from worm3d.physics.media import Medium
from worm3d.physics.segment_laws.law import SegmentLaw, columns_of
from worm3d.physics.segment_laws.shapes import Rhombus
from worm3d.physics.worm import Worm
from worm3d.recorded.state import State, StateError
from worm3d.recorded.status import Status
from worm3d.solver import arrays
from worm3d.solver.arrays import CoreMemory, Sizes
from worm3d.solver.evaluate import DIRECTOR, TANGENT, evaluate_entry
from worm3d.solver.guard import CHAMBER_SIDES, refused
from worm3d.solver.newton import solve_entry
from worm3d.solver.pose import put_entry
from worm3d.solver.records import Records
from worm3d.solver.step import step_entry
from worm3d.values.arrays import FloatArray
from worm3d.worlds import World, WorldKernel
from worm3d.worlds.plane import Plane

DOMAIN_ROUNDING = 1e-9
"""Length by which a chamber may be outside the domain of a segment law, as a fraction of the segment length. Rounding
errors of actuators are a millionth of this value. A tenth and ten times this value have the same effect."""

SUNK_DEPTH = 0.1
"""A joint that lies deeper in the world than this fraction of the segment length has sunk, which ends the run."""

MIN_NEWTON_TOLERANCE = 2e-15
"""Smallest tolerance of Newton's method, as a fraction of the body length. Smaller Newton steps are rounding errors."""

ROLL_DAMPING = 1e-7
"""Damping of the roll [N m s] of a worm whose mass lies on the axis, divided by the sum of the largest stiffnesses of
the worm [J]. The unit of the quotient is s.

The roll of such a worm has no inertia and, in the air, no stiffness. Newton's matrix would be singular without this
damping. A tenth of this value and ten times this value work equally well.
"""

MASSLESS = 1e-3
"""The damping of roll acts if less than this share of a segment's mass lies off the axis. The damping has its full
value if no mass lies off the axis."""

HISTORIES = [name for name, row in arrays.ARRAYS.items() if row.history]
"""Names of the arrays that hold the values at two instants, at the present instant first."""


def kernels(
    law: type[FrictionLaw] = Coulomb,
    chamber: type[Actuator] = FirstOrder,
    hinge: type[Actuator] = FirstOrder,
    own: type[Hysteresis] = Hysteresis,
    around: type[Medium] = Medium,
    loads: tuple[type[Load], ...] = (),
    segment_law: type[SegmentLaw] = Rhombus,
    sensing: bool = False,
) -> dict[str, Kernel]:
    """Return the compiled kernels by name.

    The arguments are the classes of the friction law, the actuators of chambers and hinges, the friction in the joints,
    the medium, the loads, and the segment law; and whether to include the kernels of sensitivities.
    """
    parts: dict[str, tuple[type, ...]] = {
        "law": (law,),
        "segment": (segment_law,),
        "chamber": (chamber, own, segment_law),
        "hinge": (hinge,),
        "medium": (around,),
        "load": loads,
        "": (),
    }
    rows = {name: row for name, row in arrays.KERNELS.items() if sensing or not row.sensing}
    made = {name: _kernel(name, *parts[row.of]) for name, row in rows.items()}
    return {name: kernel for name, kernel in made.items() if kernel is not None}


@once
def _kernel(name: str, *part: type) -> Kernel | None:
    row = arrays.KERNELS[name]
    function = None if row.make is None else row.make(*part)
    return None if function is None else compile_kernel(function, padded=row.padded, exact=row.exact)


@cache
def entries() -> dict[str, Any]:
    """Return the functions of the solver that are compiled once and called by address, by name."""
    functions = {"evaluate": evaluate_entry, "solve": solve_entry, "step": step_entry, "put": put_entry}
    return {name: cfunc(function, missed=announce) for name, function in functions.items()}


def _addresses(world: WorldKernel, made: Mapping[str, Kernel]) -> NDArray[np.int64]:
    """Return the addresses of the kernels in the order of `worm3d.solver.arrays.KERNELS`, 0 for unused kernels."""
    addresses = {"world": world.address, **{name: kernel.address for name, kernel in made.items()}}
    addresses |= {name: entry.address for name, entry in entries().items()}
    return np.array([addresses.get(name, 0) for name in arrays.KERNELS], dtype=np.int64)


def _roll_damping(worm: Worm) -> FloatArray:
    """Return the damping of roll of each segment, C of `worm3d.physics.kernels.segment`, shape (N,) [N m s]."""
    share = worm.apex_mass.sum(axis=1) / (MASSLESS * worm.mass / worm.segments)
    stiffness = sum(float(np.max(k, initial=0.0)) for k in (worm.k_spring * worm.l0, worm.k_torsion, worm.k_twist))
    damping: FloatArray = ROLL_DAMPING * stiffness * np.maximum(0.0, 1.0 - share)
    return damping


class Plant:
    """The arrays of a worm on a world, with the methods that fill and read these arrays.

    `held` marks the coordinates that stay fixed among the 5 (N+1) coordinates. The contact stiffness is proportional to
    the length of `scale`, shape (3,) [m/s^2]. The default of `scale` is `gravity`.
    """

    def __init__(
        self,
        worm: Worm,
        world: World | None,
        friction: Friction,
        gravity: FloatArray,
        held: NDArray[np.bool_],
        scale: FloatArray | None = None,
    ) -> None:
        self.worm, self.world, self.friction, self.gravity = worm, world, friction, gravity
        self._weight = float(np.linalg.norm(gravity if scale is None else scale))
        self.n = worm.segments
        chamber, hinge = worm.actuator.compiled(), worm.hinge_actuator.compiled()
        own, law = type(worm.hysteresis), type(worm.segment)
        around, loads = type(worm.medium), tuple(map(type, worm.loads))
        self._classes = type(friction.law), chamber, hinge, own, around, loads, law
        self._kernels = kernels(*self._classes)
        if chamber.__module__.partition(".")[0] != "worm3d":  # the tests of worm3d check its own actuators
            warn_of_imbalance(worm)
        width = max(vectors.VECTOR_WIDTH, *(kernel.width for kernel in self._kernels.values()))
        lanes, joint_lanes, nodes = (-(-count // width) * width for count in (self.n, max(self.n - 1, 1), self.n + 1))
        self.world_kernel = (world or Plane()).kernel()  # without a world, no contact acts on this plane
        world_rows = 3 + len(self.world_kernel.parameters)
        bounds = worm.segment.domain(worm).shortest.shape[1]
        sizes = Sizes(self.n, lanes, joint_lanes, nodes, world_rows, bounds, law, chamber, own, hinge, around, loads)
        self._open(CoreMemory(sizes, _addresses(self.world_kernel, self._kernels)))
        self.arrays["held"][0] = held
        self._fill_numbers()
        self._fill_segments()
        self._fill_joints()
        self._fill_points()
        self._fill_actuators()
        self._fill_medium()
        self._fill_external_loads()

    def _open(self, memory: CoreMemory) -> None:
        self.memory_of_core, self.core, self.arrays = memory, memory.core, memory.arrays
        self.arrays["world_in"][3:] = self.world_kernel.parameters[:, None]

    def copy(self) -> Plant:
        """Return an independent copy of the worm in the same state."""
        other = copy.copy(self)
        other.world_kernel = (self.world or Plane()).kernel()  # each copy needs its own working memory
        other._open(self.memory_of_core.copy(_addresses(other.world_kernel, self._kernels)))
        return other

    def sensing(self, parameters: int) -> Plant:
        """Return an independent copy in the same state, with room for the sensitivities to a number of parameters."""
        other = copy.copy(self)
        other.world_kernel, other._kernels = (self.world or Plane()).kernel(), kernels(*self._classes, sensing=True)
        sizes = self.memory_of_core.sizes._replace(parameters=parameters)
        memory = CoreMemory(sizes, _addresses(other.world_kernel, other._kernels))
        for name, array in self.arrays.items():
            if memory.arrays[name].shape == array.shape:
                memory.arrays[name][:] = array
        other._open(memory)
        return other

    @property
    def clamped(self) -> bool:
        """Whether the world is the clamped ground of the paper."""
        return self.world is not None and self.world.clamped

    @property
    def touches(self) -> bool:
        """Whether contacts act, i.e. there is a world and it is not the clamped ground of the paper."""
        return self.world is not None and not self.clamped

    def _fill_numbers(self) -> None:
        worm, n = self.worm, self.n
        numbers = {
            "l0": worm.l0,
            "deepest": np.inf if not self.touches else SUNK_DEPTH * worm.l0 if worm.end_faces else 0.0,
            "static_ratio": self.friction.static_ratio,
            "length": worm.length,
            "tolerance": MIN_NEWTON_TOLERANCE,
            "lever": 0.5 * worm.l0,
            "clamped": float(self.clamped),
            "ratio": 1.0,
            "allowed": np.inf,
            "error": 0.0,
            "mass": float(np.sum(worm.apex_mass) + np.sum(worm.joint_mass)),
            "threshold": 0.0 if self.world is None else self.world.velocity_threshold,
            **dict(zip(("gravity_x", "gravity_y", "gravity_z"), self.gravity, strict=True)),
        }
        self.arrays["numbers"][0] = [numbers[name] for name in arrays.NUMBER_NAMES]
        drag = np.full(n + 1, worm.drag / n)
        drag[[0, -1]] /= 2.0
        mu = self.friction.coefficients(n)
        self.arrays["point_mass"][:6, :n] = worm.apex_mass.T
        self.arrays["joint_mass"][0, : n + 1], self.arrays["drag"][0, : n + 1] = worm.joint_mass, drag
        node.NODE_LAYOUT.of("weight", self.arrays["node_in"])[:] = self.arrays["joint_mass"] * self.gravity[:, None]
        self.arrays["joint_mu"][:] = 0.5 * (np.column_stack([mu[:, :1], mu]) + np.column_stack([mu, mu[:, -1:]]))
        self.arrays["longest"][0], domain = worm.segment.flattened_length(worm), worm.segment.domain(worm)
        slack = DOMAIN_ROUNDING * worm.l0
        rest = worm.l0 * (1.0 - domain.greatest) - slack, worm.l0 * (1.0 - domain.least) + slack
        self.arrays["domain"][:] = *rest, *(domain.shortest.T - slack), *(domain.longest.T + slack)
        self.arrays["stuck"][:] = 1.0

    def _put(self, rows: Layout, array: str, count: int, values: Mapping[str, Any], prefix: str = "") -> None:
        """Write values to the first `count` lanes of an array.

        `rows` gives the rows of the array for the name of each value, with `prefix` in front of the name.
        """
        for name, value in values.items():
            rows.of(prefix + name, self.arrays[array])[:, :count] = value

    def _segment_row(self, name: str) -> FloatArray:  # (size, N)
        return segment.SEGMENT_LAYOUT.of(name, self.arrays["segment_in"])[:, : self.n]

    def _joint_row(self, name: str) -> FloatArray:  # (size, N-1)
        return joint.JOINT_LAYOUT.of(name, self.arrays["joint_in"])[:, : self.n - 1]

    def _point_row(self, name: str) -> FloatArray:  # (size, 8, lanes)
        rows = point.POINT_LAYOUT.of(name, self.arrays["point_in"])
        return rows.reshape(len(rows), POINTS_PER_SEGMENT, -1)

    def _fill_segments(self) -> None:
        worm, law = self.worm, type(self.worm.segment)
        rows: dict[str, Any] = {
            "roll_damping": _roll_damping(worm),
            "commanded": worm.l0,
            "commanded_n": worm.l0,
            **{segment.kernel_name(law, name): each for name, each in columns_of(worm.segment, worm).items()},
        }
        self._put(segment.layout(law), "formed", self.n, rows)
        if worm.end_faces:
            radius = worm.segment.face_radius(worm)
            self._segment_row("radius")[0, 0], self._segment_row("radius")[1, -1] = radius[0], radius[-1]

    def _fill_joints(self) -> None:
        worm = self.worm
        self._joint_row("k")[:] = [worm.k_torsion, worm.k_yaw, worm.k_twist]
        self._joint_row("tau")[:], self._joint_row("cross0")[:] = worm.kelvin_voigt_time, worm.cross0

    def _fill_points(self) -> None:
        constants = ContactConstants.of(self.worm, self.friction, self._weight)
        touching = np.zeros((POINTS_PER_SEGMENT, self.n))
        if self.touches:
            touching[:6] = 1.0
            touching[[2, 5]] *= self.worm.outward_apexes
            touching[6] = touching[7, -1] = float(self.worm.end_faces)
        self._point_row("stiffness")[0, :, : self.n] = constants.stiffness * touching
        self._point_row("damping")[0, :, : self.n] = constants.damping * touching
        self._point_row("yield_gauge")[:] = constants.yield_gauge
        self._point_row("gauge_damping")[:] = constants.gauge_damping
        self._point_row("mu")[:] = self._point_row("hardness")[:] = 1.0
        self._point_row("mu")[:, :, : self.n] = constants.mu[:, None, :]
        self._point_row("hardness")[:, :, : self.n] = constants.hardness[:, None, :]
        law = self.friction.law.rows(self.n)[:, None, :]
        self._point_row("law")[:] = law[:, :, -1:]  # lanes without a segment also need allowed values
        self._point_row("law")[:, :, : self.n] = law
        self._point_row("weight")[:] = self.arrays["point_mass"] * self.gravity[:, None, None]
        self._point_row("tangent")[[0, 4]] = 1.0
        self.arrays["rest"][[TANGENT, DIRECTOR + 2]] = 1.0  # lanes without a segment also need unit vectors
        self._point_row("dt")[:] = self._point_row("limit_ratio")[:] = 1.0

    def _fill_actuators(self) -> None:
        worm, n = self.worm, self.n
        chambers, hinges = self._layouts()
        friction = {HYSTERESIS_PREFIX + name: value for name, value in worm.hysteresis.parameters().items()}
        own = {**worm.actuator.values(worm, hinge=False), **friction}
        self._put(chambers, "actuated", n, own, segment.ACTUATOR_PREFIX)
        self._put(hinges, "hinged", n - 1, worm.hinge_actuator.values(worm, hinge=True), segment.ACTUATOR_PREFIX)
        self.hasten(1.0)

    def _fill_medium(self) -> None:
        rows = medium.layout(type(self.worm.medium))
        if rows.rows:
            self.arrays["medium_in"][medium.SHARE, : self.n] = self.worm.drag / self.n
            self._put(rows, "medium_in", self.n, self.worm.medium.parameters(), medium.MEDIUM_PREFIX)

    def _fill_external_loads(self) -> None:
        loads, rows = self.worm.loads, load.layout(*map(type, self.worm.loads))
        if not loads:
            return
        constants = ContactConstants.of(self.worm, self.friction, self._weight)
        damping = TANGENTIAL_DAMPING_RATIO * constants.damping.max()
        self._put(rows, "load_in", 1, {"gravity": self.gravity[:, None], "touches": float(self.touches)})
        self._put(rows, "load_in", 1, {"stiffness": constants.stiffness.max(), "damping": damping})
        for k, each in enumerate(loads):
            self._put(rows, "load_in", 1, each.values(self.worm), f"{k}_")
        self.arrays["loaded"][0] = [each.at % (self.n + 1) for each in loads]

    def _begin_external_loads(self) -> None:
        """Set the states of the loads for the present pose."""
        begun: list[float] = [LOAD_STICKING] * len(self.worm.loads)
        for each in self.worm.loads:
            j = each.at % (self.n + 1)
            tangent = self._segment_row("t_ref")[:, min(j, self.n - 1)]
            states = each.begin(self.worm, self.arrays["joints"][:3, j], tangent)
            begun += [states[name] for name in each.states]
        self.arrays["loads"][0] = begun

    def hasten(self, times: float) -> None:
        """Speed up the actuators by the factor `times`. Unless `times` is 1, there is no friction in the joints."""
        for layout, name in zip(self._layouts(), ("actuated", "hinged"), strict=True):
            layout.of(segment.ACTUATOR_PREFIX + actuator.HASTE, self.arrays[name])[:] = times

    def _layouts(self) -> tuple[Layout, Layout]:
        """Return the layouts of the arrays "actuated" and "hinged"."""
        worm = self.worm
        chambers = actuator.chambers(worm.actuator.compiled(), type(worm.hysteresis), type(worm.segment))
        return chambers, actuator.hinges(worm.hinge_actuator.compiled())

    @property
    def natural_time(self) -> float:
        """Time that a body takes to fall half the body length [s]; see `worm3d.physics.friction.natural_time`."""
        return natural_time(self.worm, self._weight)

    def refused(self, status: Status) -> tuple[int, str]:
        """Return the segment that caused a step to be refused with this status, and the reason in words."""
        return self._not_finite() if status is Status.NOT_FINITE else refused(self.arrays, self.n, status)

    def _not_finite(self) -> tuple[int, str]:
        """Return the segment or joint of an actuator with an output that is not finite, and an error message."""
        worm, n, a = self.worm, self.n, self.arrays
        started = a["actuator_start"][:, :n].reshape(-1, actuator.ACTUATORS_PER_SEGMENT, n)
        known = list(zip(("command", "spring", "force", "given"), started, strict=True))
        if "actuator_end" in self._kernels:
            energy, rows = np.split(a["actuator_out"][:, :n], [actuator.LEDGER_ROWS])
            names = ("given", *chamber_states(type(worm.actuator), type(worm.hysteresis)))
            known += zip(names, rows.reshape(-1, actuator.ACTUATORS_PER_SEGMENT, n), strict=True)
            known.append(("energy", energy.sum(axis=0)[None]))
        for name, values in known:
            for side, i in np.argwhere(~np.isfinite(values)):
                where = f"segment {i}" if name == "energy" else f"the {CHAMBER_SIDES[side]} chamber of segment {i}"
                return int(i), f"actuator: {type(worm.actuator).__name__} gives no finite {name} for {where}"
        hinges = a["hinge_out"][:, : n - 1]
        for name, row in zip(("command", "given", *type(worm.hinge_actuator).states), hinges, strict=True):
            for (i,) in np.argwhere(~np.isfinite(row)):
                what = f"{type(worm.hinge_actuator).__name__} gives no finite {name} for joint {i + 1}"
                return int(i) + 1, f"hinge_actuator: {what}"
        return 0, ""

    def records(self, rows: int, between: bool = False) -> Records:
        """Return empty records for `rows` instants of this worm. `between` is explained in `Records`."""
        return Records(self.memory_of_core, self.worm, self.clamped, rows, between)

    def memory(self) -> dict[str, FloatArray]:
        """Return copies of all arrays that the next step depends on, by name."""
        return {name: array.copy() for name, array in self.memory_of_core.remembered().items()}

    def remember(self, memory: Mapping[str, FloatArray]) -> None:
        """Restore the arrays returned by `memory`.

        Raises
        ------
        StateError
            The memory belongs to another worm, or to a computer with vectors of another length.
        """
        for name, view in self.memory_of_core.remembered().items():
            value = memory.get(name)
            if value is None or value.shape != view.shape:
                got = "nothing" if value is None else f"shape {value.shape}"
                raise StateError(
                    f"state.memory: got {got} for {name!r}, must be of shape {view.shape}: it belongs to another worm "
                    "or kind of computer; drop it with state.with_changes() to start afresh from the pose"
                )
            view[...] = value

    def set_pose(self, state: State) -> None:
        """Set the pose, contraction and velocities of a state, without the friction forces stored in its memory."""
        n, x, rate = self.n, self.arrays["x"].reshape(-1, BLOCK_SIZE), np.zeros((self.n + 1, BLOCK_SIZE))
        x[:, :3], x[:n, 4] = state.joints, state.bend
        self._segment_row("d_ref")[:] = state.directors.T
        self.arrays["asked"][0, : 2 * n] = state.contraction.ravel()
        rate[:, :3], rate[:n, 3], rate[:n, 4] = state.joint_velocity, state.roll_rate, state.bend_rate
        self.arrays["trial"][0] = rate.ravel()
        entries()["put"](self.core.handle, 0.0, 0, 0)
        self._begin_external_loads()

    def reset_at_pose(self) -> None:
        """Set the worm to rest in its present pose.

        The anchors of static friction move to the contact points, and the values of the previous instant become the
        present values. The normal loads do not change.
        """
        entries()["put"](self.core.handle, 0.0, 1, 0)

    def set_normal_loads(self, load: FloatArray) -> None:
        """Set the normal loads of a worm at rest, shape (8, N) [N], and contact forces without friction."""
        self.normal_loads()[:] = load
        force = self.arrays["contact_force"].reshape(3, POINTS_PER_SEGMENT, -1)
        force[:, :, : self.n] = load * self._point_row("normal")[:, :, : self.n]

    def zero_velocities(self) -> None:
        """Set the velocities and the energy ledger to zero, and the previous instant to the present values.

        Pose, loads and anchors do not change.
        """
        for name in HISTORIES:
            rows = self.arrays[name]
            rows[len(rows) // 2 :] = rows[: len(rows) // 2]
        for name in ("joint_velocity", "point_velocity", "last", "curve", "terms", "slid"):
            self.arrays[name][:] = 0.0

    def normal_loads(self) -> FloatArray:
        """Return a view of the normal load of each contact point at the end of the last step, shape (8, N) [N]."""
        return self._point_row("load_n")[0, :, : self.n]

    def state(self, time: float, dt: float = np.inf, **more: FloatArray) -> State:
        """Return the present state. Its memory has all arrays of `memory`, and the arrays `more`.

        `dt` is the length of the last time step [s], for the rates of roll and bend.
        """
        n, a = self.n, self.arrays
        rates = a["last"].reshape(-1, BLOCK_SIZE)[:n] / dt
        return State.unchecked(
            joints=a["joints"][:3, : n + 1].T.copy(),
            directors=self._segment_row("d_ref").T.copy(),
            bend=a["x"].reshape(-1, BLOCK_SIZE)[:n, 4].copy(),
            joint_velocity=a["joint_velocity"][:3, : n + 1].T.copy(),
            roll_rate=rates[:, 3].copy(),
            bend_rate=rates[:, 4].copy(),
            contraction=np.minimum(a["given"][0, : 2 * n].reshape(n, 2), GREATEST_CONTRACTION),
            time=time,
            laid=False,
            memory=self.memory() | more,
        )

    def _distances(self) -> FloatArray:
        """Return the distances of the contact points from the world, infinite for unused points, shape (8, N) [m]."""
        active = self._point_row("stiffness")[0, :, : self.n] > 0.0
        return np.where(active, self._point_row("distance")[0, :, : self.n], np.inf)

    def gap(self) -> float:
        """Return the smallest distance of a contact point from the world, infinite without contact points [m]."""
        return float(self._distances().min())

    def depth(self) -> FloatArray:
        """Return the depth of each contact point in the world, 0 for points outside, shape (8, N) [m]."""
        depth: FloatArray = np.maximum(0.0, -self._distances())
        return depth
