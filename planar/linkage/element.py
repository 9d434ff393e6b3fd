"""Potential, gradient and exact Hessian of one time step, as compiled functions.

The docstring of `planar.linkage` has the potential. With the joints p_i, e = p_{i+1} - p_i, s = e.e and
R = [[0, -1], [1, 0]], the apexes of segment i are

    X = (p_i + p_{i+1})/2 +- w(s) R e,   w = h/l                                    (K1)

where l = |e|, and h is half of the distance between the apexes. A rhombus with links of length a has
w = sqrt(a^2/s - 1/4), and `planar.linkage.segment_law` has the other laws. For any force f on an apex, with w' = dw/ds,

    d(f.wRe)/de  = w R^T f + 2 w' (f.Re) e
    d2(f.wRe)/de2 = 2 w' (R^T f e^T + e f^T R + (f.Re) I) + 4 w'' (f.Re) e e^T.      (K2)

The angle of a segment with the unit tangent t and the unit normal n = R t has the derivatives n/l and
-(n t^T + t n^T)/l^2 with respect to e. The cross product of two neighbouring tangents is sin(angle_2 - angle_1).

The Hessian is stored as LAPACK's general band matrix with kl = ku = 5: entry (i, j) of the matrix is at [10 + i - j,
j].
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planar.linkage.ground import Ground
from planar.linkage.segment_law import RHOMBUS, SegmentLaw, has_shape, slenderness, spring
from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

HALF_BANDWIDTH = 5
"""Half bandwidth of the Hessian. A joint (two coordinates) couples with itself and with two joints on each side."""
ROWS = 3 * HALF_BANDWIDTH + 1
"""Rows of the stored band, which include the rows that LAPACK's pivoting fills."""

BY_LAW, OPEN, STICK, SLIDE = 0, 1, 2, 4
"""Regimes of a contact (`planar.linkage.regimes`). STICK and SLIDE are for displacements towards the head; STICK + 1
and SLIDE + 1 are for displacements towards the tail."""


class Body(NamedTuple):
    """The worm's constants, as in `planar.linkage.Linkage`.

    The shapes are (N,) for segments, (N-1,) for pairs of neighbouring segments, (N+1,) for joints and (N, 2) for apexes
    [bottom, top].
    """

    segment_law: SegmentLaw
    k_torsion: FloatArray
    cross0: FloatArray
    k_apex: FloatArray
    rest_angle: FloatArray
    joint_mass: FloatArray
    apex_mass: FloatArray
    joint_drag: FloatArray
    kelvin_voigt_time: float


class Now(NamedTuple):
    """Known values at the start of the step from t_n to t_{n+1}. The ending _n marks values at t_n."""

    dt: float
    l_cmd: FloatArray
    """(N,) commanded rest lengths at t_{n+1}."""
    force: FloatArray
    """(N+1, 2) constant forces on the joints."""
    gravity: FloatArray
    """(2,)"""
    joint_hat: FloatArray
    """(N+1, 2) X_n + dt V_n."""
    apex_hat: FloatArray
    """(N, 2, 2) X_n + dt V_n of the apexes [bottom, top]."""
    joint_n: FloatArray
    """(N+1, 2)"""
    length_n: FloatArray
    cross_n: FloatArray
    angle_n: FloatArray
    depth_n: FloatArray
    """(N, 2) penetration."""
    anchor: FloatArray
    """(N, 2) x of the anchors."""
    direction: FloatArray
    """(N,) +1 if the head end of the segment lies towards +x, else -1."""
    slide_n: FloatArray
    """(N, 2) displacement from the anchor at t_n."""
    cap: FloatArray
    """(N, 2) limit of friction over the kinetic limit: static_ratio where the contact is stuck, 1 where it slides."""
    load: FloatArray
    """(N, 2) given normal loads, which set the friction if `coupled` is false (`evaluate`)."""
    push: FloatArray
    """(N, 2) constant forces on the apexes along x."""
    regime: NDArray[np.int64]
    """(N, 2) prescribed regime of each contact, or BY_LAW if the law decides."""


@njit
def normal_load(depth: float, depth_n: float, dt: float, k: float, c: float) -> float:
    """Return the normal force (G1) of one contact [N]."""
    stiff = k + c / dt
    load: float = stiff * max(0.0, max(0.0, depth) - c / dt * depth_n / stiff)
    return load


