"""Regimes of the contacts: Newton solves with given regimes if the law's kinks prevent convergence.

A contact is open, or it is stuck or slides, towards the head or the tail. With given regimes a step is smooth: an open
contact has no load even at a positive depth, another contact has its linear load even if the load would pull, and
friction is one branch of (G2). A solution whose regimes agree with the law solves the step itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planar.linkage.element import OPEN, SLIDE, STICK, Now
from planar.linkage.ground import LIMIT_TOLERANCE, Ground
from planar.linkage.shape import apexes
from worm3d.values.arrays import FloatArray

Regimes = NDArray[np.int64]

AT_ONCE = 10
"""Rounds that change all regimes denied by the law; later rounds change only the most denied regime, so that no two
regimes alternate without end."""


def of_law(q: FloatArray, a: FloatArray, ground: Ground, now: Now) -> Regimes:
    """Return the regimes at q by the law itself, shape (N, 2); `a` is the length of the links."""
    _, y, limit = gauge(q, a, ground, now)
    slides = np.abs(y) > limit
    return np.where(_load(q, a, ground, now) > 0.0, np.where(slides, SLIDE, STICK) + (y <= 0.0), OPEN)


def after(q: FloatArray, a: FloatArray, ground: Ground, now: Now, turn: int) -> Regimes:
    """Return the regimes after the regimes in `now`, for which q solves the step; the same if q obeys the law.

    A sliding contact comes to rest before the direction reverses, and reverses before the contact slides the other way.
    """
    (_, y, limit), load = gauge(q, a, ground, now), _load(q, a, ground, now)
    old, scale = now.regime, max(float(np.abs(load).mean()), 1e-300)
    tail = old % 2
    along = np.where(tail == 1, -y, y) / limit
    kinds = [old == OPEN, load < 0.0, old >= SLIDE, along < 0.0]
    wrong = np.select(kinds, [load / scale, -load / scale, 1.0 - along, -along], along - 1.0)
    new = np.select(kinds, [of_law(q, a, ground, now), OPEN, STICK + tail, STICK + 1 - tail], SLIDE + tail)
    denied = wrong > LIMIT_TOLERANCE
    if turn >= AT_ONCE and denied.any():
        denied = wrong == wrong.max()
    return np.where(denied, new, old)


def gauge(q: FloatArray, a: FloatArray, ground: Ground, now: Now) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s*, y = s - s* and cap b of (G2) at q by the law, each of shape (N, 2) [m]."""
    x = apexes(q.reshape(-1, 2), a)[..., 0]
    r = 1.0 / (1.0 / ground.yield_gauge + ground.gauge_damping / now.dt)
    centre = ground.gauge_damping / now.dt * r * now.slide_n
    y = now.direction[:, None] * (x - now.anchor) - centre
    mu = np.where(y > 0.0, ground.mu_forward[:, None], ground.mu_backward[:, None])
    return centre, y, now.cap * r / np.maximum(mu, ground.least)


def _load(q: FloatArray, a: FloatArray, ground: Ground, now: Now) -> FloatArray:
    """Return the linear load, negative where a contact is apart, shape (N, 2) [N]."""
    z = apexes(q.reshape(-1, 2), a)[..., 1]
    return np.asarray(-(ground.stiffness + ground.damping / now.dt) * z - ground.damping / now.dt * now.depth_n)
