"""Design of a sweep: which keys of a scene are varied, over which values, and so which cases there are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

CASE, SAMPLE = "case", "sample"
"""Dimension of values that are drawn or listed: the only one of a sweep, and the one beside those of a grid."""


@dataclass(frozen=True)
class Varied:
    """A key of the scene that is varied."""

    key: str
    """Dotted name, such as `gait.period_s`."""
    dim: str
    """Dimension along which it varies: its own name in a grid, else `case` or `sample`, which others share."""
    values: tuple[Any, ...]
    """Value at each place of the dimension, as TOML has them: numbers, texts, truth values, lists, tables."""
    unit: str = ""
    """Unit of the values, "1" for a pure number; empty where they are no numbers."""
    title: str = ""
    """What it is, in a few words."""


@dataclass(frozen=True)
class Design:
    """Keys that are varied; its cases are all combinations of the places along its dimensions."""

    scene: str
    """Name of the scene."""
    varied: tuple[Varied, ...]

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each dimension, in order; the last one varies fastest from case to case."""
        return {each.dim: len(each.values) for each in self.varied}

    def __len__(self) -> int:
        """Return the number of cases."""
        return math.prod(self.sizes.values())

    def cases(self) -> Iterator[dict[str, Any]]:
        """Yield the values of each case by key, in the order of its dimensions."""
        sizes = self.sizes
        for places in itertools.product(*map(range, sizes.values())):
            at = dict(zip(sizes, places, strict=True))
            yield {each.key: each.values[at[each.dim]] for each in self.varied}


def told(values: Mapping[str, Any]) -> str:
    """Return the values of a case as a person reads them: `gait.period_s = 3, worm.segments = 5`."""
    from scenes.language.toml import shown

    return ", ".join(f"{key} = {value if isinstance(value, str) else shown(value)}" for key, value in values.items())
