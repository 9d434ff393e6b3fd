"""Stable heteroclinic cycles: saddles that are visited one after the other; noise sets the time at each saddle.

    da_i = (a_i (alpha_i - sum_j rho_ij a_j) + u_i) dt + eps dW_i,   i = 0 ... n-1, a_i >= 0,                (SH1)
    rho_ii = alpha_i/beta_i,  rho_(i+1)i = (alpha_(i+1) - alpha_i/nu_i)/beta_i,
    rho_ji = (alpha_j + alpha_i)/beta_i for the other j                                                     (SH2)

(Horchler, Daltorio, Chiel, Quinn: Designing responsive pattern generators, Bioinspiration & Biomimetics 10, 2015,
026001). Node i is the saddle with a_i = beta_i and all other states zero. From this saddle a_(i+1) grows with the rate
lam_u = alpha_i/nu_i, and all others decay with alpha_i, so that the cycle is stable if nu > 1; node 0 follows node n-1.
A saddle is left when the noise, or the input u_(i+1), has grown to a share DELTA of beta.

*Passage.* The state that leaves node i was at node i-1 before, and decayed there with lam_s = alpha_(i-1). The state
thus begins with the standard deviation eps/sqrt(2 lam_s), and on average passes after

    tau_p = [2 ln(DELTA beta_(i+1)/eps) + ln(4 lam_u) - ln(1 + lam_u/lam_s) + gamma_E]/(2 lam_u)            (SH3)

(Stone, Holmes 1990) with the standard deviation pi/(2 sqrt(2) lam_u), for any noise. *Transition.* A logistic growth
from the share DELTA of beta to 1 - DELTA takes

    tau_t = 2 ln(1/DELTA - 1)/alpha_(i+1).                                                                  (SH4)

*Limit.* The sum of both is a few percent off, since the other states do not wait until a transition is over. In the
limit of small noise, the path from one saddle to the next is the path without noise, started at a small share c of
beta. Along this path the state that leaves the next saddle obeys da = g(t) a dt + eps dW. Let v be the variance of this
state over eps^2 at the time t_e of arrival at the next saddle; this saddle has the rate lam_u, and is left at the share
c again. Then

    dv/dt = 2 g v + 1, v = 1/(2 alpha_i) before,
    T = t_e + [2 ln(c beta_(i+2)/eps) - ln(v + 1/(2 lam_u)) + gamma_E + ln 2]/(2 lam_u).                    (SH5)

The sum of all T is the period, with an error that vanishes with the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from control.gaits.shc.kernel import advance
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

DELTA = 0.1
"""A passage ends and a transition begins at this share of beta; the transition ends at 1 - DELTA."""
EARLY = 1e-6
"""In (SH5) the path to the next saddle begins at this share c of beta; the error of (SH5) is proportional to c."""
BLOCK_STEPS = 4096
"""Number of steps, and of random numbers, in a block."""


@dataclass(frozen=True, init=False, eq=False)
class Cycle:
    """Cycle of n saddles.

    Raises
    ------
    ValueError
        Fewer than three nodes, numbers out of range, or noise that is too large for a passage.
    """

    alpha: FloatArray
    """Rate alpha of each node, shape (n,) [1/s]."""
    beta: FloatArray
    """Size beta of each state at the state's saddle, shape (n,)."""
    nu: FloatArray
    """Saddle value nu of each node, above 1, shape (n,)."""
    noise: float
    """Size eps of the noise, in units of a state a square root of a second."""

    def __init__(
        self, nodes: int, *, alpha: ArrayLike = 2.0, beta: ArrayLike = 1.0, nu: ArrayLike = 1.5, noise: float = 1e-8
    ) -> None:
        n = arguments.whole("nodes", nodes, ge=3)  # each but the next suppresses the active one's follower
        given = {"alpha": (alpha, 0.0), "beta": (beta, 0.0), "nu": (nu, 1.0)}
        for name, (value, least) in given.items():
            object.__setattr__(self, name, arguments.array(name, value, (n,), fill=True, gt=least))
        object.__setattr__(self, "noise", float(noise))
        # (SH3) holds within 0.5 % of 1/lam_u if 2 e^gamma_E lam_u (DELTA beta/eps)^2 is at least 20.
        excursion = np.sqrt(2.0 * np.exp(np.euler_gamma) * self.leaving / 20.0)
        most = float(np.min(DELTA * np.roll(self.beta, -1) * excursion))
        if not 0.0 < self.noise <= most:
            raise ValueError(
                f"noise: got {noise!r}, must be above 0 and at most {most:.3g}: with more of it the cycle "
                "waits at no saddle"
            )

    @property
    def nodes(self) -> int:
        """Number n of nodes."""
        return len(self.alpha)

    @property
    def leaving(self) -> FloatArray:
        """Rate lam_u = alpha/nu of leaving a saddle, at most the alpha of the next node, shape (n,) [1/s]."""
        return np.asarray(np.minimum(self.alpha / self.nu, np.roll(self.alpha, -1)))

    @cached_property
    def rho(self) -> FloatArray:
        """Matrix rho of (SH2), shape (n, n)."""
        a, n = self.alpha, np.arange(self.nodes)
        rho = (a[:, None] + a) / self.beta
        following = (n + 1) % self.nodes
        rho[n, n] = a / self.beta
        rho[following, n] = (a[following] - self.leaving) / self.beta
        return np.maximum(rho, 0.0)  # negative where a node is left faster than the next node's alpha

    @property
    def formula_period(self) -> float:
        """Mean period as the sum of passages and transitions, (SH3) and (SH4) [s]."""
        leaving, waited = self.leaving, np.roll(self.alpha, 1)
        share = DELTA * np.roll(self.beta, -1) / self.noise
        found = 2.0 * np.log(share) + np.log(4.0 * leaving) - np.log1p(leaving / waited) + np.euler_gamma
        transitions = 2.0 * np.log(1.0 / DELTA - 1.0) / np.roll(self.alpha, -1)
        return float((found / (2.0 * leaving) + transitions).sum())

    @cached_property
    def mean_times(self) -> FloatArray:
        """Mean time of each node as the most active node in the limit of small noise, by (SH5), shape (n,) [s]."""
        times, switches = np.array([self._way(node) for node in range(self.nodes)]).T
        return np.asarray(np.roll(times, 1) + switches - np.roll(switches, 1))

    @property
    def mean_period(self) -> float:
        """Mean period in the limit of small noise, the sum of `mean_times` [s]."""
        return float(self.mean_times.sum())

    def lasting(self, period: float) -> Cycle:
        """Return the same cycle in another unit of time, with the given mean period [s]."""
        faster = self.mean_period / period
        noise = self.noise * np.sqrt(faster)
        return Cycle(self.nodes, alpha=self.alpha * faster, beta=self.beta, nu=self.nu, noise=noise)

    def _way(self, node: int) -> tuple[float, float]:
        """Return the time T of (SH5) from a node to the next, and the time when both are equally active [s]."""
        here = (np.arange(3) + node) % self.nodes
        beta, then = self.beta[here], float(self.leaving[here[1]])
        rho = tuple(map(tuple, self.rho[np.ix_(here, here)].tolist()))
        leaving = float(self.leaving[here[0]])
        end, switch, variance = _quiet_way(tuple(self.alpha[here].tolist()), tuple(beta.tolist()), rho, leaving)
        passed = 2.0 * np.log(EARLY * beta[2] / self.noise) - np.log(variance + 0.5 / then)
        return end + float(passed + np.euler_gamma + np.log(2.0)) / (2.0 * then), switch


