"""Uncertainty of weighted least-squares estimates with correlated residuals.

Let W be the weights, J the slopes, and e the noise with the covariance G. The error of the estimates is A^-1 J' W e
with A = J' W J, so that

    covariance = A^-1 (J' W G W J) A^-1                                                                            (F2)

(H. White, Econometrica 48, 1980). G follows from an autoregressive model of the residuals of each channel, (F1) of
`scenes.studies.fit.noise`. Because residuals of a fit are smaller and less correlated than the noise, (F2) is too
small. To correct this, random series are drawn from the model and fitted in the same way. They give the bias and the
variance of (F2). The variance gives the degrees of freedom of Student's distribution (F. E. Satterthwaite, Biometrics
Bulletin 2, 1946). The intervals are computed from this distribution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, special

from scenes.studies.fit.noise import Noise, noise_of, spectra_of
from worm3d.values.arrays import BoolArray, FloatArray

UNCERTAINTY_DRAWS = 200
"""Number of random series. With 100, the widths of the intervals vary by 5 % with the random numbers. With 400, they
vary by 2.5 %."""
MOST_CHANNELS = 24
"""Largest number of channels of a group whose residuals are modelled directly. If a group has more channels, they are
replaced by this number of combinations. Only the combinations that the keys affect are needed."""
MOST_SERIES = 2400
"""Largest product of the number of random series and the number of channels. With many channels, fewer series are
drawn, but at least `LEAST_DRAWS`."""
LEAST_DRAWS = 20
"""Smallest number of random series."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of P estimates."""

    covariance: FloatArray
    """Covariance of the estimates, shape (P, P)."""
    half_width: FloatArray
    """Half of the width of the confidence intervals of 95 %, shape (P,)."""

    def scaled(self, factor: float) -> Uncertainty:
        """Return the uncertainty with all errors multiplied by a factor."""
        return Uncertainty(self.covariance * factor**2, self.half_width * factor)

    def widened(self, shifts: FloatArray) -> Uncertainty:
        """Return the uncertainty with further, independent errors of the estimates.

        Each of the K columns of `shifts`, shape (P, K), is a standard error that changes all estimates together, with
        an unknown sign.
        """
        more = shifts @ shifts.T
        old = np.diag(self.covariance)
        growth = np.sqrt(np.divide(np.diag(more), old, out=np.zeros_like(old), where=old > 0.0) + 1.0)
        return Uncertainty(self.covariance + more, self.half_width * growth)

    @property
    def standard_error(self) -> FloatArray:
        """Standard error of each estimate, shape (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


@dataclass(frozen=True)
class Group:
    """C channels that were measured at the same T instants, or C combinations of such channels."""

    residuals: FloatArray
    """Shape (C, T)."""
    slopes: FloatArray
    """Shape (C, T, P)."""
    squared_weights: FloatArray
    """Shape (C,)."""
    spectra: FloatArray
    """Fourier transforms of W J, from `scenes.studies.fit.noise.spectra_of`."""
    size: int
    """Number of points of the transforms."""

    def score(self, series: FloatArray) -> FloatArray:
        """Return J' W e, shape (P,), for a series e of shape (C, T)."""
        return np.asarray(np.einsum("c,ctp,ct->p", self.squared_weights, self.slopes, series))