@njit
def friction_gauge(
    s: float, s_n: float, dt: float, forward: float, backward: float, ground: Ground
) -> tuple[float, float, float]:
    """Return y = s - s*, the coefficient mu for the sign of y, and b of (G2)."""
    r = 1.0 / (1.0 / ground.yield_gauge + ground.gauge_damping / dt)
    y = s - ground.gauge_damping / dt * r * s_n
    mu = forward if y > 0.0 else backward
    return y, mu, r / max(mu, ground.least)


@njit
def apex_gauge(i: int, j: int, x: float, ground: Ground, now: Now) -> tuple[float, float, float]:
    """Return y, mu and b of (G2) for apex j of segment i at x.

    For a given regime, STICK or SLIDE, mu follows from the direction of the regime, otherwise from the sign of y.
    """
    forward, backward = ground.mu_forward[i], ground.mu_backward[i]
    if now.regime[i, j] >= STICK:
        forward = backward = forward if now.regime[i, j] % 2 == 0 else backward
    s = now.direction[i] * (x - now.anchor[i, j])
    gauge: tuple[float, float, float] = friction_gauge(s, now.slide_n[i, j], now.dt, forward, backward, ground)
    return gauge


@njit
def evaluate(
    q: FloatArray, body: Body, ground: Ground, now: Now, coupled: bool, grad: FloatArray, band: FloatArray
) -> float:
    """Return the potential of a step, and fill the gradient and the Hessian.

    The potential is infinite if a segment has no length, or would have to be longer than its links allow. If `coupled`
    is true, friction uses the normal loads at `q` instead of `now.load`. Then `grad` is the residual of the step,
    `band` is the unsymmetric Jacobian of the residual, and the returned potential has no meaning.

    Parameters
    ----------
    q : ndarray, shape (2 (N+1),)
        x, z of each joint [m].
    grad : ndarray, shape (2 (N+1),)
        Gradient [N], overwritten.
    band : ndarray, shape (16, 2 (N+1)) or (0, 0)
        Hessian [N/m], overwritten; not computed if the array is empty.
    """
    grad[:] = 0.0
    band[:, :] = 0.0
    segments = len(body.k_apex)
    tangent, length = np.empty((segments, 2)), np.empty(segments)
    for i in range(segments):
        ex, ez = q[2 * i + 2] - q[2 * i], q[2 * i + 3] - q[2 * i + 1]
        square = ex * ex + ez * ez
        if not has_shape(i, square, body.segment_law):
            return np.inf
        length[i] = np.sqrt(square)
        tangent[i, 0], tangent[i, 1] = ex / length[i], ez / length[i]
    phi = _joints(q, body, now, grad, band)
    for i in range(segments):
        phi += _segment(i, q, length[i], tangent[i], body, now, grad, band)
        for j in range(2):
            phi += _apex(i, j, q, length[i], body, ground, now, coupled, grad, band)
    for j in range(1, segments):
        phi += _torsion(j, length, tangent, body, now, grad, band)
    return phi


@njit
def _joints(q: FloatArray, body: Body, now: Now, grad: FloatArray, band: FloatArray) -> float:
    """Add the inertia (P4), weight, viscous medium (P8) and external force of the joints; return their potential."""
    phi = 0.0
    for i in range(len(body.joint_mass)):
        mass, drag = body.joint_mass[i] / now.dt**2, body.joint_drag[i] / now.dt
        for d in range(2):
            k = 2 * i + d
            away, moved = q[k] - now.joint_hat[i, d], q[k] - now.joint_n[i, d]
            push = body.joint_mass[i] * now.gravity[d] + now.force[i, d]
            phi += 0.5 * mass * away**2 + 0.5 * drag * moved**2 - push * q[k]
            grad[k] += mass * away + drag * moved - push
            if band.shape[0] > 0:
                band[2 * HALF_BANDWIDTH, k] += mass + drag
    return phi