@lru_cache(maxsize=256)
def _quiet_way(
    alpha: tuple[float, ...], beta: tuple[float, ...], rho: tuple[tuple[float, ...], ...], leaving: float
) -> tuple[float, float, float]:
    """Follow the path from a saddle to the next without noise, for nodes 0, 1 and 2; node 2 stays small.

    Returns
    -------
    end, switch : float
        Time t_e, and time when nodes 0 and 1 are equally active, both since a_1 = EARLY beta_1 [s].
    variance : float
        v of node 2 at the end [s].
    """
    rates, coupling = np.array(alpha), np.array(rho)
    # Along the eigenvector of the saddle: a_0 is behind by a_1 rho_01 beta_0/(alpha_0 + lam_u).
    first = EARLY * beta[1]
    start = [beta[0] - first * rho[0][1] * beta[0] / (alpha[0] + leaving), first, 0.5 / alpha[0]]

    def slope(_: float, y: FloatArray) -> list[float]:
        rate = rates - coupling[:, 0] * y[0] - coupling[:, 1] * y[1]
        return [y[0] * rate[0], y[1] * rate[1], 2.0 * y[2] * rate[2] + 1.0]

    def equal(_: float, y: FloatArray) -> float:
        return float(y[0] * beta[1] - y[1] * beta[0])

    end = -np.log(EARLY) * (1.0 / leaving + 2.0 / alpha[1])
    way = solve_ivp(slope, (0.0, end), start, method="DOP853", rtol=1e-9, atol=1e-14, events=equal)
    return end, float(way.t_events[0][0]), float(way.y[2, -1])


class Walk:
    """States of a cycle over time; the same seed gives the same walk, for any division into parts.

    Parameters
    ----------
    cycle : Cycle
    seed : int
        Seed of the noise.
    dt : float, optional
        Time step [s]; by default a tenth over the largest alpha: 44 steps a transition. Twice this step changes the
        mean period by less than 0.1 %.
    """

    def __init__(self, cycle: Cycle, seed: int = 0, dt: float | None = None) -> None:
        self.cycle, self.dt = cycle, 0.1 / float(cycle.alpha.max()) if dt is None else dt
        self._random = np.random.default_rng([seed, crc32(b"shc")])
        waiting = cycle.noise / np.sqrt(2.0 * cycle.alpha)
        self.states = waiting * np.abs(self._random.standard_normal(cycle.nodes))
        self.states[0] = cycle.beta[0]
        self.push = np.zeros(cycle.nodes)
        """Input u of each node, shape (n,), at least 0 [1/s]."""

    def advance(self, steps: int) -> FloatArray:
        """Take steps and return the states after each, shape (steps, n)."""
        path = np.empty((steps, self.cycle.nodes))
        for first in range(0, steps, BLOCK_STEPS):
            part = path[first : first + BLOCK_STEPS]
            draws = self._random.standard_normal(part.shape)
            advance(self.states, self.cycle.alpha, self.cycle.rho, self.cycle.noise, self.push, self.dt, draws, part)
        return path


def sojourns(walk: Walk, count: int) -> FloatArray:
    """Return how long each of the next nodes has the largest a/beta, shape (count,) [s].

    The first counted sojourn begins with the first switch.
    """
    active = [int(np.argmax(walk.states / walk.cycle.beta))]
    switches: list[float] = []
    taken = 0
    while len(switches) <= count:
        path = np.argmax(walk.advance(BLOCK_STEPS) / walk.cycle.beta, axis=1)
        changes = np.flatnonzero(np.diff(path, prepend=active[-1]))
        switches.extend((taken + changes) * walk.dt)
        active, taken = [int(path[-1])], taken + BLOCK_STEPS
    return np.diff(np.array(switches[: count + 1]))
