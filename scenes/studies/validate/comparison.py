"""A measure beside the published number, with variants for quantities that the source does not give."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from scenes.studies.validate.measures import Changes, Figure, Measure, StoppedError
from scenes.studies.validate.rows import Chapter, Row

ABOVE_1, BELOW_1 = (1.0, math.inf), (-math.inf, 1.0)
"""Bands of trends with only a published sign."""

NO_TREND = 0.05
"""Largest distance of a ratio from 1 that is no trend, 1.

Curves of studies use the same limit: they are flat if they change by less. With half this limit no row changes; with
twice this limit the stiff mesh robot's ratio, 1.09, would be no trend.
"""


def friction(mu: float) -> Changes:
    """Return the changes of a scene that make the friction the same in all directions."""
    return tuple(f"friction.{way}={mu}" for way in ("forward", "backward", "lateral"))


def within(factor: float, published: float) -> tuple[float, float]:
    """Return the band from the published number over a factor to the published number times the factor."""
    return published / factor, published * factor


def speed(scene: str, *changes: str) -> Figure:
    """Return the speed of a scene with changes [m/s]."""
    return Figure("speed_m_s", scene, changes)


def pipe(radius: float, *changes: str) -> Changes:
    """Return the changes of a scene that put the worm into a pipe, plus further changes; the radius is in m."""
    return ("world.kind=pipe", f"world.radius_m={radius}", *changes)


class Source(NamedTuple):
    """Source of published numbers; the fields are defined in `Row`."""

    text: str
    trust: str
    kind: str


@dataclass(frozen=True)
class Comparison:
    """A measure beside the published number; fields that `Row` has, too, are defined there."""

    name: str
    measure: Measure
    published: float | None
    band: tuple[float, float]
    source: Source
    note: str
    standing: str = "prediction"
    unit: str = "1"
    unknown: Sequence[Changes] = ()
    """Changes of the scene to other values of quantities that the source does not give."""
    others: Sequence[Measure] = ()
    """Variants of the measure with other such values, where the values belong to only some of the runs."""
    trend: bool = False
    """Whether only the sign matters: the number is a ratio above or below 1, or only a band was published."""

    def row(self, *, quick: bool) -> Row:
        """Return the row; with `quick` without the spread."""
        note, model, others = self.note, math.nan, []
        try:
            model = self.measure()
            others = [] if quick else [*(_found(self.measure, c) for c in self.unknown), *map(_found, self.others)]
        except StoppedError as error:
            note = f"the model gives nothing: {error}. {note}"
        found = [other for other in others if other is not None]
        if len(found) < len(others):
            note += f" With {len(others) - len(found)} of {len(others)} other values the run does not come to its end."
        return Row(
            name=self.name,
            model=model,
            published=self.published,
            tolerance=self.band,
            source=self.source.text,
            note=note,
            trust=self.source.trust,
            unit=self.unit,
            scene=self.measure.scene,
            kind=self.source.kind,
            standing=self.standing,
            spread=(min(model, *found), max(model, *found)) if found else None,
            sign_agrees=all(map(self._has_sign, (model, *found))) if self.trend and not math.isnan(model) else None,
        )

    def _has_sign(self, value: float) -> bool:
        """Return whether a number has the trend's sign: a ratio clearly above or below 1, or a value in the band."""
        if self.published is None and self.unit != "1":
            return self.band[0] <= value <= self.band[1]
        above = self.band[0] >= 1.0 if self.published is None else self.published > 1.0
        return value > 1.0 + NO_TREND if above else 0.0 < value < 1.0 - NO_TREND


def _found(measure: Measure, changes: Changes = ()) -> float | None:
    """Return the number of a measure, None if a run does not finish."""
    try:
        return measure(changes)
    except StoppedError:
        return None


def chapter(comparisons: Sequence[Comparison]) -> Chapter:
    """Return the chapter of some comparisons; a quick chapter has no spreads."""
    return lambda quick: (comparison.row(quick=quick) for comparison in comparisons)