@njit
def _segment(
    i: int, q: FloatArray, length: float, t: FloatArray, body: Body, now: Now, grad: FloatArray, band: FloatArray
) -> float:
    """Add the spring of segment i, the two apex hinges of a rhombus, and the dampers; return their potential."""
    law, tau = body.segment_law, body.kelvin_voigt_time / now.dt
    phi: float
    phi, slope, curve = spring(i, length, now.l_cmd[i], law)
    damper, rate = tau * law.k_spring[i] / law.l0, length - now.length_n[i]
    phi += 0.5 * damper * rate**2
    slope += damper * rate
    curve += damper

    if law.kind == RHOMBUS:
        a = law.link_length[i]
        h = np.sqrt(a * a - 0.25 * length * length)
        angle = 2.0 * np.arcsin(0.5 * length / a)
        bend, turn = angle - body.rest_angle[i], angle - now.angle_n[i]
        phi += body.k_apex[i] * (bend**2 + tau * turn**2)
        moment = 2.0 * body.k_apex[i] * (bend + tau * turn)
        slope += moment / h
        curve += 2.0 * body.k_apex[i] * (1.0 + tau) / h**2 + moment * length / (4.0 * h**3)

    for d in range(2):
        grad[2 * i + d] -= slope * t[d]
        grad[2 * i + 2 + d] += slope * t[d]
    # Hessian in e: curve t t^T + slope/l n n^T, with n = (-t_z, t_x)
    across = slope / length
    xx, zz = curve * t[0] ** 2 + across * t[1] ** 2, curve * t[1] ** 2 + across * t[0] ** 2
    _add_in_e(band, 2 * i, xx, (curve - across) * t[0] * t[1], zz)
    return phi


@njit
def _apex(
    i: int,
    j: int,
    q: FloatArray,
    length: float,
    body: Body,
    ground: Ground,
    now: Now,
    coupled: bool,
    grad: FloatArray,
    band: FloatArray,
) -> float:
    """Add the forces on apex j (0 bottom, 1 top) of segment i through (K1) and (K2), and return their potential.

    The forces are inertia, weight, contact and friction.
    """
    base, side = 2 * i, 2.0 * j - 1.0
    ex, ez = q[base + 2] - q[base], q[base + 3] - q[base + 1]
    w, w1, w2 = slenderness(i, length * length, now.l_cmd[i], body.segment_law)
    x = 0.5 * (q[base] + q[base + 2]) - side * w * ez
    z = 0.5 * (q[base + 1] + q[base + 3]) + side * w * ex
    phi, fx, fz, kxx, kxz, kzz = _point(i, j, x, z, body, ground, now, coupled)

    # Rows of dX/d(p_i, p_{i+1}) = (1/2 -+ D), D = d(wRe)/de = w R + 2 w' (Re) e^T, Re = (-ez, ex)
    dxx, dxz = -2.0 * side * w1 * ez * ex, -side * (w + 2.0 * w1 * ez * ez)
    dzx, dzz = side * (w + 2.0 * w1 * ex * ex), 2.0 * side * w1 * ex * ez
    jx = (0.5 - dxx, -dxz, 0.5 + dxx, dxz)
    jz = (-dzx, 0.5 - dzz, dzx, 0.5 + dzz)
    for r in range(4):
        grad[base + r] += jx[r] * fx + jz[r] * fz
    if band.shape[0] > 0:
        for r in range(4):
            for c in range(4):
                band[2 * HALF_BANDWIDTH + r - c, base + c] += jx[r] * (kxx * jx[c] + kxz * jz[c]) + jz[r] * kzz * jz[c]
    across = fz * ex - fx * ez  # f.Re; and R^T f = (fz, -fx)
    xx = side * (2.0 * w1 * (2.0 * fz * ex + across) + 4.0 * w2 * across * ex * ex)
    xz = side * (2.0 * w1 * (fz * ez - fx * ex) + 4.0 * w2 * across * ex * ez)
    zz = side * (2.0 * w1 * (-2.0 * fx * ez + across) + 4.0 * w2 * across * ez * ez)
    _add_in_e(band, base, xx, xz, zz)
    return phi


