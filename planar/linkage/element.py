"""Potential, gradient and exact Hessian of one time step, compiled; equations in the docstring of `planar.linkage`.

With R = [[0, -1], [1, 0]] and e = p_{i+1} - p_i, s = e.e, the apexes of segment i are

    X = (p_i + p_{i+1})/2 +- w(s) R e,   w = sqrt(a^2/s - 1/4) = h/l                (K1)

so that for any force f on an apex, with w' = dw/ds,

    d(f.wRe)/de  = w R^T f + 2 w' (f.Re) e
    d2(f.wRe)/de2 = 2 w' (R^T f e^T + e f^T R + (f.Re) I) + 4 w'' (f.Re) e e^T.      (K2)

The angle of a segment has the derivatives n/l and -(n t^T + t n^T)/l^2, and cross = sin(angle_2 - angle_1).

The band of the Hessian stands as LAPACK's general band with kl = ku = 5: entry (i, j) at [10 + i - j, j].
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from planar.linkage.worm import FloatArray

BAND = 5
ROWS = 3 * BAND + 1


class Body(NamedTuple):
    """The worm's constants; shapes (N,), (N-1,), (N+1,) or (N, 2) [bottom, top]."""

    k_spring: FloatArray
    l0: float
    a: FloatArray
    k_torsion: FloatArray
    cross0: FloatArray
    k_apex: FloatArray
    angle0: FloatArray
    joint_mass: FloatArray
    apex_mass: FloatArray
    drag: FloatArray
    kelvin_voigt_time: float


class Contact(NamedTuple):
    """The ground's constants (`planar.linkage.ground`); stiffness 0 means no ground."""

    stiffness: float
    damping: float
    mu_forward: FloatArray
    mu_backward: FloatArray
    yield_gauge: float
    gauge_damping: float


class Now(NamedTuple):
    """What is known at the start of a step; _n marks values at t_n."""

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
    """(N, 2, 2) likewise, [bottom, top]."""
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
    """(N,) +1 where the head lies towards +x."""
    slide_n: FloatArray
    """(N, 2) displacement from the anchor at t_n."""
    cap: FloatArray
    """(N, 2) static_ratio where stuck, 1 where kinetic."""
    load: FloatArray
    """(N, 2) normal loads for friction, used where `coupled` is false."""


@numba.njit(cache=True)
def normal_load(depth: float, depth_n: float, dt: float, k: float, c: float) -> float:
    """(G1): the normal force of one contact [N]."""
    stiff = k + c / dt
    return stiff * max(0.0, max(0.0, depth) - c / dt * depth_n / stiff)


@numba.njit(cache=True)
def friction_gauge(
    s: float, s_n: float, dt: float, forward: float, backward: float, yield_gauge: float, gauge_damping: float
) -> tuple[float, float, float]:
    """Return y = s - s*, its coefficient mu and r of (G2)."""
    r = 1.0 / (1.0 / yield_gauge + gauge_damping / dt)
    y = s - gauge_damping / dt * r * s_n
    return y, (forward if y > 0.0 else backward), r


