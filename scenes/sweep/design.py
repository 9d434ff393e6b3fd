"""Design of a sweep: the varied keys of a scene, their values, and the resulting cases."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

CASE, SAMPLE = "case", "sample"
"""Names of the dimension of random or listed cases: `case` if it is the only dimension, `sample` beside a grid."""


@dataclass(frozen=True)
class Varied:
    """A varied key of the scene."""

    key: str
    """Dotted name, such as `gait.period_s`."""
    dim: str
    """Dimension along which the key varies. In a grid, the dimension has the name of the key. Otherwise the
    dimension is `case` or `sample`, and several keys may share it."""
    values: tuple[Any, ...]
    """Values along the dimension, of any type that TOML has: numbers, texts, truth values, lists, or tables."""
    unit: str = ""
    """Unit of the values, "1" for dimensionless numbers; empty if the values are not numbers."""
    title: str = ""
    """Short description of the key."""


@dataclass(frozen=True)
class Design:
    """Varied keys and their values. The cases are all combinations of positions along the dimensions."""

    scene: str
    """Name of the scene."""
    varied: tuple[Varied, ...]

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each dimension, in the order of the dimensions; the last dimension varies fastest."""
        return {each.dim: len(each.values) for each in self.varied}

    def __len__(self) -> int:
        """Return the number of cases."""
        return math.prod(self.sizes.values())

    def cases(self) -> Iterator[dict[str, Any]]:
        """Yield the values of each case by key, in the order of the dimensions."""
        sizes = self.sizes
        for places in itertools.product(*map(range, sizes.values())):
            at = dict(zip(sizes, places, strict=True))
            yield {each.key: each.values[at[each.dim]] for each in self.varied}


def told(values: Mapping[str, Any]) -> str:
    """Return the values of a case as text for users, such as `gait.period_s = 3, worm.segments = 5`."""
    from scenes.language.toml import shown

    return ", ".join(f"{key} = {value if isinstance(value, str) else shown(value)}" for key, value in values.items())
