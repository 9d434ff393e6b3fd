"""The paper's mechanism with correct physics: an independent reference for the 3D worm.

The model is a chain of rhombic linkages (`planar.linkage.worm`). The unknowns q are the positions of the joints; the
links are rigid, so that the joints determine the apexes. One step of implicit Euler (P1), (P2), (P4), (P5) makes the
gradient of this potential zero:

    sum_k m_k/(2 dt^2) |X_k(q) - X_k - dt V_k|^2 - m_k g.X_k        inertia (P4) and weight, joints and apexes
    + sum_i k l0/2 (1 - l/l_cmd)^2                                  springs (P7), l_cmd = l0 (1 - contraction)
    + sum_j k_torsion/2 (cross - cross0)^2                          torsion (P6)
    + sum_i 2 k_apex/2 (angle - angle0)^2                           two apex hinges, angle = 2 asin(l/2a)
    + sum_s c/(2 dt) (s - s_n)^2                                    Kelvin-Voigt on every strain s, c = tau x stiffness
    + sum_k drag_k/(2 dt) |p_k - p_k,n|^2                           viscous medium (P8)
    + contact and friction                                          `planar.linkage.ground`

where the friction uses the normal loads at the solution. The paper's worm is clamped instead: its joint heights z are
fixed, the normal loads are the reaction forces (P9), and the friction is (P10). The tags (P1) to (P14) are the
equations of the paper.
"""

from planar.linkage.ground import Friction
from planar.linkage.run import Run
from planar.linkage.simulate import simulate
from planar.linkage.start import LimitPointError
from planar.linkage.worm import Linkage

__all__ = ["Friction", "LimitPointError", "Linkage", "Run", "simulate"]
