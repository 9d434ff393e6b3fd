"""What a run gives back."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from worm3d import metrics, roll
from worm3d.solver.arrays import TERMS
from worm3d.state import State
from worm3d.status import Status, Stop
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly, brief, listed, read_only
from worm3d.worlds import World
from worm3d.worm import Worm

INCOMING = ("work_contract", "work_external", "load_change")
STORED = ("kinetic", "elastic", "potential", "penetration", "anchor", "actuator")
LOST = ("friction_loss", "viscous_loss", "impact", "numerical_loss", "actuator_loss")
USES = ("friction", "damping", "impact", "numerical", "gained")

HEADLINES = ("distance_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J", "cost_of_transport")
"""Figures of merit with which a result is printed."""


@dataclass(frozen=True, eq=False)
class Energy(ReadOnly):
    """Energy ledger, each term of shape (T,): of the steps since the row before, 0 at the start [J].

    Attributes
    ----------
    work_contract, work_external, load_change : ndarray
        What comes in: actuators, external forces, anchor energy changed by loads and turning tangents.
    kinetic, elastic, potential, penetration, anchor, actuator : ndarray
        Changes of energy; the last is that kept within the actuators.
    friction_loss, viscous_loss, impact, numerical_loss, actuator_loss : ndarray
        What is lost: to friction, to the damping of the material and the medium, in impacts on the world, by the
        integrator (of either sign), and within the actuators.
    drag_loss : ndarray
        The part of the viscous loss that the medium takes.
    work_contract_positive : ndarray
        Sum of the positive work of the actuators, step by step.
    work_contract_p11, work_friction_p13 : ndarray
        The paper's F.dq of the contraction and of the friction force; not part of the sum.
    """

    work_contract: FloatArray
    work_external: FloatArray
    load_change: FloatArray
    kinetic: FloatArray
    elastic: FloatArray
    potential: FloatArray
    penetration: FloatArray
    anchor: FloatArray
    friction_loss: FloatArray
    viscous_loss: FloatArray
    impact: FloatArray
    numerical_loss: FloatArray
    drag_loss: FloatArray
    work_contract_positive: FloatArray
    work_contract_p11: FloatArray
    work_friction_p13: FloatArray
    actuator: FloatArray
    actuator_loss: FloatArray

    @classmethod
    def of(cls, rows: FloatArray) -> Energy:
        """Return the ledger of records, shape (T, 18)."""
        return cls(**dict(zip(TERMS, rows.T, strict=True)))

    def _sum(self, names: tuple[str, ...]) -> FloatArray:
        total: FloatArray = np.sum([getattr(self, name) for name in names], axis=0)
        return total

    @property
    def residual(self) -> FloatArray:
        """What comes in less what is stored or lost, shape (T,) [J]: zero up to Newton's residual."""
        return self._sum(INCOMING) - self._sum(STORED) - self._sum(LOST)

    @property
    def uses(self) -> dict[str, float]:
        """What the work of actuators and of external forces went into, by name: together it is that work [J].

        Friction, damping (of the material, by the medium and in the actuators), impacts, the integrator, and the energy
        that is stored at the end and was not at the start (kinetic, elastic, potential, of contacts and actuators).
        """
        gained = self._sum(STORED) - self.load_change
        damped = self.viscous_loss + self.actuator_loss
        parts = (self.friction_loss, damped, self.impact, self.numerical_loss, gained)
        return {name: float(part.sum()) for name, part in zip(USES, parts, strict=True)}

    @property
    def balance_error(self) -> float:
        """|Residual of the run| over the sum of its absolute terms."""
        scale = sum(float(np.abs(getattr(self, name)).sum()) for name in (*INCOMING, *STORED, *LOST))
        return abs(float(self.residual.sum())) / scale if scale > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Result(ReadOnly):
    """A run; T recorded instants, S finished steps, N segments; complete up to the last finished step.

    Attributes
    ----------
    worm, world
        What was simulated.
    gravity : ndarray, shape (3,)
        [m/s^2]
    dt : float
        Time step [s].
    period : float or None
        Of the gait, over which speeds are averaged [s].
    time : ndarray, shape (T,)
        [s]
    joints, joint_velocity : ndarray, shape (T, N+1, 3)
        [m], [m/s]
    points : ndarray, shape (T, N, 8, 3)
        Six apexes, tail and head face (inner joints) of each segment [m].
    directors : ndarray, shape (T, N, 3)
        To the left of each segment.
    bend : ndarray, shape (T, N)
        [rad]
    chamber_length : ndarray, shape (T, N, 2)
        [left, right] [m]
    command, contraction : ndarray, shape (T, N, 2)
        Contraction asked for (clipped to the stroke), and given by the actuators.
    hinge : ndarray, shape (T, N-1)
        Given by the actuators [rad].
    force : ndarray, shape (T, N, 2)
        Chamber forces given by the actuators [N].
    com, momentum, angular_momentum : ndarray, shape (T, 3)
        [m], [kg m/s], about the origin [kg m^2/s].
    normal_load, slip : ndarray, shape (T, N, 6)
        Load of each apex [N]; metres slid since the row before [m].
    joint_load, joint_slip : ndarray, shape (T, N+1)
        Likewise of end faces and inner joints (of all joints, (P9), for the clamped worm).
    contact_force : ndarray, shape (T, N, 8, 3)
        Of the world on each point: normal load and friction together; at the start of a run without friction [N].
    joint_friction : ndarray, shape (T, N+1, 3)
        (P10) on the joints of the clamped worm; else 0 [N].
    anchors : ndarray, shape (T, N, 8, 3)
        Where the contacts stick [m].
    energy : Energy
    newton_iterations, gradient_evaluations, breakaways, fallbacks : ndarray, shape (S,)
        Of each step: evaluations with a new Jacobian, whole or in part, further ones of the residual, rounds of
        contacts breaking away, and times that Newton fell back to descent.
    halved_steps : int
        Steps that had to be taken in parts.
    settling : float or None
        How far the joints have moved, at most, while the worm was brought to rest before the run [m]; None where it
        was not (`settle_first` of `worm3d.simulate`).
    state : State
        At the end, with memory: a run from it goes on bit for bit.
    stop : Stop
    wall_s : float
        Wall time of the steps [s].
    """

    worm: Worm
    world: World | None
    gravity: FloatArray
    dt: float
    period: float | None
    time: FloatArray
    joints: FloatArray
    joint_velocity: FloatArray
    points: FloatArray
    directors: FloatArray
    bend: FloatArray
    chamber_length: FloatArray
    command: FloatArray
    contraction: FloatArray
    hinge: FloatArray
    force: FloatArray
    com: FloatArray
    momentum: FloatArray
    angular_momentum: FloatArray
    normal_load: FloatArray
    slip: FloatArray
    joint_load: FloatArray
    joint_slip: FloatArray
    contact_force: FloatArray
    joint_friction: FloatArray
    anchors: FloatArray
    energy: Energy
    newton_iterations: NDArray[np.int64]
    gradient_evaluations: NDArray[np.int64]
    breakaways: NDArray[np.int64]
    fallbacks: NDArray[np.int64]
    halved_steps: int
    settling: float | None
    state: State = field(repr=False)
    stop: Stop
    wall_s: float

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.stop.status

    @property
    def settled(self) -> bool:
        """Whether the worm was brought to rest on its world before the run."""
        return self.settling is not None

    @property
    def apexes(self) -> FloatArray:
        """Apexes in the order of the conventions, shape (T, N, 6, 3) [m]."""
        return self.points[:, :, :6]

    @property
    def end_load(self) -> FloatArray:
        """Load of the end faces [tail, head], shape (T, 2) [N]."""
        load: FloatArray = read_only(self.joint_load[:, [0, -1]])
        return load

    @property
    def com_velocity(self) -> FloatArray:
        """Velocity of the centre of mass, shape (T, 3) [m/s]."""
        velocity: FloatArray = read_only(self.momentum / self.worm.mass)
        return velocity

    @cached_property
    def on_its_side(self) -> float | None:
        """When the worm began to lie on its side [s]; None if it did not, or there is no ground (`worm3d.roll`)."""
        return roll.on_its_side(self)

    @cached_property
    def heading(self) -> FloatArray:
        """Azimuth of the tail-to-head chord, unwrapped, shape (T,) [rad]; NaN where the body is vertical."""
        heading: FloatArray = read_only(metrics.heading(self.joints))
        return heading

    @cached_property
    def chamber_strain(self) -> FloatArray:
        """Length over rest length less 1, shape (T, N, 2)."""
        strain: FloatArray = read_only(self.chamber_length / self.worm.l0 - 1.0)
        return strain

    @property
    def distance(self) -> float:
        """Displacement of the centre of mass along the initial heading, within the surface's tangent plane [m]."""
        return metrics.distance(self.com, self.joints[0], self.world)

    def __repr__(self) -> str:
        worm, figures = self.worm, {**dict.fromkeys(HEADLINES), **self.summary()}
        merits = (f"{name} {figures[name]:.4g}" for name in HEADLINES if isinstance(figures[name], float))
        return listed(
            (
                f"Result: {self.stop.sentence}",
                f"  {len(self.time)} rows of {len(self.newton_iterations)} steps of {self.dt:g} s; {worm.segments} "
                f"segments, {worm.length:g} m, {worm.mass:g} kg on {brief(self.world)}",
                f"  {', '.join(merits)}",
                "  arrays: time, joints, com, heading, chamber_length, normal_load, slip, energy, and others",
                "  summary() has all figures of merit, worm3d.draw(result, 'viewer.html') shows the run",
            )
        )

    def _repr_html_(self) -> str:
        """Show the run in a notebook cell, and what it came to."""
        from worm3d.pictures import show

        figures = (f"{name} = {figure:.6g}" for name, figure in self.summary().items() if isinstance(figure, float))
        return f"<p>{self.stop.sentence}: {', '.join(figures)}</p>{show(self)._repr_html_()}"

    def summary(self) -> dict[str, float | str | None]:
        """Return the figures of merit of the run; None where one has no value (`reasons`)."""
        return metrics.summary(self)

    def reasons(self) -> dict[str, str]:
        """Return why figures of the summary have no value."""
        return metrics.reasons(self)