@njit
def _point(
    i: int, j: int, x: float, z: float, body: Body, ground: Ground, now: Now, coupled: bool
) -> tuple[float, float, float, float, float, float]:
    """Return potential, gradient (x, z) and Hessian (xx, xz, zz) of the forces on one apex at (x, z)."""
    mass, dt = body.apex_mass[i, j], now.dt
    ax, az = x - now.apex_hat[i, j, 0], z - now.apex_hat[i, j, 1]
    kxx = kzz = mass / dt**2
    push_x, push_z = mass * now.gravity[0] + now.push[i, j], mass * now.gravity[1]
    phi = 0.5 * kxx * (ax * ax + az * az) - push_x * x - push_z * z
    fx, fz, kxz = kxx * ax - push_x, kzz * az - push_z, 0.0
    if ground.stiffness == 0.0:
        return phi, fx, fz, kxx, kxz, kzz
    load = normal_load(-z, now.depth_n[i, j], dt, ground.stiffness, ground.damping)
    stiff, regime = ground.stiffness + ground.damping / dt, now.regime[i, j]
    if regime != BY_LAW:
        load = 0.0 if regime == OPEN else -stiff * z - ground.damping / dt * now.depth_n[i, j]
    if load > 0.0 or regime >= STICK:
        phi += 0.5 * load * load / stiff
        fz -= load
        kzz += stiff
    pressed = load if coupled else now.load[i, j]
    if pressed > 0.0 or (coupled and regime >= STICK):
        potential, slope, curve = _friction(i, j, x, ground, now)
        phi += pressed * potential
        fx += pressed * slope
        kxx += pressed * curve
        if coupled:
            kxz -= stiff * slope  # the load rises with the depth
    return phi, fx, fz, kxx, kxz, kzz


@njit
def _friction(i: int, j: int, x: float, ground: Ground, now: Now) -> tuple[float, float, float]:
    """Return the potential h of (G2) and its derivatives dh/dx and d2h/dx2, per unit of normal load."""
    d = now.direction[i]
    y, mu, b = apex_gauge(i, j, x, ground, now)
    cap, regime = now.cap[i, j], now.regime[i, j]
    if regime >= SLIDE:
        towards = 1.0 if regime == SLIDE else -1.0
        return cap * mu * (towards * y - 0.5 * cap * b), d * cap * mu * towards, 0.0
    if abs(y) <= cap * b or regime >= STICK:
        return mu * y * y / (2.0 * b), d * mu * y / b, mu / b
    return cap * mu * (abs(y) - 0.5 * cap * b), d * cap * mu * np.sign(y), 0.0


@njit
def _torsion(
    j: int, length: FloatArray, t: FloatArray, body: Body, now: Now, grad: FloatArray, band: FloatArray
) -> float:
    """Add the torsion (P6) and its damper at joint j, between segments j-1 and j; return their potential."""
    cross = t[j - 1, 0] * t[j, 1] - t[j - 1, 1] * t[j, 0]
    cosine = t[j - 1, 0] * t[j, 0] + t[j - 1, 1] * t[j, 1]
    k, tau = body.k_torsion[j - 1], body.kelvin_voigt_time / now.dt
    off, rate = cross - body.cross0[j - 1], cross - now.cross_n[j - 1]
    moment, base = k * (off + tau * rate), 2 * (j - 1)
    ax, az = -t[j - 1, 1] / length[j - 1], t[j - 1, 0] / length[j - 1]  # minus the angle of segment j-1
    bx, bz = -t[j, 1] / length[j], t[j, 0] / length[j]
    lever = (ax, az, -ax - bx, -az - bz, bx, bz)
    for r in range(6):
        grad[base + r] += moment * cosine * lever[r]
    if band.shape[0] > 0:
        stiff = k * (1.0 + tau) * cosine * cosine - moment * cross
        for r in range(6):
            for c in range(6):
                band[2 * HALF_BANDWIDTH + r - c, base + c] += stiff * lever[r] * lever[c]
    for side in range(2):  # second derivative of the two angles
        i = j - 1 + side
        factor = moment * cosine * (1.0 - 2.0 * side) / length[i] ** 2
        twice = 2.0 * t[i, 0] * t[i, 1] * factor
        _add_in_e(band, 2 * i, -twice, (t[i, 0] ** 2 - t[i, 1] ** 2) * factor, twice)
    phi: float = 0.5 * k * (off * off + tau * rate * rate)
    return phi


@njit
def _add_in_e(band: FloatArray, base: int, xx: float, xz: float, zz: float) -> None:
    """Add the Hessian of a function of e = p_{i+1} - p_i, whose blocks in (p_i, p_{i+1}) are [H, -H; -H, H]."""
    if band.shape[0] == 0:
        return
    for r in range(4):
        for c in range(4):
            own = xx if r % 2 + c % 2 == 0 else (zz if r % 2 + c % 2 == 2 else xz)
            band[2 * HALF_BANDWIDTH + r - c, base + c] += own if (r < 2) == (c < 2) else -own


NO_BAND: Any = np.empty((0, 0))
"""Empty array for `evaluate`, which then computes no Hessian."""
