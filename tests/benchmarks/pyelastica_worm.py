"""PyElastica on the task: a Cosserat rod with one element a segment and commanded rest lengths.

Stiffness (PE1), per element of rest length l0 or per joint, from the worm's: EA = k, EI and GJ = joint stiffness x l0;
shear as stiff as stretch, since the rod cannot be unshearable. Inertia about the element's own axes is that of the
apexes. Contraction c shortens the rest length to l0 (1 - c), and (P7) stiffens with it; since the rod divides its
stress by the stretch e,

    n = S (e - (1 - c))/e   with S = k/(1 - c)   has the worm's tangent stiffness k/(1 - c)^2 at e = 1 - c.

Damping (PE2): PyElastica's dampers act on velocities, like a viscous medium. Kelvin-Voigt damping of stretch, bending
and twist enters through its interface for dampers, implicitly, so that it does not limit the step: with the
relative rates s = D v of neighbours and the damping coefficients C,

    s' = s - dt D M^-1 D^T C s',   v' = v - dt M^-1 D^T C s',   a tridiagonal system for the impulses dt C s'.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import elastica
import numpy as np
from rivals import Rival, Task
from scipy.signal import lfilter

from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

SLIP_SPEED = 3e-4
"""Below it friction is static [m/s]; a tenth of it changes the distance by 1 %."""
CONTACT_RATE = 300.0
"""Natural frequency of an element on the ground's penalty, critically damped [rad/s]."""


class Simulation(elastica.BaseSystemCollection, elastica.Forcing, elastica.Contact, elastica.Damping):
    """A rod on a plane."""


class Contraction(elastica.NoForces):
    """Sets the rest lengths of the elements, (PE1).

    Parameters
    ----------
    contractions : ndarray, shape (T, N)
        Of the elements when the internal forces are computed, step by step.
    stiffness : ndarray, shape (N,)
        EA at rest [N].
    """

    def __init__(self, contractions: FloatArray, stiffness: FloatArray) -> None:
        super().__init__()
        self.contractions = iter(contractions)
        self.stiffness = stiffness

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        """Command the lengths of the next step: this step's internal forces are computed already."""
        _command(system.rest_sigma, system.shear_matrix, next(self.contractions), self.stiffness)


class KelvinVoigt(elastica.DamperBase):
    """Damps the rates of stretch, bending and twist, (PE2).

    Parameters
    ----------
    dt : float
        [s].
    stretch : ndarray, shape (N,)
        Damping of the elements' rates of length [N s/m].
    joints : ndarray, shape (3, N-1)
        Damping of the relative angular velocities of neighbouring elements, in their own axes [N m s].
    """

    def __init__(self, dt: float, stretch: FloatArray, joints: FloatArray, **options: Any) -> None:
        super().__init__(**options)
        self.dt = dt
        self.stretch = stretch
        self.joints = joints

    def dampen_rates(self, system: Any, time: float) -> None:
        """Damp the velocities of the nodes and the angular velocities of the elements."""
        _damp_stretch(system.velocity_collection, system.tangents, system.mass, self.dt * self.stretch)
        _damp_joints(system.omega_collection, system.inv_mass_second_moment_of_inertia, self.dt * self.joints)


class PyElasticaWorm(Rival):
    """The worm in PyElastica."""

    name = f"PyElastica {version('pyelastica')}"
    cannot = (
        "the rhombus: elements widen at constant volume (at 20 % contraction by 12 % instead of 41 %, for 6 segments)",
        "apexes: an element touches below its middle, in one place, and its ends never",
        "unequal chambers: their bend is merged with the yaw of the joints",
        "a rod that does not shear: it shears as easily as it stretches",
        "exact sticking: friction is static below 0.3 mm/s and blends into kinetic up to twice that",
        "Kelvin-Voigt damping and actuator lag of its own: both are added from outside",
    )

    def settings(self, segments: int) -> str:
        """Return the configuration it runs in, in words."""
        return f"position Verlet, {segments} elements, implicit Kelvin-Voigt damper"

    def prepare(self, task: Task, duration: float, steps: int) -> Callable[[], float]:
        """Return a simulation, ready to go: called once, it returns the distance along x [m]."""
        dt = duration / steps
        rod, simulation = _simulation(task, dt, steps)
        stepper = elastica.PositionVerlet()
        start = _centre_of_mass(rod)

        def go() -> float:
            time = 0.0
            for _ in range(steps):
                time = stepper.step(simulation, time, dt)
            return _centre_of_mass(rod) - start

        return go


