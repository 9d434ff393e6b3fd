"""Energy ledger of a step, every term computed on its own.

Multiplying the residual of a step by dq = q_{n+1} - q_n gives, with J dq the first-order motion of a mass point,

    work of the actuators + of external forces + change of the anchors' energy by loads and turning tangents
    = change of kinetic, elastic, potential, penetration and anchor energy
      + friction loss + viscous loss + numerical loss - residual.dq

* Actuators: the integral of (dE/dl_cmd) dl_cmd over the change of command, likewise for hinges, by the trapezoidal
  rule (its difference to the command first and the motion then is numerical loss, of either sign); -F dl of chamber
  forces.
* Friction: N rho(motion of the anchor); (P10) as -F.dq for the clamped worm.
* Viscous: Kelvin-Voigt c rate^2 dt, medium (P8), the dampers of the contacts.
* Numerical: for inertia m [e_v.(V + V_n)/2 + A.e_x] with the defects of the integrator

      e_x = dX - dt (V + V_n)/2,   e_v = dt A - dV = 0 (implicit Euler) or (V - 2 V_n + V_{n-1})/2 (BDF2)

  (m |dV|^2/2 for implicit Euler); E_n - E_{n+1} + gradE_{n+1}.dq for every energy; and, since X(q) and the strains s(q)
  are not linear, force times (J dq - dX).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d import vectors
from worm3d.codegen import evaluate as run
from worm3d.compiled import inner
from worm3d.kernels import joint, point, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, POINTS, TERMS, Core
from worm3d.solver.block import address, combine, matrix, rows, vector
from worm3d.solver.entry import kernel

FloatArray = NDArray[np.float64]

(
    WORK_CONTRACT,
    WORK_EXTERNAL,
    _LOAD_CHANGE,
    KINETIC,
    _ELASTIC,
    POTENTIAL,
    _PENETRATION,
    _ANCHOR,
    FRICTION_LOSS,
    VISCOUS_LOSS,
    NUMERICAL_LOSS,
    WORK_POSITIVE,
    _P11,
    WORK_FRICTION,
) = range(len(TERMS))
_OF_SEGMENT = np.array([TERMS.index(name) for name in segment.LEDGER_TERMS])
_OF_JOINT = np.array([TERMS.index(name) for name in joint.LEDGER_TERMS])
_OF_POINT = np.array([TERMS.index(name) for name in point.LEDGER_TERMS])
_FIRST_TERM = 3
"""Row of "after_out" behind slip and stored energy."""

_DQ = segment.LAYOUT.first("dq")
_JOINT_DQ = joint.LAYOUT.first("dq")
_MOTION, _FIRST = point.LAYOUT.firsts("motion", "first")


@inner
def prepare(core: Core) -> None:
    """Fill the motion of the step, to first order in the points, and run the points' ledger."""
    n = core.n
    x, x_n = vector(core.block, a.X), vector(core.block, a.X_N)
    segment_in, joint_in = matrix(core.block, a.SEGMENT_IN), matrix(core.block, a.JOINT_IN)
    point_in = matrix(core.block, a.POINT_IN)
    for i in range(n):
        for r in range(segment.COORDINATES):
            segment_in[_DQ + r, i] = x[BLOCK * i + r] - x_n[BLOCK * i + r]
    for i in range(n - 1):
        for r in range(joint.COORDINATES):
            joint_in[_JOINT_DQ + r, i] = x[BLOCK * i + r] - x_n[BLOCK * i + r]
    run(kernel(core, a.SEGMENT_MOTION), segment_in, matrix(core.block, a.FIRST), n)
    new, old = rows(core.block, a.POINT_IN, 0, 3), rows(core.block, a.POINTS_PAST, 0, 3)
    combine(rows(core.block, a.POINT_IN, _MOTION, 3), 1.0, new, -1.0, old)
    run(kernel(core, a.POINT_AFTER), point_in, matrix(core.block, a.AFTER_OUT), point_in.shape[1])


@inner
def add(core: Core, dt: float, span: float, terms: FloatArray) -> None:
    """Add the step's terms, shape (14,) [J]; `prepare` has run, the past is that before the step.

    The hinge angles of the segments are left behind the terms in "segment_out".

    Parameters
    ----------
    dt, span : float
        Time step, and beta dt [s].
    """
    n, worked = core.n, terms[WORK_CONTRACT]
    segment_in, joint_in = matrix(core.block, a.SEGMENT_IN), matrix(core.block, a.JOINT_IN)
    segment_out = matrix(core.block, a.SEGMENT_OUT)[: len(_OF_SEGMENT) + 2]
    joint_out = matrix(core.block, a.JOINT_OUT)[: len(_OF_JOINT)]
    run(kernel(core, a.SEGMENT_LEDGER), segment_in, segment_out, n)
    run(kernel(core, a.JOINT_LEDGER), joint_in, joint_out, n - 1)
    for k in range(len(_OF_SEGMENT)):
        terms[_OF_SEGMENT[k]] += vectors.total(address(core.block, a.SEGMENT_OUT, k), n)
    for k in range(len(_OF_JOINT)):
        terms[_OF_JOINT[k]] += vectors.total(address(core.block, a.JOINT_OUT, k), n - 1)
    lanes = segment_in.shape[1]
    for k in range(len(_OF_POINT)):
        row = address(core.block, a.AFTER_OUT, _FIRST_TERM + k)
        for s in range(POINTS):
            terms[_OF_POINT[k]] += vectors.total(row + 8 * s * lanes, n)
    _joints(core, dt, span, terms)
    _points(core, dt, span, terms)
    terms[WORK_POSITIVE] += max(0.0, terms[WORK_CONTRACT] - worked)


