"""Regimes of the contacts, for steps where the kinks of the contact law prevent convergence of Newton's method.

A contact is open, stuck, or sliding. A stuck or sliding contact is displaced towards the head or towards the tail. With
given regimes the equations of a step are smooth. An open contact has no load even if it penetrates the ground, a closed
contact has its linear load even if this load pulls, and friction is a single branch of (G2). If the regimes agree with
the law at the solution, this is the solution of the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planar.linkage.element import OPEN, SLIDE, STICK, Now
from planar.linkage.ground import LIMIT_TOLERANCE, Ground
from planar.linkage.segment_law import SegmentLaw
from planar.linkage.shape import apexes_by_law
from worm3d.values.arrays import FloatArray

Regimes = NDArray[np.int64]

AT_ONCE = 10
"""Number of first rounds, which change all regimes that disagree with the law. Later rounds change only the regime that
violates the law most, so that two regimes do not alternate forever."""


def of_law(q: FloatArray, law: SegmentLaw, ground: Ground, now: Now) -> Regimes:
    """Return the regimes that the law of contact gives at q, shape (N, 2); `law` is the segment law."""
    _, y, limit = gauge(q, law, ground, now)
    slides = np.abs(y) > limit
    return np.where(_load(q, law, ground, now) > 0.0, np.where(slides, SLIDE, STICK) + (y <= 0.0), OPEN)


def after(q: FloatArray, law: SegmentLaw, ground: Ground, now: Now, turn: int) -> Regimes:
    """Return the regimes for the next round, shape (N, 2), given the solution q for the regimes in `now`.

    If q obeys the law, the regimes do not change. A contact that slides although its friction is below the limit
    becomes stuck. Only a stuck contact can change its direction or begin to slide. `turn` is the number of the round.
    """
    (_, y, limit), load = gauge(q, law, ground, now), _load(q, law, ground, now)
    old, scale = now.regime, max(float(np.abs(load).mean()), 1e-300)
    tail = old % 2
    along = np.where(tail == 1, -y, y) / limit
    kinds = [old == OPEN, load < 0.0, old >= SLIDE, along < 0.0]
    wrong = np.select(kinds, [load / scale, -load / scale, 1.0 - along, -along], along - 1.0)
    new = np.select(kinds, [of_law(q, law, ground, now), OPEN, STICK + tail, STICK + 1 - tail], SLIDE + tail)
    denied = wrong > LIMIT_TOLERANCE
    if turn >= AT_ONCE and denied.any():
        denied = wrong == wrong.max()
    return np.where(denied, new, old)


def gauge(q: FloatArray, law: SegmentLaw, ground: Ground, now: Now) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s*, y = s - s* and cap b of (G2) at q, whatever the given regimes are; each of shape (N, 2) [m]."""
    x = apexes_by_law(q.reshape(-1, 2), now.l_cmd, law)[..., 0]
    r = 1.0 / (1.0 / ground.yield_gauge + ground.gauge_damping / now.dt)
    centre = ground.gauge_damping / now.dt * r * now.slide_n
    y = now.direction[:, None] * (x - now.anchor) - centre
    mu = np.where(y > 0.0, ground.mu_forward[:, None], ground.mu_backward[:, None])
    return centre, y, now.cap * r / np.maximum(mu, ground.least)


def _load(q: FloatArray, law: SegmentLaw, ground: Ground, now: Now) -> FloatArray:
    """Return the linear load of the contacts, shape (N, 2) [N]; it is negative where an apex is above the ground."""
    z = apexes_by_law(q.reshape(-1, 2), now.l_cmd, law)[..., 1]
    return np.asarray(-(ground.stiffness + ground.damping / now.dt) * z - ground.damping / now.dt * now.depth_n)
