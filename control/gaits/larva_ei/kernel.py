"""Compiled steps of the larva's network and mechanics. The equations (LE..) are in `control.gaits.larva_ei.network`.

Units: rest length of a segment L = 1, stiffness of a segment k = 1, time constant tau_E = 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from worm3d.machine.compiled import inner, njit
from worm3d.values.arrays import FloatArray


class Parameters(NamedTuple):
    """Parameters of the network and the body. The defaults are the published values (table 1)."""

    w_EE: float = 1.0
    """Weight of a segment's excitation on itself."""
    w_EI: float = -2.0
    """Weight of a segment's inhibition on the segment's excitation."""
    w_IE: float = 0.6
    """Weight of a segment's excitation on the segment's inhibition."""
    w_II: float = 0.0
    """Weight of a segment's inhibition on itself."""
    w_En: float = 0.6
    """Weight of the excitation of the segment behind on a segment's excitation."""
    w_Ep: float = 1.95
    """Weight of the contraction of the segment behind on a segment's excitation."""
    w_Ip: float = 1.95
    """Weight of a segment's contraction on the segment's inhibition."""
    theta: float = 0.6
    """Threshold of both populations."""
    tau_I: float = 3.0
    """Time constant of inhibition."""
    tau_f: float = 0.4
    """Time constant of a muscle's force."""
    f_max: float = 5.0 / 6.0
    """Force of an active muscle."""
    E_half: float = 0.4
    """Excitation above which a muscle becomes active."""
    felt: float = 1.0 / 18.0
    """Threshold of the felt contraction, 1 + uh of the source."""
    F_max: float = 25.0 / 3.0
    """Friction of a node on the ground."""
    f_half: float = 5.0 / 12.0
    """Force above which a segment lifts the hind node."""
    c: float = 3.5
    """Damping of a segment."""
    g_n: float = 40000.0
    """Gain of the neurons."""
    g: float = 1000.0
    """Gain of muscles, feeling and lifting."""
    start_duration: float = 10.0
    """Duration of the input to the last segment that starts the first wave."""
    start_drive: float = 0.61
    """Size of this input."""


@inner
def switch(z: float, gain: float) -> float:
    """Return (1 + tanh(gain z))/2."""
    return 0.5 * (1.0 + np.tanh(gain * z))  # type: ignore[no-any-return]


@inner
def fire(network: FloatArray, contraction: FloatArray, start: float, p: Parameters, dt: float) -> None:
    """Take a step of (LE1) to (LE3) with constant contractions.

    Between switches the equations are linear, and the step solves them exactly. `network` has the rows E, I and f,
    shape (3, n), and is overwritten. `contraction` has the shape (n,). `start` is an input to the last segment.
    """
    n = network.shape[1]
    keep_E, keep_I, keep_f = np.exp(-dt), np.exp(-dt / p.tau_I), np.exp(-dt / p.tau_f)
    first = network[0, 0]
    for i in range(n):
        E, I, f = network[0, i], network[1, i], network[2, i]  # noqa: E741
        behind = (i + 1) % n
        E_behind = network[0, behind] if behind else first
        excited = p.w_EE * E + p.w_EI * I + p.w_En * E_behind + p.w_Ep * switch(contraction[behind] - p.felt, p.g)
        excited += start if behind == 0 else 0.0
        inhibited = p.w_IE * E + p.w_II * I + p.w_Ip * switch(contraction[i] - p.felt, p.g)
        to_E, to_I = switch(excited - p.theta, p.g_n), switch(inhibited - p.theta, p.g_n)
        to_f = p.f_max * switch(E - p.E_half, p.g)
        network[0, i] = to_E + (E - to_E) * keep_E
        network[1, i] = to_I + (I - to_I) * keep_I
        network[2, i] = to_f + (f - to_f) * keep_f


@njit
def advance(network: FloatArray, contraction: FloatArray, start: float, p: Parameters, dt: float, steps: int) -> None:
    """Take several steps of the network with constant contractions. Arguments as for `fire`."""
    for _ in range(steps):
        fire(network, contraction, start, p, dt)


@njit
def crawl(p: Parameters, dt: float, every: int, networks: FloatArray, nodes: FloatArray) -> None:
    """Let a larva of n segments crawl from rest, and record a row every `every` steps.

    Parameters
    ----------
    networks : ndarray, shape (T, 3, n)
        Filled with E, I and f.
    nodes : ndarray, shape (T, n + 1)
        Filled with the positions u.
    """
    n = networks.shape[2]
    network, u, v = np.zeros((3, n)), -1.0 * np.arange(n + 1), np.zeros(n)
    f, contraction, drive, friction = network[2], np.zeros(n), np.zeros(n), np.zeros(n)
    for step in range(len(nodes) * every):
        # The last node moves as the first: a ring with segment i ahead of node i and segment i + 1 behind node i.
        for i in range(n):
            drive[i] = contraction[i] - contraction[i - 1] + f[i - 1] - f[i]
            friction[i] = p.F_max * switch(p.f_half - f[i - 1], p.g) * (2.0 if i == 0 else 1.0)
        for _ in range(2000):  # sweeps of Gauss and Seidel
            change = 0.0
            for i in range(n):
                pull = drive[i] + p.c * (v[i - 1] + v[(i + 1) % n])
                before, v[i] = v[i], np.sign(pull) * max(abs(pull) - friction[i], 0.0) / (2.0 * p.c)
                change = max(change, abs(v[i] - before))
            if change < 1e-12:
                break
        u[:n] += dt * v
        u[n] += dt * v[0]
        contraction[:] = 1.0 - (u[:n] - u[1:])
        fire(network, contraction, p.start_drive if step * dt < p.start_duration else 0.0, p, dt)
        if (step + 1) % every == 0:
            networks[step // every], nodes[step // every] = network, u
