"""Energy ledger of a step. Every term is computed independently.

Multiply the residual of a step by dq = q_{n+1} - q_n, and let J dq be the first-order motion of a mass point. Then

    work of the actuators + of external forces + change of the anchors' energy by loads and turning tangents
    = change of kinetic, elastic, potential, penetration and anchor energy
      + friction loss + viscous loss + impact + numerical loss - residual.dq

* Actuators, also of hinges: the work is the integral of (dE/dl_cmd) dl_cmd over the change of command, by the
  trapezoidal rule, and -F dl for chamber forces. The step itself applies the change of command before the motion. The
  difference, which can have either sign, is numerical loss.
* Actuators with a potential Psi: the actuator supplies the work of the source, the change of the stored energy and the
  loss. The remainder of dPsi/dl times the first-order change of the length is numerical loss.
* Friction: N rho(motion of the anchor). For the clamped worm, (P10) as -F.dq.
* Friction in the joints of the chambers: the loss of the sliding elements, (H4), and the change of energy of the
  springs of these elements, which is elastic energy. The remainder of dPsi/dl times the first-order change of the
  length is numerical loss.
* Viscous: Kelvin-Voigt damping c rate^2 dt, the medium (P8), and the dampers of friction.
* Impact: the loss in the damper of the normal contact, except in a step with a strike (`STRIKE`). A strike is too fast
  for the step to resolve the contact. The loss in such a step is the impulse N dt times the mean (V + V_n)/2 of the
  normal velocities before and after, minus the energy stored in the contact. Two terms are added. The impulse of
  friction adds f.(dt (V + V_n)/2 - dX), since N rho(motion of the anchor) contains only the velocity after the strike.
  Every mass point adds m g.(J dq - dt (V + V_n)/2), since N also carries the weight, which is not part of the impact.
* Numerical: the sum of three kinds of terms, minus the part counted as impact. The first kind is due to inertia,
  m [e_v.(V + V_n)/2 + A.e_x], with the defects of the integrator

      e_x = dX - dt (V + V_n)/2,   e_v = dt A - dV = w/(1 + w) (V - (1 + w) V_n + w V_{n-1})

  and w = dt/dt_old. For implicit Euler w = 0, and the term is m |dV|^2/2. The second kind is
  E_n - E_{n+1} + gradE_{n+1}.dq for every energy E. The third is force times (J dq - dX), since the positions X(q) and
  the strains s(q) are not linear.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine import vectors
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import actuator, joint, node, point, segment
from worm3d.recorded.energy import TERMS
from worm3d.solver import arrays as a
from worm3d.solver import regimes
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, combine, fill, matrix, rows, vector
from worm3d.solver.entry import kernel, run
from worm3d.solver.evaluate import LOAD_ROW, to_joints, to_segments
from worm3d.values.arrays import FloatArray

WORK_CONTRACT, WORK_POSITIVE = TERMS.index("work_contract"), TERMS.index("work_contract_positive")
VISCOUS, DRAG = TERMS.index("viscous_loss"), TERMS.index("drag_loss")
_OF_SEGMENT = np.array([TERMS.index(name) for name in segment.LEDGER_TERMS])
_OF_ACTUATOR = np.array([TERMS.index(name) for name in actuator.LEDGER_TERMS])
_OF_JOINT = np.array([TERMS.index(name) for name in joint.LEDGER_TERMS])
_OF_NODE = np.array([TERMS.index(name) for name in node.LEDGER_TERMS])
_OF_POINT = np.array([TERMS.index(name) for name in point.LEDGER_TERMS])

_DQ, _JOINT_DQ = segment.SEGMENT_LAYOUT.first("dq"), joint.JOINT_LAYOUT.first("dq")
_LOAD_N, _F, _NORMAL, _VELOCITY = point.POINT_LAYOUT.firsts("load_n", "f", "normal", "velocity")
_DT, _LANDS = point.POINT_LAYOUT.firsts("dt", "lands")
_NODE_LANDS = node.NODE_LAYOUT.first("lands")

STRIKE = 2.0
"""Minimum speed of approach of a strike, divided by the speed that gravity causes in a time step.

