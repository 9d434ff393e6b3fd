"""Compiled steps of the larva's network and mechanics; `control.gaits.larva_ei.network` has the equations, (LE1) to (LE6).

Units of all: rest length of a segment L = 1, stiffness of a segment k = 1, time constant tau_E = 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from worm3d.machine.compiled import inner, njit
from worm3d.values.arrays import FloatArray


class Parameters(NamedTuple):
    """Numbers of the network and the body; the defaults are the published ones (table 1)."""

    w_EE: float = 1.0
    """Weight of a segment's excitation on itself."""
    w_EI: float = -2.0
    """Weight of its inhibition on its excitation."""
    w_IE: float = 0.6
    """Weight of its excitation on its inhibition."""
    w_II: float = 0.0
    """Weight of its inhibition on itself."""
    w_En: float = 0.6
    """Weight of the excitation of the segment behind."""
    w_Ep: float = 1.95
    """Weight of the contraction of the segment behind on the excitation."""
    w_Ip: float = 1.95
    """Weight of a segment's own contraction on its inhibition."""
    theta: float = 0.6
    """Threshold of both populations."""
    tau_I: float = 3.0
    """Time constant of inhibition."""
    tau_f: float = 0.4
    """Time constant of a muscle's force."""
    f_max: float = 5.0 / 6.0
    """Force of an active muscle."""
    E_half: float = 0.4
    """Excitation at which a muscle becomes active."""
    felt: float = 1.0 / 18.0
    """Contraction that is felt, 1 + uh of the source."""
    F_max: float = 25.0 / 3.0
    """Friction of a node on the ground."""
    f_half: float = 5.0 / 12.0
    """Force above which a segment lifts its hind node."""
    c: float = 3.5
    """Damping of a segment."""
    g_n: float = 40000.0
    """Gain of the neurons."""
    g: float = 1000.0
    """Gain of muscles, feeling and lifting."""


START, START_DRIVE = 10.0, 0.61
"""Duration and size of the input to the last segment that begins the first wave."""
SWEEPS, TOLERANCE = 2000, 1e-12
"""Most Gauss-Seidel sweeps of the velocities, and the change of one at which they end."""


@inner
def switch(z: float, gain: float) -> float:
    return 0.5 * (1.0 + np.tanh(gain * z))


@inner
def fire(E: FloatArray, I: FloatArray, f: FloatArray, contraction: FloatArray, start: float, p: Parameters, dt: float) -> None:
    """Take a step of (LE1) to (LE3) with the contractions held; linear between switches, it is solved exactly."""
    n = len(E)
    first = E[0]
    for i in range(n):
        behind = (i + 1) % n
        excited = first if behind == 0 else E[behind]
        felt_behind = switch(contraction[behind] - p.felt, p.g)
        drive = p.w_EE * E[i] + p.w_EI * I[i] + p.w_En * excited + p.w_Ep * felt_behind - p.theta
        if i == n - 1:
            drive += start
        inhibit = p.w_IE * E[i] + p.w_II * I[i] + p.w_Ip * switch(contraction[i] - p.felt, p.g) - p.theta
        to_E, to_I, to_f = switch(drive, p.g_n), switch(inhibit, p.g_n), p.f_max * switch(E[i] - p.E_half, p.g)
        E[i] = to_E + (E[i] - to_E) * np.exp(-dt)
        I[i] = to_I + (I[i] - to_I) * np.exp(-dt / p.tau_I)
        f[i] = to_f + (f[i] - to_f) * np.exp(-dt / p.tau_f)


@njit
def sense(
    E: FloatArray, I: FloatArray, f: FloatArray, contraction: FloatArray, start: float, p: Parameters, dt: float, steps: int
) -> None:
    """Take steps of the network with the contractions held; E, I and f, shape (n,), are overwritten."""
    for _ in range(steps):
        fire(E, I, f, contraction, start, p, dt)


@njit
def crawl(n: int, p: Parameters, dt: float, steps: int, every: int, E_out: FloatArray, f_out: FloatArray, u_out: FloatArray) -> None:
    """Let the larva crawl from rest; rows of the outputs are every so many steps.

    Shapes: E_out and f_out (K, n), u_out (K, n + 1), K = steps / every.
    """
    E, I, f, v = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    contraction, drive, friction = np.zeros(n), np.zeros(n), np.zeros(n)
    u = -np.arange(n + 1) * 1.0
    for step in range(steps):
        # Ring of n nodes: the last one, n, moves as node 0.
        for i in range(n):
            ahead, own = f[i - 1], f[i]  # forces of the segment whose hind node this is, and of the one behind
            stretch = (u[i - 1] - u[i]) if i > 0 else (u[n - 1] - u[n])
            drive[i] = stretch - (u[i] - u[i + 1]) + ahead - own
            friction[i] = p.F_max * switch(p.f_half - ahead, p.g) * (2.0 if i == 0 else 1.0)
        for _ in range(SWEEPS):
            change = 0.0
            for i in range(n):
                pull = drive[i] + p.c * (v[i - 1] + v[(i + 1) % n])
                new = np.sign(pull) * max(abs(pull) - friction[i], 0.0) / (2.0 * p.c)
                change = max(change, abs(new - v[i]))
                v[i] = new
            if change < TOLERANCE:
                break
        for i in range(n):
            u[i] += dt * v[i]
        u[n] += dt * v[0]
        for i in range(n):
            contraction[i] = 1.0 - (u[i] - u[i + 1])
        fire(E, I, f, contraction, START_DRIVE if step * dt < START else 0.0, p, dt)
        if (step + 1) % every == 0:
            row = (step + 1) // every - 1
            E_out[row], f_out[row], u_out[row] = E, f, u
