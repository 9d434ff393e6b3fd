"""Training of the chain of neurons on the waves of animals.

The training fits the constants of `control.gaits.neural.chain.EiChain` to one or more recordings. At the pace of each
recording, the waves should have the median delays of this recording, and noise should disturb the waves little. The
fit minimises the sum of the squares of

    g((delay - measured delay)/FRAME)       each segment except the middle segment, each recording                (ET1)
    (share of active segments - DUTY)/DUTY_SPREAD                           each recording                        (ET2)
    second difference of ln tau_e along the body, which keeps tau_e smooth                                        (ET3)
    CARRIED * (share of 60 noisy networks that fail to carry direct or retrograde waves)                          (ET4)

where g(e) = e |e| up to LINEAR_ERROR frames, and g is linear beyond. The weight of small errors is small, since a small
part of a frame is not visible. (ET1) to (ET3) are smooth. Least squares minimise them over tau_e, the inhibition and
the exponent of pace for each of `COUPLINGS`, and the coupling with the smallest sum of (ET1) to (ET4) is chosen. The
period of a recording is not fitted, since the pace is set to this period. Delays at two or more paces determine the
exponent of pace. A single pace does not determine the exponent, and no term keeps the exponent near an expected value,
since `control.gaits.neural.shared` already accounts for the expected value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from control.gaits.neural.chain import EiChain
from control.gaits.neural.waves import carrying, timing_of
from worm3d.values.arrays import FloatArray

FRAME = 0.05
"""Unit of the errors of delays: the duration of a frame at 20 frames per second [s]."""
LINEAR_ERROR = 3.0
"""Error above which g is linear, in frames."""
DUTY, DUTY_SPREAD = 0.4, 0.1
"""Share of the period during which a segment is active, and standard deviation of this share. In the larvae of `L1`,
the share is 0.32 to 0.48."""
COUPLINGS = (1.8, 2.0, 2.2)
"""Values of the coupling, the weight of a neighbour, that the fit compares, in units of the threshold. Below 1.6, noise
stops waves. Above 3, noise makes segments burst without input."""
DIFFERENCE_STEPS = (3e-2, 5e-3)
"""Relative steps of the finite differences in the two rounds of a search. The second round starts from the result of
the first."""
CARRIED = 4.0
"""Weight of the share of networks that fail. A failure in one of four networks counts as much as a delay that is wrong
by one frame."""


@dataclass(frozen=True)
class Target:
    """Target of the waves."""

    period: float
    """Time between two waves [s]."""
    delays: FloatArray
    """Delay of each segment behind the middle segment, in the order of the wave [s], shape (N,)."""


L1 = Target(period=5.04, delays=5.04 * np.array([-0.250, -0.180, -0.113, 0.0, 0.156, 0.291, 0.409, 0.482]))
"""First-instar larvae in channels, medians of 18 animals, segments A7 to T3 with A4 as the middle segment: Greaney,
Heckscher, Kaufman, Journal of Neuroscience 2026, doi 10.1523/JNEUROSCI.1623-25.2026, data under CC BY 4.0."""


@dataclass(frozen=True)
class Training:
    """Result of a fit."""

    gait: EiChain
    """The fitted chain, at the pace of the first recording."""
    cost: float
    """Sum of the squares (ET1) to (ET4)."""
    carried: float
    """Share of the noisy networks of (ET4) that carry waves."""
    tried: int
    """Number of networks that were evaluated, without the noisy networks of (ET4)."""


class StoppedError(Exception):
    """The fit was stopped by the caller."""


def fit(
    targets: Sequence[Target],
    like: EiChain | None = None,
    go_on: Callable[[int], bool] = lambda done: True,
) -> Training:
    """Return the chain that fits the targets best.

    Parameters
    ----------
    targets : sequence of Target
        All with the same number of segments, at least 3.
    like : EiChain, optional
        Chain with the parameters that are not fitted, such as the direction. The default is the default chain.
    go_on : callable
        Function that is called with the number of networks evaluated so far, before each further evaluation. If it
        returns False, `StoppedError` is raised.

    Raises
    ------
    ValueError
        There is no target, the targets differ in the number of segments, or they have fewer than 3 segments.
    StoppedError
        `go_on` returned False.
    """
    sizes = {len(target.delays) for target in targets}
    if len(sizes) != 1 or min(sizes) < 3:
        raise ValueError(f"targets: got delays of {sorted(sizes)} segments, must be equally many, and at least 3")
    segments = sizes.pop()
    step = np.mean([np.ptp(target.delays) * (2.0 / target.period) for target in targets]) / (segments - 1)
    point = np.array([np.log(6.5), *np.full(segments, np.log(0.9 * step)), 0.8])
    pace = float(np.exp(np.mean([np.log(target.period) for target in targets])))
    bounds = [0.5, *np.full(segments, np.log(step / 10)), 0.0], [4.0, *np.full(segments, np.log(10 * step)), 2.0]
    tried = 0

    def terms(at: FloatArray, base: EiChain) -> FloatArray:
        nonlocal tried
        tried += 1
        if not go_on(tried):
            raise StoppedError
        return residuals(gait_at(at, base), targets)

    best = Training(EiChain(), np.inf, 0.0, 0)
    for coupling in COUPLINGS:
        base, at, squares = replace(like or EiChain(), coupling=coupling, period=pace), point, np.inf
        for difference in DIFFERENCE_STEPS:
            found = least_squares(terms, at, bounds=bounds, diff_step=difference, args=(base,), max_nfev=40)
            at, squares = found.x, 2.0 * float(found.cost)
        gait = gait_at(at, base)
        # The noise is 1.5 times the noise that a network should tolerate, so that weak networks fail in the fit.
        share = carrying(gait, segments, noise=0.15, draws=60, seed=1)
        cost = squares + (CARRIED * (1.0 - share)) ** 2
        if cost < best.cost:
            best = Training(replace(gait, period=targets[0].period), cost, share, 0)
    return replace(best, tried=tried)


def gait_at(point: FloatArray, like: EiChain) -> EiChain:
    """Return the chain for a point of the search.

    A point consists of the logarithms of `inhibition` and of each of `tau_e`, and of the exponent of pace.
    """
    return replace(like, inhibition=float(np.exp(point[0])), tau_e=np.exp(point[1:-1]), pace_exponent=float(point[-1]))


def residuals(gait: EiChain, targets: Sequence[Target]) -> FloatArray:
    """Return the terms (ET1) to (ET3) of a chain.

    If the chain makes no waves at the pace of a target, the terms (ET1) and (ET2) of this target are 1000.
    """
    terms = [*np.diff(np.log(gait.tau_e), 2)]
    for target in targets:
        segments = len(target.delays)
        try:
            timing = timing_of(replace(gait, period=target.period), segments)
        except ValueError:
            terms += [1e3] * segments
            continue
        errors = np.delete(timing.delays - target.delays, segments // 2) / FRAME
        terms += [*weighed(errors), (timing.duty - DUTY) / DUTY_SPREAD]
    return np.nan_to_num(np.asarray(terms, dtype=np.float64))


def weighed(errors: FloatArray) -> FloatArray:
    """Return the function g of (ET1) for errors in frames."""
    size = np.abs(errors)
    weighed = np.where(size < LINEAR_ERROR, size**2, (2.0 * size - LINEAR_ERROR) * LINEAR_ERROR)
    return np.asarray(np.sign(errors) * weighed)
