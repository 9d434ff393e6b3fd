"""The paper's mechanism with correct physics: an independent reference for the 3D worm.

The model is a chain of rhombic linkages (`planar.linkage.worm`). The tags (P1) to (P14) are equations of the paper. The
unknowns q of a time step are the positions of the joints at the end of the step. The links are rigid, so that the
joints determine the apexes. A step of implicit Euler (P1), (P2), (P4), (P5) makes the gradient of this potential zero:

    sum_k m_k/(2 dt^2) |X_k(q) - X_k - dt V_k|^2 - m_k g.X_k        inertia (P4) and weight, joints and apexes
    + sum_i k l0/2 (1 - l/l_cmd)^2                                  springs (P7), l_cmd = l0 (1 - contraction)
    + sum_j k_torsion/2 (cross - cross0)^2                          torsion (P6)
    + sum_i 2 k_apex/2 (angle - angle0)^2                           two apex hinges, angle = 2 asin(l/2a)
    + sum_s c/(2 dt) (s - s_n)^2                                    Kelvin-Voigt on every strain s, c = tau x stiffness
    + sum_k drag_k/(2 dt) |p_k - p_k,n|^2                           viscous medium (P8)
    + contact and friction                                          `planar.linkage.ground`

These are the terms of rhombi. Other segment laws (`planar.linkage.segment_law`) have another energy of the spring and
another distance between the apexes, and no apex hinges.

The friction uses the normal loads at the solution. The worm of this model stands on its apexes. The worm of the paper
is clamped instead: the heights z of its joints are fixed, the normal loads are the reaction forces (P9), and the
friction is (P10).

The index k counts joints and apexes, or joints only in the term of the medium. i counts segments, and j counts the
joints between two segments. Point k has the mass m_k, and the position X_k(q) at the end of the step. At the start of
the step, point k has the position X_k and the velocity V_k. Joint k is at p_k at the end of the step, and at p_k,n at
the start. A segment has the length l, the length at rest l0, and links of length a. The cross product of the tangents
of two neighbouring segments is cross. The strains s are l, angle and cross; their values at the start of the step are
s_n. At rest, the values of cross and angle are cross0 and angle0. The duration of the step is dt, and tau is
`Linkage.kelvin_voigt_time`.
"""

from planar.linkage.ground import Friction
from planar.linkage.learned import Learned
from planar.linkage.run import Run
from planar.linkage.simulate import simulate
from planar.linkage.start import LimitPointError
from planar.linkage.worm import Linkage

__all__ = ["Friction", "Learned", "LimitPointError", "Linkage", "Run", "simulate"]
