"""Which keys a measurement determines, and which keys are indistinguishable: the singular values of the slopes.

The slopes are weighted, so that a residual has a size of about 1, and each key is counted in units of its scale. The
columns are scaled to length 1. A singular value is then the fraction of the effect of several keys that remains when
the keys change together so that they cancel each other best (R. Brun, P. Reichert, H. R. Kuensch, Water Resources
Research 37, 2001).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.studies.fit.varied import Varied
from worm3d.values.arrays import BoolArray, FloatArray

MIN_SINGULAR_VALUE = 1e-3
"""Singular value of columns of length 1 below which keys cancel each other; the error of slopes is a tenth of this."""
NEGLIGIBLE_EFFECT = 1e-6
"""Largest negligible effect of a change by a key's scale: root mean square, relative to the rms of the residuals."""
INVOLVED = 0.1
"""Least component of a key in a direction of length 1 for the key to be named."""
VAGUE = 0.3
"""Least standard error of a direction, in scales of the keys, that counts as not determined by the data."""

Probe = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Relation:
    """Simultaneous changes of keys that hardly affect the residuals."""

    keys: tuple[str, ...]
    changes: tuple[float, ...]
    """Change of each key in its unit; all changes together have the effect."""
    effect_over_residual_rms: float
    """Root mean square change of the simulation, as a fraction of the root mean square of the residuals."""

    @property
    def sentence(self) -> str:
        """Meaning of the relation, for people."""
        moves = " and ".join(f"{key} by {change:+.3g}" for key, change in zip(self.keys, self.changes, strict=True))
        what = f"cannot tell apart {', '.join(self.keys)}" if len(self.keys) > 1 else f"say little about {self.keys[0]}"
        effect = f"{self.effect_over_residual_rms:.2g} of the residuals' rms"
        return f"the data {what}: to change {moves} moves the simulation by {effect}"


@dataclass(frozen=True)
class Determined:
    """Result of the analysis of the slopes."""

    inverse: FloatArray
    """Inverse of the normal equations in scales of the keys, without the undetermined directions, shape (P, P)."""
    known: BoolArray
    """Keys that are in none of the directions that the data leave undetermined, shape (P,)."""
    relations: tuple[Relation, ...]
    """The directions that the data leave undetermined."""


def axes_of(slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the lengths of the columns of slopes, (M, P), and singular values and directions of columns of length 1.

    Shapes (P,), (P,) and (P, P), a direction in each row. A negligible column is replaced by zeros and has a length
    of 1.
    """
    norms = np.linalg.norm(slopes, axis=0)
    counts = norms > NEGLIGIBLE_EFFECT * np.sqrt(len(slopes))
    lengths = np.where(counts, norms, 1.0)
    _, singular, directions = np.linalg.svd(np.where(counts, slopes / lengths, 0.0), full_matrices=False)
    return lengths, singular, directions


def determined(varied: Sequence[Varied], slopes: FloatArray, roughness: FloatArray, probe: Probe) -> Determined:
    """Return the keys and directions that slopes determine, by their singular values.

    A direction is lost if its singular value is below `MIN_SINGULAR_VALUE`. A direction is also lost if its singular
    value is below the error of the slopes and a tiny step along the direction has no effect either.

    Parameters
    ----------
    varied : sequence of Varied
    slopes, roughness : ndarray, shape (M, P)
        Weighted, in scales of the keys.
    probe : callable
        Returns the weighted slope along a direction, shape (M,), by a tiny step.
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
    """Yield the directions with a large error, given the covariance of the keys in their scales, shape (P, P)."""
    variances, directions = np.linalg.eigh(covariance)
    for variance, direction in zip(variances, directions.T, strict=True):
        if variance > VAGUE**2:
            yield relation(varied, np.where(np.abs(direction) > INVOLVED, direction, 0.0), slopes)


def relation(varied: Sequence[Varied], direction: FloatArray, slopes: FloatArray) -> Relation:
    """Return a direction, shape (P,) in scales of the keys, as example changes up to a tenth of a key's scale.

    Changes of 0 are left out.
    """
    largest = int(np.argmax(np.abs(direction)))
    move = direction * (0.1 / direction[largest])
    named = [int(k) for k in np.flatnonzero(move)]
    return Relation(
        tuple(varied[k].key for k in named),
        tuple(float(move[k] * varied[k].scale) for k in named),
        float(np.sqrt(np.mean((slopes @ move) ** 2))),
    )
