"""Comparison of a number from the model with a published number.

The source of the published number may not give all quantities that a scene needs. Runs with other values of these
quantities show the spread of the model's number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from scenes.studies.validate.measures import Changes, Figure, Measure, StoppedError
from scenes.studies.validate.rows import Chapter, Row

ABOVE_1, BELOW_1 = (1.0, math.inf), (-math.inf, 1.0)
"""Bands of ratios that the source gives only as above 1 or below 1."""

NO_TREND = 0.05
"""A ratio that differs from 1 by at most this value does not show a trend.

`scenes.studies.study.curves` uses the same limit for flat curves. With 0.025, the report is the same. With 0.1, the
ratio 1.09 of the stiff mesh robot would not count as a trend.
"""


def friction(mu: float) -> Changes:
    """Return the changes of a scene for friction with the coefficient `mu` in all directions."""
    return tuple(f"friction.{way}={mu}" for way in ("forward", "backward", "lateral"))


def within(factor: float, published: float) -> tuple[float, float]:
    """Return the band from published/factor to published*factor."""
    return published / factor, published * factor


def speed(scene: str, *changes: str) -> Figure:
    """Return a measure: the speed of a scene with changes [m/s]."""
    return Figure("speed_m_s", scene, changes)


def pipe(radius: float, *changes: str) -> Changes:
    """Return the changes of a scene that put the worm into a pipe with a radius in m, and further changes."""
    return ("world.kind=pipe", f"world.radius_m={radius}", *changes)


class Source(NamedTuple):
    """Source of a published number. The fields are the fields `source`, `trust` and `kind` of `rows.Row`."""

    text: str
    trust: str
    kind: str


@dataclass(frozen=True)
class Comparison:
    """A measure of the model and the published number. `rows.Row` describes the fields without a description here."""

    name: str
    measure: Measure
    published: float | None
    band: tuple[float, float]
    source: Source
    note: str
    standing: str = "prediction"
    unit: str = "1"
    unknown: Sequence[Changes] = ()
    """Changes of the scene. Each change sets other values of quantities that the source does not give."""
    others: Sequence[Measure] = ()
    """Further measures with other values of such quantities, if these values apply to only some runs of a measure."""
    trend: bool = False
    """Whether the report also says if the sign agrees: whether a ratio is on the same side of 1 as the published ratio,
    or, if no number was published, whether the number lies in the band."""

    def row(self, *, quick: bool) -> Row:
        """Run the scenes and return the row of the report. With `quick`, the spread is left out."""
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
        """Return whether a number shows the published trend.

        A ratio must differ from 1 by more than `NO_TREND`, in the published direction. A value with a unit but without
        a published number must lie in the band.
        """
        if self.published is None and self.unit != "1":
            return self.band[0] <= value <= self.band[1]
        above = self.band[0] >= 1.0 if self.published is None else self.published > 1.0
        return value > 1.0 + NO_TREND if above else 0.0 < value < 1.0 - NO_TREND


def _found(measure: Measure, changes: Changes = ()) -> float | None:
    """Return the number of a measure with some changes, or None if a run does not finish."""
    try:
        return measure(changes)
    except StoppedError:
        return None


def chapter(comparisons: Sequence[Comparison]) -> Chapter:
    """Return the chapter (`rows.Chapter`) with some comparisons."""
    return lambda quick: (comparison.row(quick=quick) for comparison in comparisons)
