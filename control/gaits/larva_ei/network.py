"""Network and mechanics of a crawling larva, with the published parameters (`kernel.Parameters`).

Segment i = 1 ... n joins node i-1 and node i, node 0 is the head, n the tail; u are positions of nodes towards the
head; lengths are in L, forces in k, times in tau_E, and l_i = u_(i-1) - u_i. With s_x(z) = (1 + tanh(g_x z))/2,

    dE_i = -E_i + s_n(w_EE E_i + w_EI I_i + h_i - theta),
    tau_I dI_i = -I_i + s_n(w_IE E_i + w_II I_i + w_Ip s_p(1 - felt - l_i) - theta),                        (LE1)
    h_i = w_En E_(i+1) + w_Ep s_p(1 - felt - l_(i+1)), segment n + 1 being segment 1,                       (LE2)
    tau_f df_i = -f_i + f_max s_f(E_i - E_half),                                                            (LE3)
    0 = l_i - l_(i+1) + c (dl_i - dl_(i+1)) + f_i - f_(i+1) - F_i,          i = 1 ... n-1,                  (LE4)
    0 = l_n - l_1 + c (dl_n - dl_1) + f_n - f_1 - F_n - F_0,                du_0 = du_n,                    (LE5)
    F_i = F_max sign(du_i) s_F(f_half - f_i), F_0 as F_n with f_n                                           (LE6)

(Pehlevan, Paoletti, Mahadevan: Integrative neuromechanics of crawling in D. melanogaster larvae, eLife 5, 2016, e11031,
equations 1 to 5 and table 1). Excitation spreads forward from the segment behind that is active and short; the
shortening of a segment raises the inhibition, which ends the activity of the segment. A segment that pulls hard enough
lifts the hind node. Head and tail move as one, since the gut links them, and the body keeps its length: u_0 - u_n = n,
with the sign that makes lengths positive. (LE4) to (LE6) are the optimality condition of a convex function of the
velocities; Gauss-Seidel sweeps find the minimum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.gaits.larva_ei.kernel import Parameters, crawl
from worm3d.values import arguments
from worm3d.values.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Crawling:
    """Record of a crawling larva of n segments, at T times."""

    time: FloatArray
    """Times of the rows, shape (T,) [tau_E]."""
    excitation: FloatArray
    """Excitation E of each segment, from head to tail, shape (T, n)."""
    force: FloatArray
    """Force f of each muscle, shape (T, n) [k]."""
    nodes: FloatArray
    """Position u of each node, shape (T, n + 1) [L]."""
    parameters: Parameters

    @property
    def contraction(self) -> FloatArray:
        """Shortening of each segment as a share of its length at rest, shape (T, n)."""
        return 1.0 + np.diff(self.nodes, axis=1)

    @property
    def starts(self) -> FloatArray:
        """Times when the middle segment becomes active [tau_E]."""
        active = self.excitation[:, self.excitation.shape[1] // 2 - 1] > self.parameters.E_half
        return self.time[1:][active[1:] & ~active[:-1]]

    @property
    def _steady(self) -> BoolArray:
        """Mask of the rows that belong to whole waves, without the first two waves."""
        starts = self.starts[2:]
        if len(starts) < 2:
            raise ValueError("the larva carries no waves, or the record is too short: it needs four of them")
        return np.asarray((self.time >= starts[0]) & (self.time <= starts[-1]))

    @property
    def period(self) -> float:
        """Time from wave to wave [tau_E]."""
        return float(np.diff(self.time[self._steady][[0, -1]])[0] / (len(self.starts) - 3))

    @property
    def speed(self) -> float:
        """Mean speed of the nodes over whole waves [L/tau_E]."""
        rows = self._steady
        ends = self.nodes[rows][[0, -1]].mean(axis=1)
        return float(np.diff(ends)[0] / np.diff(self.time[rows][[0, -1]])[0])

    @property
    def peak_contraction(self) -> float:
        """Greatest shortening of a segment."""
        return float(self.contraction[self._steady].max())

    @property
    def lifted(self) -> float:
        """Median number of segments that pull hard enough to be lifted."""
        return float(np.median((self.force[self._steady] > self.parameters.f_half).sum(axis=1)))


def crawling(
    duration: float = 200.0, segments: int = 10, parameters: Parameters | None = None, dt: float = 1e-3
) -> Crawling:
    """Simulate a larva from rest for a duration [tau_E]. A short input to the last segment starts the first wave.

    With a tenth of the time step `dt` [tau_E], the period, the speed and the contraction change by less than 0.1 %. The
    record has one row per 20 steps.
    """
    n = arguments.whole("segments", segments, ge=3)
    p, every = parameters or Parameters(), 20
    steps = arguments.number("duration", duration, "tau_E", gt=0) / arguments.number("dt", dt, "tau_E", gt=0)
    rows = int(steps) // every
    networks, nodes = np.empty((rows, 3, n)), np.empty((rows, n + 1))
    crawl(p, dt, every, networks, nodes)
    time = every * dt * np.arange(1.0, rows + 1.0)
    return Crawling(time, networks[:, 0], networks[:, 2], nodes, p)