@inner
def _joints(core: Core, dt: float, span: float, terms: FloatArray) -> None:
    """Inertia, weight, medium and forces of the joints, whose coordinates are their places."""
    x, numbers = vector(core.block, a.X), vector(core.block, a.NUMBERS_)
    mass, drag = vector(core.block, a.JOINT_MASS), vector(core.block, a.DRAG)
    hat, drag_hat = matrix(core.block, a.JOINT_HAT), matrix(core.block, a.JOINT_DRAG_HAT)
    past, velocity = matrix(core.block, a.JOINTS), matrix(core.block, a.JOINT_VELOCITY)
    external, friction = matrix(core.block, a.EXTERNAL), matrix(core.block, a.JOINT_FRICTION)
    kinetic = potential = worked = rubbed = viscous = numerical = 0.0
    for j in range(core.n + 1):
        for d in range(3):
            new = x[BLOCK * j + d]
            moved, rate = new - past[d, j], (new - drag_hat[d, j]) / span
            force = mass[j] / span**2 * (new - hat[d, j])
            v_n, v_m = velocity[d, j], velocity[3 + d, j]
            gained, lost = _inertia(mass[j], rate, v_n, v_m, force, moved, moved, dt, span != dt)
            kinetic += gained
            potential -= mass[j] * numbers[a.GRAVITY + d] * moved
            worked += external[d, j] * moved
            rubbed += friction[d, j] * moved
            viscous += drag[j] * rate * rate * dt
            numerical += lost + drag[j] * rate * (moved - rate * dt)
    terms[KINETIC] += kinetic
    terms[POTENTIAL] += potential
    terms[WORK_EXTERNAL] += worked
    terms[FRICTION_LOSS] -= rubbed
    terms[WORK_FRICTION] += rubbed
    terms[VISCOUS_LOSS] += viscous
    terms[NUMERICAL_LOSS] += numerical


@inner
def _points(core: Core, dt: float, span: float, terms: FloatArray) -> None:
    """Inertia and weight of the apexes."""
    point_in, numbers = matrix(core.block, a.POINT_IN), vector(core.block, a.NUMBERS_)
    past, velocity = matrix(core.block, a.POINTS_PAST), matrix(core.block, a.POINT_VELOCITY)
    masses = matrix(core.block, a.POINT_MASS)
    lanes, bdf2 = masses.shape[1], span != dt
    w0, w1 = (4.0 / 3.0, -1.0 / 3.0) if bdf2 else (1.0, 0.0)
    kinetic = potential = numerical = 0.0
    for s in range(POINTS):
        for i in range(core.n):
            mass, k = masses[s, i], s * lanes + i
            if mass == 0.0:
                continue
            for d in range(3):
                moved, first = point_in[_MOTION + d, k], point_in[_FIRST + d, k]
                v_n, v_m = velocity[d, k], velocity[3 + d, k]
                v = (point_in[d, k] - w0 * past[d, k] - w1 * past[3 + d, k]) / span
                force = mass * (v - w0 * v_n - w1 * v_m) / span
                gained, lost = _inertia(mass, v, v_n, v_m, force, moved, first, dt, bdf2)
                kinetic += gained
                potential -= mass * numbers[a.GRAVITY + d] * moved
                numerical += lost - mass * numbers[a.GRAVITY + d] * (first - moved)
    terms[KINETIC] += kinetic
    terms[POTENTIAL] += potential
    terms[NUMERICAL_LOSS] += numerical


@inner
def _inertia(
    mass: float, v: float, v_n: float, v_m: float, force: float, moved: float, first: float, dt: float, bdf2: bool
) -> tuple[float, float]:
    """Return a coordinate's gain of kinetic energy, and the integrator's loss; `force` is m A."""
    e_x = moved - 0.5 * dt * (v + v_n)
    e_v = 0.5 * (v - 2.0 * v_n + v_m) if bdf2 else 0.0
    return 0.5 * mass * (v * v - v_n * v_n), mass * e_v * 0.5 * (v + v_n) + force * e_x + force * (first - moved)
