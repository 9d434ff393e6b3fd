"""One row of the validation report: the number of the model beside the published number."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from scenes.records.text import finite

TRUST = {
    "R": "read in the source itself",
    "R2": "read in another text that quotes the source",
    "C": "derived or computed in this project",
    "rec": "recalled from general knowledge, not checked",
}
"""Trustworthiness of a published number, by tag, best first."""

EVIDENCE_KINDS = {
    "robot": "measured on a robot",
    "animal": "measured on animals",
    "other model": "found by another simulation or analysis, not measured",
    "closed form": "an exact solution of the equations",
    "pattern generator": "what its authors' equations or formulas give",
}
"""Reference of the comparison in a row, by kind."""

STANDINGS = {
    "prediction": "the model was not told the number",
    "verification": "shows that equations are solved right, nothing about robots or animals",
    "fitted": "the scene was fitted to the number; does not count",
    "input": "the number follows from one that the scene was given; does not count",
}
"""Meaning of agreement, by standing."""

COUNTED = ("prediction", "verification")
"""Standings of the rows that count."""

AGREES, DEPENDS, MISSES = "agrees", "depends", "misses"
"""Words for a row: in its band for all unpublished values; in its band only for the scene's values; not in its band."""


@dataclass(frozen=True)
class Row:
    """A number of the model beside the published number.

    Parameters
    ----------
    name : str
        Quantity of the comparison, in a few words; unique in the report.
    model : float
        Number of the model; NaN if the model gives no number (the note gives the reason).
    published : float or None
        Published number; None if only a band or the sign of a trend is known.
    tolerance : float or (float, float)
        Largest relative error (absolute where `published` is 0), or the band (lowest, highest) for the model, in
        `unit`. Both ends belong to the band.
    source : str
        Source of the published number.
    note : str
        Information for the reader: the assumed numbers of the scene, or the reason why the model misses.
    trust : str
        A key of `TRUST`.
    unit : str
        Unit of `model` and `published`.
    scene : str
        Scene or scenes of the run.
    kind : str
        A key of `EVIDENCE_KINDS`.
    standing : str
        A key of `STANDINGS`.
    spread : (float, float), optional
        Least and greatest number of the model over values that the source does not give; `model` is for the values in
        the scene.
    sign_agrees : bool, optional
        Whether the model has the sign of a trend, over the whole spread.
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
        assert self.kind in EVIDENCE_KINDS, self.kind
        assert self.standing in STANDINGS, self.standing
        assert self.published is not None or isinstance(self.tolerance, tuple), self.name

    @property
    def band(self) -> tuple[float, float]:
        """The lowest and the highest number of the model that agree, in `unit`."""
        if isinstance(self.tolerance, tuple):
            return self.tolerance
        assert self.published is not None
        reach = self.tolerance * (abs(self.published) or 1.0)
        return self.published - reach, self.published + reach

    @property
    def ok(self) -> bool:
        """Whether the model lies in the band; False if the model gives no number."""
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
        """Whether agreement is meaningful, by the standing."""
        return self.standing in COUNTED

    @property
    def ratio(self) -> float | None:
        """Model over published number; None if one of them is missing."""
        if not self.published or not math.isfinite(self.model):
            return None
        return self.model / self.published

    @property
    def mark(self) -> str:
        """The agreement; the standing of a row that does not count."""
        return self.agreement if self.counts else self.standing

    @property
    def ratio_text(self) -> str:
        """The ratio; for a row with a relative tolerance, the deviation of the ratio from 1."""
        if self.ratio is None or isinstance(self.tolerance, tuple):
            return number(self.ratio)
        return f"1 {'-+'[self.ratio >= 1.0]} {abs(self.ratio - 1.0):.0e}"

    @property
    def band_text(self) -> str:
        """The band with its unit."""
        if not isinstance(self.tolerance, tuple):
            return f"within {self.tolerance:.2g}"
        low, high = self.band
        unit = "" if self.unit == "1" else f" {self.unit}"
        if math.isinf(high):
            return f"above {low:.4g}{unit}"
        return f"below {high:.4g}{unit}" if math.isinf(low) else f"{low:.4g} to {high:.4g}{unit}"

    @property
    def spread_text(self) -> str:
        """The spread; empty if there is none."""
        return "" if self.spread is None else f"{self.spread[0]:.4g} to {self.spread[1]:.4g}"

    @property
    def sign_text(self) -> str:
        """Whether the sign of the trend agrees; empty if there is no trend."""
        if self.sign_agrees is None:
            return ""
        return "agrees" if self.sign_agrees else "not all" if self.ok else "does not agree"

    @property
    def source_text(self) -> str:
        """The source and its trust."""
        return f"{self.source} [{self.trust}]"

    def to_dict(self) -> dict[str, Any]:
        """Return the row of `validate.json`, with None in place of NaN and infinity."""
        low, high = self.band
        row: dict[str, Any] = finite({**{key: getattr(self, key) for key in JSON_KEYS}, "low": low, "high": high})
        return row


JSON_KEYS = (
    *("name", "model", "published", "ratio", "ok", "agreement", "kind", "standing", "counts", "unit", "spread"),
    *("sign_agrees", "source", "trust", "scene", "note"),
)
"""Attributes in a row of `validate.json`."""


Chapter = Callable[[bool], Iterator[Row]]
"""Part of the report: runs scenes and yields each row as soon as the row is known. The argument `quick` leaves out
parts that take more than a few seconds. A failed run gives a row with model NaN, and the note gives the reason."""


def number(value: float | None) -> str:
    """Return a number as text; empty for None and NaN."""
    return "" if value is None or math.isnan(value) else f"{value:.4g}"
