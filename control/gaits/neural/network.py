"""A chain of excitatory and inhibitory populations, one pair in each segment and side (Wilson, Cowan 1972).

Rates of the populations of segment i (0 at the tail) and side s, with the opposite side s':

    tau_E dE_is/dt = -E_is + S(w_s E_is + w_x E_is' + c_i X_i-1,s + c_i+1 X_i+1,s + h_is - w_i I_is - theta)  (EI1)
    tau_I dI_is/dt = -I_is + X_is                                                                             (EI2)
    X_is = (1 - phi) E_is + phi F_is,      S(z) = 1/(1 + exp(-z/width))                                       (EI3)

E in (0, 1) excites itself, the other side and both neighbours; the slower I follows the segment's activity X and ends
this activity. X mixes the segment's own E with the share phi of the felt contraction F of the body. c_i couples the
segments i - 1 and i in both directions: a wave runs from the place where the input h starts the wave, and the
inhibition behind the wave prevents a reversal. Thresholds are the unit of all inputs: theta = 1. The structure
(segmental E and I populations, neighbours coupled in both directions, sides coupled by excitation, both wave directions
from one network) follows Gjorgjieva, Berni, Evers, Eglen: Neural circuits for peristaltic wave propagation in crawling
Drosophila larvae, Frontiers in Computational Neuroscience 7:24 (2013); the constants are different.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from worm3d.values.arrays import FloatArray

STEPS_PER_TAU = 12.0
"""Number of integration steps (Runge-Kutta, fourth order) per shortest time constant. Twice this number changes the
onsets of waves by less than 1e-4 of the period."""


@dataclass(frozen=True)
class Network:
    """Constants of the chain, each an array over N segments and two sides [left, right], shape (N, 2)."""

    tau_e: FloatArray
    """Time constant of E [s]."""
    tau_i: FloatArray
    """Time constant of I [s]."""
    itself: FloatArray
    """Weight w_s of E on itself."""
    across: FloatArray
    """Weight w_x of the other side's E."""
    headward: FloatArray
    """Weight c of the tailward neighbour, for waves towards the head; 0 in segment 0."""
    tailward: FloatArray
    """Weight c of the headward neighbour, for waves towards the tail; 0 in segment N-1."""
    inhibition: FloatArray
    """Weight w_i of I."""
    threshold: FloatArray
    """Threshold theta."""
    width: FloatArray
    """Width of the sigmoid."""

    def noisy(self, relative: float, random: np.random.Generator) -> Network:
        """Return the network with each constant multiplied by a random factor.

        The factor is 1 + relative N(0, 1), but at least 0.1.
        """
        drawn = (getattr(self, each.name) for each in fields(self))
        return Network(*(a * np.maximum(0.1, 1.0 + relative * random.standard_normal(a.shape)) for a in drawn))

    def start(self) -> FloatArray:
        """Return the rates E, I at rest, shape (2, N, 2)."""
        return np.zeros((2, *self.tau_e.shape))

    def packed(self) -> FloatArray:
        """Return the constants in one array, shape (9, N, 2), for `advance`."""
        return np.array([getattr(self, each.name) for each in fields(self)])

    @property
    def step(self) -> float:
        """Longest integration step [s]."""
        return float(min(self.tau_e.min(), self.tau_i.min())) / STEPS_PER_TAU