def uncertainty_of(
    residuals: FloatArray, slopes: FloatArray, weights: FloatArray, inverse: FloatArray, draws: int = UNCERTAINTY_DRAWS
) -> Uncertainty:
    """Return the uncertainty of the estimates of a fit with the given residuals.

    Parameters
    ----------
    residuals : ndarray, shape (C, T)
        Residuals of C channels; NaN where nothing was measured.
    slopes : ndarray, shape (C, T, P)
        Derivatives of the model.
    weights : ndarray, shape (C,)
        Weights of the channels in the fit.
    inverse : ndarray, shape (P, P)
        A^-1, or a generalised inverse if A is singular.
    draws : int
        Number of random series. With 0, (F2) is not corrected, and the intervals use the normal distribution.
    """
    groups = list(groups_of(residuals, slopes, weights, inverse))
    models = [noise_of(group.residuals) for group in groups]
    found = _covariance(groups, models, inverse)
    if not draws:
        return Uncertainty(found, special.ndtri(0.975) * np.sqrt(np.diag(found)))
    draws = min(draws, max(LEAST_DRAWS, MOST_SERIES // sum(len(group.residuals) for group in groups)))
    drawn = _drawn(groups, models, inverse, draws, np.random.default_rng(0))
    mean, scatter = drawn.mean(axis=0), drawn.var(axis=0)
    variance = np.diag(found)
    bias = np.sqrt(np.divide(variance, mean, out=np.ones_like(mean), where=mean > 0.0))
    degrees = 2.0 * mean**2 / np.maximum(scatter, np.finfo(float).tiny)
    half_width = special.stdtrit(np.maximum(degrees, 1.0), 0.975) * np.sqrt(variance) * bias
    return Uncertainty(found * np.outer(bias, bias), half_width)


def groups_of(residuals: FloatArray, slopes: FloatArray, weights: FloatArray, inverse: FloatArray) -> Iterator[Group]:
    """Yield groups of channels that were measured at the same instants; parameters as in `uncertainty_of`."""
    known: BoolArray = np.isfinite(residuals)
    for rows in np.unique(known, axis=0):
        members = np.flatnonzero((known == rows).all(axis=1))
        left, own, squared = residuals[members][:, rows], slopes[members][:, rows], weights[members] ** 2
        if len(members) > MOST_CHANNELS:
            patterns = weights[members, None] * _patterns(weights[members, None, None] * own @ inverse)
            left, own, squared = patterns.T @ left, np.tensordot(patterns.T, own, 1), np.ones(patterns.shape[1])
        spectra, size = spectra_of(squared[:, None, None] * own)
        yield Group(left, own, squared, spectra, size)


def _patterns(estimators: FloatArray) -> FloatArray:
    """Return the combinations of channels that contribute most to the estimates.

    The noise affects the estimates almost only through these combinations.

    Parameters
    ----------
    estimators : ndarray, shape (C, T, P)
        J A^-1 with weighted slopes J: the derivatives of the estimates with respect to the weighted measured values.

    Returns
    -------
    ndarray, shape (C, MOST_CHANNELS)
        An orthonormal combination in each column.
    """
    size = np.sqrt((estimators**2).sum(axis=(0, 1)))
    rows = (estimators / np.where(size > 0.0, size, 1.0)).reshape(len(estimators), -1)
    _, patterns = linalg.eigh(rows @ rows.T, subset_by_index=(len(rows) - MOST_CHANNELS, len(rows) - 1))
    return np.asarray(patterns)


def _covariance(groups: Sequence[Group], models: Sequence[Noise], inverse: FloatArray) -> FloatArray:
    """Return (F2), shape (P, P)."""
    inner = sum(model.score_covariance(g.spectra, g.size) for g, model in zip(groups, models, strict=True))
    return np.asarray(inverse @ inner @ inverse)


def _drawn(
    groups: Sequence[Group], models: Sequence[Noise], inverse: FloatArray, draws: int, random: np.random.Generator
) -> FloatArray:
    """Return the variances of the estimates by (F2) for fits to random series, shape (draws, P)."""
    variances = []
    for _ in range(draws):
        series = [model.draw(g.residuals.shape[1], random) for g, model in zip(groups, models, strict=True)]
        off = inverse @ sum(group.score(each) for group, each in zip(groups, series, strict=True))
        left = [each - group.slopes @ off for group, each in zip(groups, series, strict=True)]
        again = [noise_of(each, model.order) for each, model in zip(left, models, strict=True)]
        variances.append(np.diag(_covariance(groups, again, inverse)))
    return np.array(variances)
