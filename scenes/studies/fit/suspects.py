"""Score test for fixed keys: which fixed keys would remove most of the residuals of a fit if they were varied too.

The scene is run with one fixed key or law changed at a time. Let e be the residuals, J the slopes of the varied keys, W
the weights, and d the effect of a change on the simulation. The varied keys can reproduce a part of d; the rest is r =
d - J (J' W J)^-1 J' W d, where the prime denotes the transpose. To first order, varying the fixed key as well removes
the fraction

    (r' W e)^2 / (r' W r e' W e)                                                                                   (F4)

of the weighted sum of squares, and changes the varied keys by -g (J' W J)^-1 J' W d with g = r' W e/(r' W r). The
denominator e' W e is taken after e has been fitted by J. A change with a large fraction is called a suspect.

To test whether noise alone could give so large a fraction, random series are drawn from a model of the residuals that
the best change would leave, and are fitted in the same way. If the scene is correct, the test reports a suspect rarely,
however many keys are tried and however the noise is correlated.
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
"""Keys of the body, the friction and the gait that are multiplied and divided by `FACTOR` if they have a value other
than 0."""
ZEROS = {"worm.drag_N_s_m": 0.1, "world.slope_deg": 1.0, "ground.slope_deg": 1.0}
"""Keys that are changed from 0 to the given value if the scene has a value of 0, or by `FACTOR` otherwise."""
LAWS = ("friction.law=viscous", "friction.law=coulomb", "hysteresis.kind=jenkins", "hysteresis.kind=none")
"""Overrides that replace a law of the scene."""
FACTOR = 1.5
"""The value of a key is multiplied or divided by this factor. With 1.1, the effect of the change is hidden by contacts
that stick a time step earlier or later. With 3, the worm moves in a very different way."""
EFFECT = 1e-3
"""Smallest length of r relative to the length of d. If r is shorter, the varied keys reproduce the change."""
CHANCE = 0.005
"""A fraction is significant up to this probability under noise. Of 200 fits of correct scenes, one is significant
by chance."""
CHANCE_DRAWS = 400
"""Number of random series. With 200, the probability cannot be compared with `CHANCE`. With 800, the result is the same
and the test takes longer."""


@dataclass(frozen=True, eq=False)
class Suspect:
    """A fixed key, and the effect of varying the key."""

    what: str
    """The key; for a law, the new law as `key=value`."""
    value: float | None
    """Value of the key in the scene; None for a law."""
    larger: bool
    """Whether a larger value of the key fits the data better."""
    share: float
    """Fraction of the weighted sum of squares that varying the key removes, (F4)."""
    shift: FloatArray
    """Change of the varied keys when the key is varied too, in units of their scales, shape (P,)."""

    @property
    def sentence(self) -> str:
        """The change of the scene, and the fraction of the sum of squares that it removes."""
        way = "" if self.value is None else f", {'above' if self.larger else 'below'} {self.value:g}"
        return f"{self.what}{way} ({self.share:.0%})"


@dataclass(frozen=True)
class Suspects:
    """Fixed keys that would remove most of the residuals."""

    named: tuple[Suspect, ...] = ()
    """The suspects, sorted from the largest fraction (F4) to the smallest."""
    chance: float = 1.0
    """Probability that under noise alone at least one of the tried changes has a fraction as large as the best."""

    @property
    def found(self) -> bool:
        """Whether the best fraction is significant, so that the residuals resemble the effect of a change."""
        return self.chance <= CHANCE


NO_SUSPECTS = Suspects()


def suspects_of(
    trials: Trials, values: FloatArray, residuals: FloatArray, slopes: FloatArray, weights: FloatArray
) -> Suspects:
    """Return up to three fixed keys that would remove most of the residuals.

    Only keys with at least half of the best fraction (F4) are returned.

    Parameters
    ----------
    trials : Trials
        Makes about 40 runs, or as many runs as are still allowed.
    values : ndarray, shape (P,)
        Values of the varied keys at the minimum.
    residuals : ndarray, shape (C, T)
        NaN where nothing was measured.
    slopes : ndarray, shape (C, T, P)
        Slopes of the varied keys, in units of their scales.
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
    """Yield, for each change: the key or law, the scene's value, whether the change is an increase, and the effect.

    The effect, shape (C, T), is the change of the simulated channels. Changes whose runs fail are left out.
    """
    here = trials(values)
    assert here is not None  # the run at the minimum is known to succeed
    for what, value, larger, override in _changes(trials):
        try:
            there = trials.changed(values, override)
        except SpentError:
            return
        if there is not None:
            yield what, value, larger, np.nan_to_num(there - here)


def _changes(trials: Trials) -> Iterator[tuple[str, float | None, bool, str]]:
    """Yield the key or law, the scene's value, whether the change is an increase, and the override, for each change."""
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
    """Fractions (F4) of K changes, for the residuals and for random series.

    Parameters
    ----------
    whole : ndarray, shape (C, T, P + K)
        Slopes of the P varied keys, then effects of the K changes, each scaled to a weighted length of 1.
    residuals : ndarray, shape (C, T)
    weights : ndarray, shape (C,)
    p : int
        Number P of varied keys.
    """

    def __init__(self, whole: FloatArray, residuals: FloatArray, weights: FloatArray, p: int) -> None:
        gram = np.einsum("c,ctp,ctq->pq", weights**2, np.where(np.isfinite(residuals)[..., None], whole, 0.0), whole)
        self.inverse = np.linalg.pinv(gram[:p, :p], rcond=EFFECT**2, hermitian=True)
        self.mends = self.inverse @ gram[:p, p:]
        """Changes of the varied keys that reproduce the effect of each change best, shape (P, K)."""
        self.groups: list[Group] = list(groups_of(residuals, whole, weights, np.eye(whole.shape[-1])))
        self._p, self._sizes = p, np.diag(gram)[p:] - np.einsum("pk,pk->k", gram[:p, p:], self.mends)

    def shares(self, series: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the fraction (F4) and the factor g of each change, with a shape of (K,) each.

        Both are 0 for a change that the varied keys reproduce. `series` has the residuals of each group.
        """
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
        """Return the probability that under noise at least one change has a fraction of `share` or more.

        The noise is modelled after the residuals without the effect of the change with the index `best`.
        """
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
