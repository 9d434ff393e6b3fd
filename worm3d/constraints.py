"""Which coordinates of a worm stay fixed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.values.arrays import BoolArray


@dataclass(frozen=True, eq=False)
class Held:
    """Coordinates that stay as they are at the start.

    Attributes
    ----------
    joints : array_like of bool, shape (N+1, 3) or broadcastable to it
        x, y, z of each joint.
    roll : array_like of bool, shape (N,) or one for all
        The director of a segment is carried along without turning about the segment.
    bend : array_like of bool, shape (N,) or one for all
        Chamber bend of a segment.
    """

    joints: ArrayLike = False
    roll: ArrayLike = False
    bend: ArrayLike = False

    def mask(self, segments: int) -> BoolArray:
        """Return which of the 5 (N+1) coordinates are held; the last block has no roll and bend.

        Raises
        ------
        ValueError
            An array that is not of bool, or of the wrong shape.
        """
        mask = np.ones((segments + 1, 5), dtype=bool)
        parts = (("joints", mask[:, :3]), ("roll", mask[:-1, 3]), ("bend", mask[:-1, 4]))
        for name, part in parts:
            value = _as_given(name, getattr(self, name))
            if value.dtype != bool:
                raise ValueError(
                    f"held.{name}: got {value.dtype} values, must be True or False for each, not the numbers of those "
                    "that are held"
                )
            try:
                part[:] = value
            except ValueError:
                raise ValueError(
                    f"held.{name}: got shape {value.shape}, must be {part.shape} (or one for all)"
                ) from None
        return mask.ravel()


def _as_given(name: str, value: ArrayLike) -> NDArray[Any]:
    try:
        return np.array(value)
    except Exception as error:  # lists of unequal length
        raise ValueError(f"held.{name}: got {type(value).__name__}, must be True or False for each") from error


def held_mask(held: Held | ArrayLike | None, segments: int, *, flat: bool, clamped: bool) -> BoolArray:
    """Return which of the 5 (N+1) coordinates are held, those included that the model holds.

    Parameters
    ----------
    held : Held, array_like of bool with shape (N+1, 3), or None
        What the user holds.
    flat : bool
        Whether the worm stays in its plane: y, roll and bend.
    clamped : bool
        Whether the joints' z are held (`worm3d.ClampedGround`).
    """
    given = held if isinstance(held, Held) else Held() if held is None else Held(joints=held)
    mask = given.mask(segments).reshape(segments + 1, 5)
    if flat:
        mask[:, [1, 3, 4]] = True
    if clamped:
        mask[:, 2] = True
    return mask.ravel()