def _centre_of_mass(rod: Any) -> float:
    """Return x of the centre of mass [m]; infinite or NaN if the run was unstable."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(rod.mass @ rod.position_collection[0] / rod.mass.sum())


def _simulation(task: Task, dt: float, steps: int) -> tuple[Any, Simulation]:
    """Return the rod, and the rod with all that acts on it."""
    rod, ground, simulation = _rod(task), elastica.Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), Simulation()
    simulation.append(rod)
    simulation.append(ground)
    simulation.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0.0, 0.0, -9.81]))
    k = np.asarray(task.worm.k_spring)
    simulation.add_forcing_to(rod).using(Contraction, _lagged(task, dt, steps), k)
    _stand(simulation, rod, ground, task)
    time = task.worm.kelvin_voigt_time
    joints = time * np.array([task.yaw, task.pitch, task.twist])
    simulation.dampen(rod).using(KelvinVoigt, dt=dt, stretch=time * k / task.worm.l0, joints=joints)
    simulation.finalize()
    return rod, simulation


def _stand(simulation: Simulation, rod: Any, ground: Any, task: Task) -> None:
    """Let the rod touch the ground."""
    friction = task.friction
    kinetic = np.array([friction.forward, friction.backward, friction.lateral])
    mass = task.worm.mass / task.worm.segments
    simulation.detect_contact_between(rod, ground).using(
        elastica.RodPlaneContactWithAnisotropicFriction,
        k=mass * CONTACT_RATE**2,
        nu=2.0 * mass * CONTACT_RATE,
        slip_velocity_tol=SLIP_SPEED,
        static_mu_array=friction.static_ratio * kinetic,
        kinetic_mu_array=kinetic,
    )


def _rod(task: Task) -> Any:
    """Return the rod at rest on the ground, (PE1); its axes are u (up), -d (to the right) and t."""
    worm, h = task.worm, float(np.asarray(task.worm.half_height)[0])
    section = np.pi * h**2
    k = np.asarray(worm.k_spring)
    rod = elastica.CosseratRod.straight_rod(
        worm.segments,
        start=np.array([0.0, 0.0, h]),
        direction=np.array([1.0, 0.0, 0.0]),
        normal=np.array([0.0, 0.0, 1.0]),
        base_length=worm.length,
        base_radius=h,
        density=worm.mass / (section * worm.length),
        youngs_modulus=k[0] / section,
    )
    _set_diagonal(rod.shear_matrix, np.array([k, k, k]))
    _set_diagonal(rod.bend_matrix, worm.l0 * np.array([task.yaw, task.pitch, task.twist]))
    b, apex = worm.chamber_offset, worm.apex_mass[:, 0]
    yaw, pitch = apex * (4.0 * b**2 + 2.0 * (b + h) ** 2), apex * 4.0 * h**2
    inertia = np.array([yaw, pitch, yaw + pitch])
    _set_diagonal(rod.mass_second_moment_of_inertia, inertia)
    _set_diagonal(rod.inv_mass_second_moment_of_inertia, 1.0 / inertia)
    return rod


def _set_diagonal(matrices: FloatArray, diagonals: FloatArray) -> None:
    """Set diagonal matrices, shape (3, 3, n), from their diagonals, shape (3, n)."""
    matrices[...] = np.eye(3)[:, :, None] * diagonals[None]


def _lagged(task: Task, dt: float, steps: int) -> FloatArray:
    """Return the contractions at the middle of steps 1 ... `steps`, after the actuator's lag, shape (steps, N).

    Step 0 is at rest.
    """
    commanded = task.contractions((np.arange(steps) + 1.0) * dt)
    keep = float(np.exp(-dt / task.worm.actuator_lag))
    lagged: FloatArray = lfilter([1.0 - keep], [1.0, -keep], commanded, axis=0)
    return lagged


@njit
def _command(rest_strain: FloatArray, stiffness: FloatArray, contraction: FloatArray, k: FloatArray) -> None:
    """Set the rest strain and the stiffness of stretch of each element, (PE1)."""
    for i in range(len(contraction)):
        rest_strain[2, i] = -contraction[i]
        stiffness[2, 2, i] = k[i] / (1.0 - contraction[i])


@njit
def _solve(below: FloatArray, diagonal: FloatArray, right: FloatArray) -> None:
    """Solve a symmetric tridiagonal system in place; below[i] couples i and i - 1."""
    for i in range(1, len(diagonal)):
        factor = below[i] / diagonal[i - 1]
        diagonal[i] -= factor * below[i]
        right[i] -= factor * right[i - 1]
    right[-1] /= diagonal[-1]
    for i in range(len(diagonal) - 2, -1, -1):
        right[i] = (right[i] - below[i + 1] * right[i + 1]) / diagonal[i]


@njit
def _damp_stretch(velocity: FloatArray, tangents: FloatArray, mass: FloatArray, damping: FloatArray) -> None:
    """Apply (PE2) along the elements; `damping` is dt C, shape (N,) [N s^2/m]."""
    n = len(damping)
    below, diagonal, impulse = np.zeros(n), np.empty(n), np.empty(n)
    for i in range(n):
        impulse[i] = 0.0
        for a in range(3):
            impulse[i] += tangents[a, i] * (velocity[a, i + 1] - velocity[a, i])
            if i > 0:
                below[i] -= tangents[a, i] * tangents[a, i - 1] / mass[i]
        diagonal[i] = 1.0 / damping[i] + 1.0 / mass[i] + 1.0 / mass[i + 1]
    _solve(below, diagonal, impulse)
    for i in range(n):
        for a in range(3):
            velocity[a, i] += impulse[i] * tangents[a, i] / mass[i]
            velocity[a, i + 1] -= impulse[i] * tangents[a, i] / mass[i + 1]


@njit
def _damp_joints(omega: FloatArray, inverse_inertia: FloatArray, damping: FloatArray) -> None:
    """Apply (PE2) to the joints, axis by axis; `damping` is dt C, shape (3, N-1) [N m s^2]."""
    n = damping.shape[1]
    below, diagonal, impulse = np.empty(n), np.empty(n), np.empty(n)
    for a in range(3):
        for j in range(n):
            impulse[j] = omega[a, j + 1] - omega[a, j]
            diagonal[j] = 1.0 / damping[a, j] + inverse_inertia[a, a, j] + inverse_inertia[a, a, j + 1]
            below[j] = -inverse_inertia[a, a, j]
        _solve(below, diagonal, impulse)
        for j in range(n):
            omega[a, j] += impulse[j] * inverse_inertia[a, a, j]
            omega[a, j + 1] -= impulse[j] * inverse_inertia[a, a, j + 1]
