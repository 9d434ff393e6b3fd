"""Identifiability: which keys a measurement determines, and which keys it cannot distinguish.

The analysis uses the singular values of the matrix of slopes, the derivatives of the M measured values with respect to
the P varied keys. The rows are weighted so that residuals have a size of about 1, and each key is measured in units of
its scale. The columns are then scaled to length 1. A singular value is the length of the effect of a combined change of
the keys, compared with the effects of the single changes. A small singular value means that the effects of the single
changes cancel (R. Brun, P. Reichert, H. R. Kuensch, Water Resources Research 37, 2001).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.studies.fit.varied import Varied
from worm3d.values.arrays import BoolArray, FloatArray

MIN_SINGULAR_VALUE = 1e-3
"""Smallest singular value, for columns of length 1, of a direction that the data determine. The error of the slopes is
about a tenth of this value."""
NEGLIGIBLE_EFFECT = 1e-6
"""Smallest effect of a change of a key by its scale that is not neglected: the root mean square change of the
simulation relative to the rms of the residuals."""
INVOLVED = 0.1
"""Smallest component of a key that is reported as part of a direction of length 1."""
VAGUE = 0.3
"""Largest standard error along a direction that counts as determined, in units of the keys' scales."""

Probe = Callable[[FloatArray], FloatArray]
"""Function from a direction in the space of the keys, shape (P,), to the weighted slope along it, shape (M,)."""


@dataclass(frozen=True)
class Relation:
    """Simultaneous changes of several keys, or a change of one key, that hardly affect the residuals."""

    keys: tuple[str, ...]
    changes: tuple[float, ...]
    """Change of each key in its unit."""
    effect_over_residual_rms: float
    """Root mean square change of the simulation when all these changes are made together, as a fraction of the root
    mean square of the residuals."""

    @property
    def sentence(self) -> str:
        """A sentence that describes the relation to the user."""
        moves = " and ".join(f"{key} by {change:+.3g}" for key, change in zip(self.keys, self.changes, strict=True))
        what = f"cannot tell apart {', '.join(self.keys)}" if len(self.keys) > 1 else f"say little about {self.keys[0]}"
        effect = f"{self.effect_over_residual_rms:.2g} of the residuals' rms"
        return f"the data {what}: to change {moves} moves the simulation by {effect}"


@dataclass(frozen=True)
class Determined:
    """Result of the analysis of the slopes."""

    inverse: FloatArray
    """Generalised inverse of the matrix of the normal equations, without the undetermined directions, shape (P, P).
    Keys are in units of their scales."""
    known: BoolArray
    """Whether a key is part of no undetermined direction, shape (P,)."""
    relations: tuple[Relation, ...]
    """The directions that the data do not determine."""


def axes_of(slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the lengths of the columns of the slopes, and the singular values and directions of the scaled columns.

    A negligible column is replaced by zeros, and its returned length is 1.

    Parameters
    ----------
    slopes : ndarray, shape (M, P)

    Returns
    -------
    lengths : ndarray, shape (P,)
    singular : ndarray, shape (P,)
    directions : ndarray, shape (P, P)
        A direction in each row.
    """
    norms = np.linalg.norm(slopes, axis=0)
    counts = norms > NEGLIGIBLE_EFFECT * np.sqrt(len(slopes))
    lengths = np.where(counts, norms, 1.0)
    _, singular, directions = np.linalg.svd(np.where(counts, slopes / lengths, 0.0), full_matrices=False)
    return lengths, singular, directions


def determined(varied: Sequence[Varied], slopes: FloatArray, roughness: FloatArray, probe: Probe) -> Determined:
    """Return which keys and directions the slopes determine.

    A direction is undetermined if its singular value is below `MIN_SINGULAR_VALUE`. It is also undetermined if its
    singular value is below the error of the slopes, and the slope found by a tiny step along the direction is below
    `MIN_SINGULAR_VALUE`.

    Parameters
    ----------
    varied : sequence of Varied
    slopes, roughness : ndarray, shape (M, P)
        Slopes and their roughness (see `scenes.studies.fit.slopes`), weighted, with keys in units of their scales.
    probe : callable
        Returns the weighted slope along a direction, shape (M,), which is found by a tiny step.
    """
    lengths, singular, directions = axes_of(slopes)
    errors = np.linalg.norm(directions * (np.linalg.norm(roughness, axis=0) / lengths), axis=1)
    lost = singular < MIN_SINGULAR_VALUE
    for k in np.flatnonzero(~lost & (singular < errors)):
        lost[k] = float(np.linalg.norm(probe(directions[k] / lengths))) < MIN_SINGULAR_VALUE
    kept = directions[~lost] / singular[~lost, None] / lengths
    involved = np.abs(directions) > INVOLVED
    relations = tuple(
        relation(varied, np.where(involved[k], directions[k] / lengths, 0.0), slopes) for k in np.flatnonzero(lost)
    )
    known: BoolArray = np.logical_not(involved[lost].any(axis=0))
    return Determined(kept.T @ kept, known, relations)


def vague(varied: Sequence[Varied], covariance: FloatArray, slopes: FloatArray) -> Iterator[Relation]:
    """Yield the directions along which the standard error is above `VAGUE`.

    Parameters
    ----------
    varied : sequence of Varied
    covariance : ndarray, shape (P, P)
        Covariance of the keys in units of their scales.
    slopes : ndarray, shape (M, P)
    """
    variances, directions = np.linalg.eigh(covariance)
    for variance, direction in zip(variances, directions.T, strict=True):
        if variance > VAGUE**2:
            yield relation(varied, np.where(np.abs(direction) > INVOLVED, direction, 0.0), slopes)


def relation(varied: Sequence[Varied], direction: FloatArray, slopes: FloatArray) -> Relation:
    """Return a direction, shape (P,), as changes of the keys. The largest change is a tenth of the key's scale.

    Keys that do not change are left out.
    """
    largest = int(np.argmax(np.abs(direction)))
    move = direction * (0.1 / direction[largest])
    named = [int(k) for k in np.flatnonzero(move)]
    return Relation(
        tuple(varied[k].key for k in named),
        tuple(float(move[k] * varied[k].scale) for k in named),
        float(np.sqrt(np.mean((slopes @ move) ** 2))),
    )
