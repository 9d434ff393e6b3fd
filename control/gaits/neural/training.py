"""Training of the chain of neurons on the waves of animals.

Constants of `control.gaits.neural.chain.EiChain` are sought whose waves have the median delays of one or more
recordings, each at its own pace. The sum of squares that is made least has as its terms

    ((delay - measured delay)/FRAME)^2         of each band between the first and the last, in each recording     (ET1)
    (pace_exponent - 1)/PACE_SPREAD            phases are expected to stay alike when the pace changes            (ET2)
    (share of active segments - DUTY)/DUTY_SPREAD                                                                 (ET3)
    CARRIED (share of noisy networks that fail)^(1/2)                                                             (ET4)

(ET1) is a square, so that errors count by their fourth power: less than a frame hardly does, which nobody can see,
much more than a frame does in no recording. The noisy networks have each constant of each population multiplied by 1 + NOISE N(0, 1); one fails unless its waves run
along the body, forward and backward. The first and last bands, each with a neighbour on one side only, are not fitted.
A recording's period is no result: the pace is set to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, minimize

from control.gaits.neural.chain import EiChain
from control.gaits.neural.waves import carrying, timing_of
from worm3d.values.arrays import FloatArray

FRAME = 0.05
"""Unit of the errors of delays: a frame of 20 pictures a second [s]."""
PACE_SPREAD = 1 / 3
"""Standard deviation of the expected exponent. Larvae that crawl slower have slower waves; two recordings with a single
pace each tell little of it. At 0.25 the exponent of the shipped fit is 0.1 larger, at 0.5 it is 0.2 smaller."""
DUTY, DUTY_SPREAD = 0.4, 0.1
"""Share of the period for which a segment is active, of the L1 larvae of `L1`: 0.32 to 0.48."""
NOISE, DRAWS, CARRIED = 0.125, 12, 6.0
"""Noise of the fit, a quarter above the 10 % that a network is to bear, so that failures tell early; networks drawn; and
weight: a failure in twelve costs as much as an error of 1.7 frames."""
SOUGHT = ("coupling_tail", "coupling_middle", "coupling_head", "inhibition", "drive", "tau_e")
"""Constants that are sought by their logarithms, and besides them the pace exponent."""
TRIES, RESTARTS = 250, 4
"""Most networks tried in a search, and most searches, each from the best so far."""
FAILED = 1e4
"""Sum of squares of a network without waves."""


@dataclass(frozen=True)
class Target:
    """What the waves of a recording are to be."""

    period: float
    """Time between two waves [s]."""
    delays: FloatArray
    """Delay of each segment behind the middle one, in the order in which a wave reaches them [s]; NaN: unknown."""


L1 = Target(
    period=5.04,
    delays=5.04 * np.array([-0.250, -0.180, -0.113, 0.0, 0.156, 0.291, 0.409, 0.482]),
)
"""First-instar larvae in channels, medians of 18 animals, segments A7 to T3 with A4 as the middle one: Greaney,
Heckscher, Kaufman, Journal of Neuroscience 2026, doi 10.1523/JNEUROSCI.1623-25.2026, data under CC BY 4.0."""


@dataclass(frozen=True)
class Training:
    """Outcome of a fit."""

    gait: EiChain
    """The fitted chain, at the pace of the first recording."""
    cost: float
    """Sum of the squares (ET1) to (ET4)."""
    tried: int
    """Networks tried."""


class Stopped(Exception):
    """The fit was asked to end."""


def fit(
    targets: Sequence[Target], begin: EiChain | None = None, go_on: Callable[[int], bool] = lambda tried: True
) -> Training:
    """Return the chain that fits the targets best.

    Parameters
    ----------
    targets : sequence of Target
        All with the same number of segments.
    begin : EiChain, optional
        Where the search begins.
    go_on : callable
        Called with the number of networks tried so far; where it returns False, `Stopped` is raised.
    """
    begin = begin or EiChain()
    at = np.array([*(np.log(getattr(begin, name)) for name in SOUGHT), begin.pace_exponent])
    tried = 0

    def cost(point: FloatArray) -> float:
        nonlocal tried
        tried += 1
        if not go_on(tried):
            raise Stopped
        return float(np.sum(residuals(gait_at(point, begin), targets) ** 2)) if _inside(point) else FAILED

    def smooth(point: FloatArray) -> FloatArray:
        cost(point)
        return residuals(gait_at(point, begin), targets, draws=0)

    bounds = ([-3.0] * 3 + [0.5, 0.05, -6.0, 0.0], [3.0] * 3 + [4.0, 3.0, 2.0, 2.0])
    at = least_squares(smooth, at, bounds=bounds, diff_step=1e-2, max_nfev=30).x
    best = cost(at)
    for _ in range(RESTARTS):
        simplex = np.vstack([at, at + np.diag([0.1] * len(SOUGHT) + [-0.1])])
        options = {"maxfev": TRIES, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-3}
        found = minimize(cost, at, method="Nelder-Mead", options=options)
        gained, at, best = best - found.fun, found.x, float(found.fun)
        if gained < 0.02 * best:
            break
    return Training(replace(gait_at(at, begin), period=targets[0].period), best, tried)


def gait_at(point: FloatArray, like: EiChain) -> EiChain:
    """Return the chain with the constants of a point of the search."""
    sought: Mapping[str, float] = dict(zip(SOUGHT, np.exp(point[:-1]).tolist(), strict=True))
    return replace(like, **sought, pace_exponent=float(point[-1]))


def _inside(point: FloatArray) -> bool:
    """Return whether a point is one of a chain: the drive above the threshold, and an exponent in its range."""
    return bool(point[SOUGHT.index("drive")] > 0.0 and 0.0 <= point[-1] <= 2.0)


def residuals(gait: EiChain, targets: Sequence[Target]) -> FloatArray:
    """Return the terms (ET1) to (ET4) of a chain; one that makes no waves has a single large one."""
    terms: list[float] = [(gait.pace_exponent - 1.0) / PACE_SPREAD]
    try:
        for target in targets:
            timing = timing_of(replace(gait, period=target.period), len(target.delays))
            errors = ((timing.delays - target.delays)[1:-1] / FRAME) ** 2
            terms += [*errors[np.isfinite(errors)], (timing.duty - DUTY) / DUTY_SPREAD]
    except ValueError:
        return np.array([np.sqrt(FAILED)])
    paces = [target.period for target in targets]
    middling = replace(gait, period=float(np.exp(np.mean(np.log(paces)))))
    share = 1.0 - carrying(middling, len(targets[0].delays), NOISE, DRAWS)
    return np.array([*terms, CARRIED * np.sqrt(share)])
