"""One row of the validation report: the value of the model beside the published one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

TRUST = {
    "R": "read in the source itself",
    "R2": "read in another text that quotes the source",
    "C": "derived or computed in this project",
    "rec": "recalled from general knowledge, not checked",
}
"""How far a published number can be trusted, by its tag, best first."""

KINDS = {
    "robot": "measured on a robot",
    "animal": "measured on animals",
    "other model": "found by another simulation or analysis, not measured",
    "closed form": "an exact solution of the equations",
    "pattern generator": "what its authors' equations or formulas give",
}
"""What a row is compared with, by kind."""

STANDINGS = {
    "prediction": "the model was not told the number",
    "verification": "shows that equations are solved right, nothing about robots or animals",
    "fitted": "the scene was fitted to the number; does not count",
    "input": "the number follows from one that the scene was given; does not count",
}
"""What agreement means, by standing."""

COUNTED = ("prediction", "verification")
"""Standings of the rows that count."""

AGREES, DEPENDS, MISSES = "agrees", "depends", "misses"
"""Words for a row: in its band whatever is not published; in its band for the scene's values alone; not in its band."""


@dataclass(frozen=True)
class Row:
    """A number of the model beside the published one.

    Parameters
    ----------
    name : str
        What is compared, in a few words; unique in the report.
    model : float
        What the model gives; NaN where it gives nothing (the note says why).
    published : float or None
        What was published; None where only a band or the sign of a trend is known.
    tolerance : float or (float, float)
        Largest relative error (absolute where `published` is 0), or the band (lowest, highest) that the model must
        lie in, in `unit`. Both ends belong to the band.
    source : str
        Where the published number is from.
    note : str
        What the reader must know: which numbers of the scene are assumed, or why the model misses.
    trust : str
        A key of `TRUST`.
    unit : str
        Unit of `model` and `published`.
    scene : str
        Scene that was run, or scenes.
    kind : str
        A key of `KINDS`.
    standing : str
        A key of `STANDINGS`.
    spread : (float, float), optional
        Least and greatest number that the model gives over what the source does not tell; `model` is for the values
        that the scene has.
    sign_agrees : bool, optional
        Of a trend, whether the model has its sign, over the whole spread.
    """

    name: str
    model: float
    published: float | None
    tolerance: float | tuple[float, float]
    source: str
    note: str = ""
    trust: str = "C"
    unit: str = "1"
    scene: str = ""
    kind: str = "closed form"
    standing: str = "verification"
    spread: tuple[float, float] | None = None
    sign_agrees: bool | None = None

    def __post_init__(self) -> None:
        assert self.trust in TRUST, self.trust
        assert self.kind in KINDS, self.kind
        assert self.standing in STANDINGS, self.standing
        assert self.published is not None or isinstance(self.tolerance, tuple), self.name

    @property
    def band(self) -> tuple[float, float]:
        """The lowest and the highest number with which the model agrees, in `unit`."""
        if isinstance(self.tolerance, tuple):
            return self.tolerance
        assert self.published is not None
        reach = self.tolerance * (abs(self.published) or 1.0)
        return self.published - reach, self.published + reach

    @property
    def ok(self) -> bool:
        """Whether the model lies in the band; False where it gives nothing."""
        low, high = self.band
        return low <= self.model <= high

    @property
    def agreement(self) -> str:
        """AGREES, DEPENDS or MISSES."""
        low, high = self.band
        ends = self.spread or (self.model, self.model)
        if not self.ok:
            return MISSES
        return AGREES if low <= min(ends) and max(ends) <= high and self.sign_agrees is not False else DEPENDS

    @property
    def counts(self) -> bool:
        """Whether agreement says anything, by the standing."""
        return self.standing in COUNTED

    @property
    def ratio(self) -> float | None:
        """Model over published; None where there is no such number."""
        if not self.published or not math.isfinite(self.model):
            return None
        return self.model / self.published

    def to_dict(self) -> dict[str, Any]:
        """Return the row of `validate.json`: no NaN and no infinity, None instead."""
        low, high = (end if math.isfinite(end) else None for end in self.band)
        return {
            "name": self.name,
            "model": self.model if math.isfinite(self.model) else None,
            "published": self.published,
            "ratio": self.ratio,
            "ok": self.ok,
            "agreement": self.agreement,
            "kind": self.kind,
            "standing": self.standing,
            "counts": self.counts,
            "low": low,
            "high": high,
            "unit": self.unit,
            "spread": self.spread,
            "sign_agrees": self.sign_agrees,
            "source": self.source,
            "trust": self.trust,
            "scene": self.scene,
            "note": self.note,
        }


Chapter = Callable[[bool], Iterator[Row]]
"""Part of the report: runs its scenes and yields its rows, each as soon as it is known. With `quick`, its argument, it
leaves out what takes more than a few seconds. A run that fails gives a row with model NaN, and its note says why."""
