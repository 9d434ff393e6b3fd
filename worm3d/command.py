"""What a worm can be commanded to do at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly


@dataclass(frozen=True, init=False, eq=False)
class Command(ReadOnly):
    """Command to a worm of N segments; frozen, with read-only arrays.

    Attributes
    ----------
    contraction : ndarray, shape (N, 2)
        Shortening fraction of each chamber [left, right]: the commanded rest length is l0 (1 - contraction).
        Negative values lengthen.
    hinge : ndarray, shape (N - 1,)
        Hinge angle of joints 1 ... N-1 [rad]; positive yaws the headward segment to the left.
    force : ndarray, shape (N, 2)
        Extra force of each chamber [left, right] along it [N]; positive contracts.

    Raises
    ------
    ValueError
        An array of the wrong shape, a value that is not finite, or a contraction of 1 or more.
    """

    contraction: FloatArray
    hinge: FloatArray
    force: FloatArray

    def __init__(self, contraction: ArrayLike, hinge: ArrayLike = 0.0, force: ArrayLike = 0.0) -> None:
        c = arguments.floats("contraction", contraction)
        if (c >= 1.0).any():
            raise ValueError(f"contraction: got {c.max()}, must be below 1: a chamber cannot shorten to nothing")
        if c.ndim != 2 or c.shape[0] < 1 or c.shape[1] != 2:
            raise ValueError(
                f"contraction: got shape {c.shape}, must be (N, 2): a row per segment, columns left and right"
            )
        object.__setattr__(self, "contraction", _filled("contraction", c, c.shape))
        object.__setattr__(self, "hinge", _filled("hinge", hinge, (len(c) - 1,)))
        object.__setattr__(self, "force", _filled("force", force, c.shape))

    @property
    def segments(self) -> int:
        """Number of segments N."""
        return len(self.contraction)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Command):
            return NotImplemented
        return all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in ("contraction", "hinge", "force")
        )

    __hash__ = None  # type: ignore[assignment]


class Commands(NamedTuple):
    """Commands at K instants, not checked yet; what `Command` holds, each with K in front."""

    contraction: FloatArray
    """Shape (K, N, 2)."""
    hinge: FloatArray
    """Shape (K, N - 1) [rad]."""
    force: FloatArray
    """Shape (K, N, 2) [N]."""


def _filled(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return `value` as a read-only array of `shape`; a scalar fills it."""
    return arguments.array(name, value, shape, fill=True)