A crawling worm lands more slowly, because springs and dampers, not its momentum, then press it on the world.
"""


@inner
def gravity(core: Core) -> float:
    """Return the magnitude of gravity [m/s^2]."""
    numbers = vector(core.block, a.NUMBERS_)
    return float(np.sqrt(numbers[a.GRAVITY] ** 2 + numbers[a.GRAVITY + 1] ** 2 + numbers[a.GRAVITY + 2] ** 2))


@inner
def _lands(core: Core) -> bool:
    """Return whether a point has struck the world in the step."""
    p, load = matrix(core.block, a.POINT_IN), matrix(core.block, a.POINT_OUT)[LOAD_ROW]
    limit = STRIKE * gravity(core) * p[_DT, 0]
    for k in range(p.shape[1]):
        if load[k] > 0.0:
            approach = 0.0
            for d in range(3):
                approach -= p[_VELOCITY + d, k] * p[_NORMAL + d, k]
            if approach > limit:
                return True
    return False


@inner
def prepare(core: Core) -> None:
    """Fill the change of x in the step and the first-order motion of the points, and run the ledgers of all parts."""
    lands = 1.0 if _lands(core) else 0.0
    fill(rows(core.block, a.POINT_IN, _LANDS, 1), lands)
    fill(rows(core.block, a.NODE_IN, _NODE_LANDS, 1), lands)
    block, n = core.block, core.n
    x = vector(block, a.X)
    combine(vector(block, a.STEP_CHANGE)[: len(x)], 1.0, x, -1.0, vector(block, a.X_N))
    to_segments(core, _DQ, address(block, a.STEP_CHANGE, 0))
    to_joints(core, _JOINT_DQ, address(block, a.STEP_CHANGE, 0))
    run(core, a.SEGMENT_LEDGER, a.FORMED, a.SEGMENT_LEDGER_, n)
    point_in, nodes = matrix(block, a.POINT_IN), matrix(block, a.NODE_IN)
    for row, source, count in ((_F, 0, 3), (_LOAD_N, LOAD_ROW, 1)):
        here = address(block, a.POINT_OUT, source)
        vectors.move(address(block, a.POINT_IN, row), here, count * point_in.shape[1])
    regimes.look(core, a.POINT_TOUCHES)
    for first in range(0, point_in.shape[1], vectors.VECTOR_WIDTH):
        which = a.POINT_AFTER if regimes.seen(core, first) else a.POINT_FREE_AFTER
        run(core, which, a.POINT_IN, a.AFTER_OUT, vectors.VECTOR_WIDTH, first)
    for j in range(n + 1):
        for d in range(3):
            nodes[d, j] = x[BLOCK_SIZE * j + d]
    run(core, a.NODE_AFTER, a.NODE_IN, a.NODE_OUT, n + 1)


@inner
def add(core: Core, terms: FloatArray) -> None:
    """Add the terms of the step to `terms`, shape (19,) [J].

    `prepare` must have run, and the stored past must still be the past of this step. In the outputs, the apex angles
    follow the terms in "segment_ledger", and the angles of the joints follow the terms in "joint_out".
    """
    n, worked, dragged = core.n, terms[WORK_CONTRACT], terms[DRAG]
    joint_out = matrix(core.block, a.JOINT_OUT)[: len(_OF_JOINT) + 4]
    evaluate_kernel(kernel(core, a.JOINT_LEDGER), matrix(core.block, a.JOINT_IN), joint_out, n - 1)
    _collect(core, a.SEGMENT_LEDGER_, n, _OF_SEGMENT, terms)
    if kernel(core, a.ACTUATOR_END) != 0:
        run(core, a.ACTUATOR_END, a.ACTUATED, a.ACTUATOR_OUT, n)
        _collect(core, a.ACTUATOR_OUT, n, _OF_ACTUATOR, terms)
    _collect(core, a.JOINT_OUT, n - 1, _OF_JOINT, terms)
    _collect(core, a.NODE_OUT, n + 1, _OF_NODE, terms)
    lanes = matrix(core.block, a.AFTER_OUT).shape[1]
    _collect(core, a.AFTER_OUT, lanes, _OF_POINT[: vectors.VECTOR_WIDTH], terms)
    for k in range(vectors.VECTOR_WIDTH, len(_OF_POINT)):
        terms[_OF_POINT[k]] += vectors.total(address(core.block, a.AFTER_OUT, k), lanes)
    terms[VISCOUS] += terms[DRAG] - dragged
    terms[WORK_POSITIVE] += max(0.0, terms[WORK_CONTRACT] - worked)


@inner
def _collect(core: Core, outputs: int, count: int, of: NDArray[np.int64], terms: FloatArray) -> None:
    """Add the sums over the lanes of a kernel's first outputs, at most eight, to the terms with the indices `of`."""
    sums, lanes = vector(core.block, a.SUMS), matrix(core.block, outputs).shape[1]
    vectors.totals(address(core.block, a.SUMS, 0), address(core.block, outputs, 0), lanes, count)
    for k in range(len(of)):
        terms[of[k]] += sums[k]
