"""The fixed keys of the scene that would remove most of a fit's residuals if they were varied too: a score test.

The scene is run with each of the keys changed by itself. With the residuals e, the slopes J of the varied keys, the
effect d of a change and the weights W, the part of d beyond J is d' = d - J (J' W J)^-1 J' W d. Varying the key removes
the share

    (d' W e)^2 / (d' W d' e' W e)                                                                                  (F4)

of the weighted squares, to first order, and moves the varied keys by -g (J' W J)^-1 J' W d, g = d' W e/(d' W d').
Series are drawn from the noise that the best change would leave, and fitted in the same way. These series give the
chance that noise alone gives some change such a share. For a right scene the chance is small for any number of keys and
for any correlation of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scenes.studies.fit.noise import noise_of
from scenes.studies.fit.trials import SpentError, Trials
from scenes.studies.fit.uncertainty import Group, groups_of
from worm3d.values.arrays import FloatArray

SCALED_KEYS = (
    *("worm.mass_kg", "worm.density_kg_m3", "worm.half_height_m", "worm.spring_N", "worm.torsion_J"),
    *("worm.apex_hinge_N_m_rad", "worm.kelvin_voigt_time_s", "worm.actuator_lag_s", "friction.forward"),
    *("friction.backward", "friction.static_ratio", "hysteresis.moment_N_m", "hysteresis.load_ratio"),
    *("hysteresis.give_J", "hysteresis.spread", "gait.amplitude", "gait.period_s", "gait.wavelength"),
)
"""Keys that are changed where the scene has a nonzero number: keys of the body, its friction and the gait."""
ZEROS = {"worm.drag_N_s_m": 0.1, "world.slope_deg": 1.0, "ground.slope_deg": 1.0}
"""Keys that are changed where they are 0, with their new values."""
LAWS = ("friction.law=viscous", "friction.law=coulomb", "hysteresis.kind=jenkins", "hysteresis.kind=none")
"""Laws that replace the scene's law in the test."""
FACTOR = 1.5
"""Factor that multiplies or divides a number. At 1.1 contacts that stick a step later hide the effect; at 3 the worm
becomes a different worm."""
EFFECT = 1e-3
"""Least part of an effect, as a length, that the varied keys cannot reproduce."""
CHANCE = 0.005
"""Largest chance of noise that makes a share significant: one fit of a right scene in 200."""
CHANCE_DRAWS = 400
"""Number of drawn series; half as many cannot resolve `CHANCE`, twice as many cost time only."""


@dataclass(frozen=True, eq=False)
class Suspect:
    """A fixed key, and the effect of varying the key."""

    what: str
    """The key, or the other law as `key=value`."""
    value: float | None
    """Value of the key; None for a law."""
    larger: bool
    """Whether the data want a larger value."""
    share: float
    """Share of the weighted squares of the residuals that varying the key removes, (F4)."""
    shift: FloatArray
    """Change of the varied keys in their scales, shape (P,)."""

    @property
    def sentence(self) -> str:
        """The change of the scene, and the share of the squares that the change takes away."""
        way = "" if self.value is None else f", {'above' if self.larger else 'below'} {self.value:g}"
        return f"{self.what}{way} ({self.share:.0%})"


@dataclass(frozen=True)
class Suspects:
    """Changes of the scene that take most of the residuals away, the best first."""

    named: tuple[Suspect, ...] = ()
    chance: float = 1.0
    """Probability that noise alone gives one of all changes the best share."""

    @property
    def found(self) -> bool:
        """Whether the residuals resemble the effect of a change; the residuals of a right scene do not."""
        return self.chance <= CHANCE


NO_SUSPECTS = Suspects()


def suspects_of(
    trials: Trials, values: FloatArray, residuals: FloatArray, slopes: FloatArray, weights: FloatArray
) -> Suspects:
    """Return the fixed keys that would take most of the residuals away: up to three, with at least half the best share.

    Parameters
    ----------
    trials : Trials
        Used for some 40 runs, fewer if fewer runs are left.
    values : ndarray, shape (P,)
        Values of the varied keys at the minimum.
    residuals : ndarray, shape (C, T)
        NaN where nothing was measured.
    slopes : ndarray, shape (C, T, P)
        In scales of the keys.
    weights : ndarray, shape (C,)
    """
    tried = list(_tried(trials, values))
    if not tried:
        return NO_SUSPECTS
    whole = np.concatenate([np.nan_to_num(slopes), np.stack([effect for *_, effect in tried], axis=-1)], axis=-1)
    squared = weights[:, None, None] * whole
    lengths = np.sqrt((squared**2).sum(axis=(0, 1)))
    units = np.where(lengths > 0.0, lengths, 1.0)
    whole /= units
    units = units[: slopes.shape[-1]]
    test = _Test(whole, residuals, weights, slopes.shape[-1])
    shares, scores = test.shares([group.residuals for group in test.groups])
    order = np.argsort(-shares)
    best = [k for k in order if shares[k] >= 0.5 * shares[order[0]] > 0.0]
    named: dict[str, Suspect] = {}
    for k in best:
        what, value, larger, _ = tried[k]
        shift = -scores[k] * test.mends[:, k] / units
        named.setdefault(what, Suspect(what, value, larger == bool(scores[k] > 0.0), float(shares[k]), shift))
    return Suspects(tuple(named.values())[:3], test.chance(int(order[0]), float(shares[order[0]])))