@numba.njit(cache=True)
def evaluate(
    q: FloatArray, body: Body, contact: Contact, now: Now, coupled: bool, grad: FloatArray, band: FloatArray
) -> float:
    """Return the potential of a step (infinite where a rhombus cannot reach), and fill gradient and Hessian.

    With `coupled` the normal loads of the friction are those of `q` itself: `grad` is then the true residual,
    `band` its unsymmetric Jacobian, and the return value means nothing.

    Parameters
    ----------
    q : ndarray, shape (2 (N+1),)
        x, z of each joint [m].
    grad : ndarray, shape (2 (N+1),)
        Filled [N].
    band : ndarray, shape (16, 2 (N+1)) or (0, 0)
        Filled [N/m] unless empty.
    """
    n, dt = len(body.a), now.dt
    hess = band.shape[0] > 0
    grad[:] = 0.0
    band[:, :] = 0.0
    phi = 0.0
    tangent = np.empty((n, 2))
    length = np.empty(n)
    block = np.empty((4, 4))

    for i in range(n + 1):  # joints: inertia, weight, medium (P8), external force
        m, drag = body.joint_mass[i] / dt**2, body.drag[i] / dt
        for d in range(2):
            x, away = q[2 * i + d], q[2 * i + d] - now.joint_hat[i, d]
            moved, push = x - now.joint_n[i, d], body.joint_mass[i] * now.gravity[d] + now.force[i, d]
            phi += 0.5 * m * away * away + 0.5 * drag * moved * moved - push * x
            grad[2 * i + d] += m * away + drag * moved - push
            if hess:
                band[2 * BAND, 2 * i + d] += m + drag

    for i in range(n):
        ex, ez = q[2 * i + 2] - q[2 * i], q[2 * i + 3] - q[2 * i + 1]
        s, a = ex * ex + ez * ez, body.a[i]
        if not (1e-8 * a * a < s < 4.0 * a * a * (1.0 - 1e-12)):
            return np.inf
        l = np.sqrt(s)
        tx, tz, h = ex / l, ez / l, np.sqrt(a * a - 0.25 * s)
        tangent[i, 0], tangent[i, 1], length[i] = tx, tz, l

        # Strains of the segment: spring (P7), apex hinges, and their Kelvin-Voigt dampers.
        k, l_cmd, tau = body.k_spring[i], now.l_cmd[i], body.kelvin_voigt_time / dt
        stretch = 1.0 - l / l_cmd
        damper = tau * k / body.l0
        rate = l - now.length_n[i]
        phi += 0.5 * k * body.l0 * stretch**2 + 0.5 * damper * rate**2
        slope = -k * body.l0 / l_cmd * stretch + damper * rate
        curve = k * body.l0 / l_cmd**2 + damper
        angle = 2.0 * np.arcsin(0.5 * l / a)
        bend, turn = angle - body.angle0[i], tau * (angle - now.angle_n[i])
        phi += body.k_apex[i] * (bend**2 + turn * (angle - now.angle_n[i]))
        moment = 2.0 * body.k_apex[i] * (bend + turn)
        slope += moment / h
        curve += 2.0 * body.k_apex[i] * (1.0 + tau) / h**2 + moment * l / (4.0 * h**3)

        # Force and stiffness in e: slope t, curve t t^T + slope/l n n^T.
        gx, gz = slope * tx, slope * tz
        hxx = curve * tx * tx + slope / l * tz * tz
        hxz = (curve - slope / l) * tx * tz
        hzz = curve * tz * tz + slope / l * tx * tx

        # Apexes (K1): inertia, weight, contact, friction.
        w = h / l
        w1 = -a * a / (2.0 * s * s * w)
        w2 = (a * a / (s * s * s) - w1 * w1) / w
        # D = d(w R e)/de = w R + 2 w' (Re) e^T, with Re = (-ez, ex)
        dxx, dxz = -2.0 * w1 * ez * ex, -w - 2.0 * w1 * ez * ez
        dzx, dzz = w + 2.0 * w1 * ex * ex, 2.0 * w1 * ex * ez
        jac = np.empty((2, 4))
        block[:, :] = 0.0
        force = np.zeros(4)
        for j in range(2):
            side = 2.0 * j - 1.0
            x = 0.5 * (q[2 * i] + q[2 * i + 2]) - side * w * ez
            z = 0.5 * (q[2 * i + 1] + q[2 * i + 3]) + side * w * ex
            mass = body.apex_mass[i, j]
            m = mass / dt**2
            ax, az = x - now.apex_hat[i, j, 0], z - now.apex_hat[i, j, 1]
            phi += 0.5 * m * (ax * ax + az * az) - mass * (now.gravity[0] * x + now.gravity[1] * z)
            fx, fz = m * ax - mass * now.gravity[0], m * az - mass * now.gravity[1]
            kxx, kxz, kzz = m, 0.0, m
            if contact.stiffness > 0.0:
                load = normal_load(-z, now.depth_n[i, j], dt, contact.stiffness, contact.damping)
                stiff = contact.stiffness + contact.damping / dt
                if load > 0.0:
                    phi += 0.5 * load * load / stiff
                    fz -= load
                    kzz += stiff
                pressed = load if coupled else now.load[i, j]
                if pressed > 0.0:
                    d = now.direction[i]
                    y, mu, r = friction_gauge(
                        d * (x - now.anchor[i, j]),
                        now.slide_n[i, j],
                        dt,
                        contact.mu_forward[i],
                        contact.mu_backward[i],
                        contact.yield_gauge,
                        contact.gauge_damping,
                    )
                    rho, cap = mu * abs(y), now.cap[i, j]
                    if rho <= cap * r:
                        phi += pressed * rho * rho / (2.0 * r)
                        per_load = d * mu * mu * y / r
                        kxx += pressed * mu * mu / r
                    else:
                        phi += pressed * cap * (rho - 0.5 * cap * r)
                        per_load = d * cap * mu * np.sign(y)
                    fx += pressed * per_load
                    if coupled and load > 0.0:
                        kxz -= stiff * per_load
            jac[0, 0], jac[0, 1], jac[1, 0], jac[1, 1] = 0.5 - side * dxx, -side * dxz, -side * dzx, 0.5 - side * dzz
            jac[0, 2], jac[0, 3], jac[1, 2], jac[1, 3] = 0.5 + side * dxx, side * dxz, side * dzx, 0.5 + side * dzz
            for r_ in range(4):
                force[r_] += jac[0, r_] * fx + jac[1, r_] * fz
                if hess:
                    for c_ in range(4):
                        block[r_, c_] += (
                            jac[0, r_] * (kxx * jac[0, c_] + kxz * jac[1, c_]) + jac[1, r_] * kzz * jac[1, c_]
                        )
            # (K2): R^T f = (fz, -fx), f.Re = fz ex - fx ez
            across = fz * ex - fx * ez
            hxx += side * (2.0 * w1 * (2.0 * fz * ex + across) + 4.0 * w2 * across * ex * ex)
            hxz += side * (2.0 * w1 * (fz * ez - fx * ex) + 4.0 * w2 * across * ex * ez)
            hzz += side * (2.0 * w1 * (-2.0 * fx * ez + across) + 4.0 * w2 * across * ez * ez)
        grad[2 * i] += force[0] - gx
        grad[2 * i + 1] += force[1] - gz
        grad[2 * i + 2] += force[2] + gx
        grad[2 * i + 3] += force[3] + gz
        if hess:
            for r_ in range(4):
                for c_ in range(4):
                    sign = 1.0 if (r_ < 2) == (c_ < 2) else -1.0
                    own = hxx if r_ % 2 + c_ % 2 == 0 else (hzz if r_ % 2 + c_ % 2 == 2 else hxz)
                    band[2 * BAND + r_ - c_, 2 * i + c_] += block[r_, c_] + sign * own

    # Torsion between neighbouring segments (P6), on cross = sin(angle_2 - angle_1).
    lever = np.empty(6)
    for j in range(1, n):
        t1x, t1z, t2x, t2z = tangent[j - 1, 0], tangent[j - 1, 1], tangent[j, 0], tangent[j, 1]
        l1, l2 = length[j - 1], length[j]
        cross, cosine = t1x * t2z - t1z * t2x, t1x * t2x + t1z * t2z
        k, tau = body.k_torsion[j - 1], body.kelvin_voigt_time / dt
        off, rate = cross - body.cross0[j - 1], cross - now.cross_n[j - 1]
        phi += 0.5 * k * (off * off + tau * rate * rate)
        moment = k * (off + tau * rate)
        lever[0], lever[1] = -t1z / l1, t1x / l1
        lever[4], lever[5] = -t2z / l2, t2x / l2
        lever[2], lever[3] = -lever[0] - lever[4], -lever[1] - lever[5]
        base = 2 * (j - 1)
        for r_ in range(6):
            grad[base + r_] += moment * cosine * lever[r_]
        if hess:
            stiff = k * (1.0 + tau) * cosine * cosine - moment * cross
            for r_ in range(6):
                for c_ in range(6):
                    band[2 * BAND + r_ - c_, base + c_] += stiff * lever[r_] * lever[c_]
            for e in range(2):  # second derivative of the angles of segments j-1 (minus) and j (plus)
                tx, tz = (t1x, t1z) if e == 0 else (t2x, t2z)
                factor = moment * cosine * (1.0 if e == 0 else -1.0) / (l1 * l1 if e == 0 else l2 * l2)
                # n t^T + t n^T with n = (-tz, tx)
                sxx, sxz, szz = -2.0 * tx * tz * factor, (tx * tx - tz * tz) * factor, 2.0 * tx * tz * factor
                for r_ in range(4):
                    for c_ in range(4):
                        sign = 1.0 if (r_ < 2) == (c_ < 2) else -1.0
                        own = sxx if r_ % 2 + c_ % 2 == 0 else (szz if r_ % 2 + c_ % 2 == 2 else sxz)
                        band[2 * BAND + r_ - c_, base + 2 * e + c_] += sign * own
    return phi


NO_BAND: Any = np.empty((0, 0))