def _tried(trials: Trials, values: FloatArray) -> Iterator[tuple[str, float | None, bool, FloatArray]]:
    """Yield each change, the value before it, whether the change is an increase, and its effect, shape (C, T)."""
    here = trials(values)
    assert here is not None  # the run at the minimum has come to its end
    for what, value, larger, override in _changes(trials):
        try:
            there = trials.changed(values, override)
        except SpentError:
            return
        if there is not None:
            yield what, value, larger, np.nan_to_num(there - here)


def _changes(trials: Trials) -> Iterator[tuple[str, float | None, bool, str]]:
    """Yield the key or law, the scene's value, whether the change is an increase, and the override."""
    fixed = {key: value for key in (*SCALED_KEYS, *ZEROS) if (value := trials.number(key)) is not None}
    for key, value in fixed.items():
        if key in ZEROS and value == 0.0:
            yield key, value, True, f"{key}={ZEROS[key]!r}"
        elif value != 0.0 and math.isfinite(value):
            yield key, value, value > 0.0, f"{key}={value * FACTOR!r}"
            yield key, value, value < 0.0, f"{key}={value / FACTOR!r}"
    for law in LAWS:
        yield law, None, True, law


class _Test:
    """Shares (F4) of K changes, for the residuals and for drawn series.

    Parameters
    ----------
    whole : ndarray, shape (C, T, P + K)
        Slopes and effects, of weighted length 1.
    residuals : ndarray, shape (C, T)
    weights : ndarray, shape (C,)
    p : int
        Number P of varied keys.
    """

    def __init__(self, whole: FloatArray, residuals: FloatArray, weights: FloatArray, p: int) -> None:
        gram = np.einsum("c,ctp,ctq->pq", weights**2, np.where(np.isfinite(residuals)[..., None], whole, 0.0), whole)
        self.inverse = np.linalg.pinv(gram[:p, :p], rcond=EFFECT**2, hermitian=True)
        self.mends = self.inverse @ gram[:p, p:]
        """Change of the varied keys that best reproduces the effect of each change, shape (P, K)."""
        self.groups: list[Group] = list(groups_of(residuals, whole, weights, np.eye(whole.shape[-1])))
        self._p, self._sizes = p, np.diag(gram)[p:] - np.einsum("pk,pk->k", gram[:p, p:], self.mends)

    def shares(self, series: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return shares and sizes g of the changes, shape (K,) each; 0 if the varied keys reproduce the change."""
        score = np.sum([group.score(each) for group, each in zip(self.groups, series, strict=True)], axis=0)
        power = sum(
            float(g.squared_weights @ (each**2).sum(axis=1)) for g, each in zip(self.groups, series, strict=True)
        )
        own, beyond = score[: self._p], score[self._p :] - self.mends.T @ score[: self._p]
        power -= float(own @ self.inverse @ own)
        counts = self._sizes > EFFECT**2
        sizes = np.where(counts, self._sizes, 1.0)
        return np.where(counts, beyond**2 / sizes / power, 0.0), np.where(counts, beyond / sizes, 0.0)

    def chance(self, best: int, share: float) -> float:
        """Return the probability that noise has a share as large; the noise is the rest after the best change."""
        random = np.random.default_rng(0)
        gain = self.shares([group.residuals for group in self.groups])[1][best]
        change = np.zeros(self._p + len(self._sizes))
        change[: self._p], change[self._p + best] = -gain * self.mends[:, best], gain
        models = [noise_of(group.residuals - group.slopes @ change) for group in self.groups]
        drawn = [
            [model.draw(g.residuals.shape[1], random) for g, model in zip(self.groups, models, strict=True)]
            for _ in range(CHANCE_DRAWS)
        ]
        beyond = sum(float(self.shares(each)[0].max()) >= share for each in drawn)
        return (1.0 + beyond) / (CHANCE_DRAWS + 1.0)
