"""A row of the validation report, which compares a number of the model with a published number."""

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
"""Tags for how reliable a published number is, with their meanings, from the most reliable to the least reliable."""

EVIDENCE_KINDS = {
    "robot": "measured on a robot",
    "animal": "measured on animals",
    "other model": "found by another simulation or analysis, not measured",
    "closed form": "an exact solution of the equations",
    "pattern generator": "computed from the equations or formulas of the generator's authors",
}
"""Kinds of evidence with which the model is compared, and their meanings."""

STANDINGS = {
    "prediction": "the model was not told the number",
    "verification": "shows that equations are solved right, nothing about robots or animals",
    "fitted": "the scene was fitted to the number; does not count",
    "input": "the number follows from a published number that the scene was given; does not count",
}
"""Standings of a row, and what agreement means for each of them."""

COUNTED = ("prediction", "verification")
"""Standings of the rows that count."""

AGREES, DEPENDS, MISSES = "agrees", "depends", "misses"
"""Agreement of a row. It agrees if the model's number is in the band for all values of the unpublished quantities. It
depends if the number is in the band only for the values in the scene. Otherwise it misses."""


@dataclass(frozen=True)
class Row:
    """A number of the model and the published number.

    Parameters
    ----------
    name : str
        Short description of the compared quantity, unique in the report.
    model : float
        Number of the model; NaN if a run did not finish.
    published : float or None
        Published number; None if only a band or the sign of a trend was published.
    tolerance : float or (float, float)
        Either the largest accepted relative error, or the band (lowest, highest) of accepted numbers in `unit`,
        including both ends. If `published` is 0, the error is absolute.
    source : str
        Source of the published number.
    note : str
        Explanation for the reader: the assumed values of the scene, or the reason why the model misses or has no
        number.
    trust : str
        A key of `TRUST`.
    unit : str
        Unit of `model` and `published`.
    scene : str
        Scene of the run, or the code that computes the number.
    kind : str
        A key of `EVIDENCE_KINDS`.
    standing : str
        A key of `STANDINGS`.
    spread : (float, float), optional
        Smallest and largest number of the model over the values of quantities that the source does not give. `model` is
        the number for the values in the scene.
    sign_agrees : bool, optional
        Whether the model shows the published trend over the whole spread; None if the row is not about a trend.
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
        """The lowest and the highest accepted number of the model, in `unit`."""
        if isinstance(self.tolerance, tuple):
            return self.tolerance
        assert self.published is not None
        reach = self.tolerance * (abs(self.published) or 1.0)
        return self.published - reach, self.published + reach

    @property
    def ok(self) -> bool:
        """Whether `model` lies in the band; False if `model` is NaN."""
        low, high = self.band
        return low <= self.model <= high

    @property
    def agreement(self) -> str:
        """One of `AGREES`, `DEPENDS` and `MISSES`."""
        low, high = self.band
        ends = self.spread or (self.model, self.model)
        if not self.ok:
            return MISSES
        return AGREES if low <= min(ends) and max(ends) <= high and self.sign_agrees is not False else DEPENDS

    @property
    def counts(self) -> bool:
        """Whether the row counts as evidence, which depends on its standing."""
        return self.standing in COUNTED

    @property
    def ratio(self) -> float | None:
        """`model` divided by `published`; None if one of the two is missing, or if `published` is 0."""
        if not self.published or not math.isfinite(self.model):
            return None
        return self.model / self.published

    @property
    def mark(self) -> str:
        """The agreement, or the standing if the row does not count."""
        return self.agreement if self.counts else self.standing

    @property
    def ratio_text(self) -> str:
        """The ratio as text, or its deviation from 1 if the row has a tolerance instead of a band."""
        if self.ratio is None or isinstance(self.tolerance, tuple):
            return number(self.ratio)
        return f"1 {'-+'[self.ratio >= 1.0]} {abs(self.ratio - 1.0):.0e}"

    @property
    def band_text(self) -> str:
        """The band with its unit, or the tolerance, as text."""
        if not isinstance(self.tolerance, tuple):
            return f"within {self.tolerance:.2g}"
        low, high = self.band
        unit = "" if self.unit == "1" else f" {self.unit}"
        if math.isinf(high):
            return f"above {low:.4g}{unit}"
        return f"below {high:.4g}{unit}" if math.isinf(low) else f"{low:.4g} to {high:.4g}{unit}"

    @property
    def spread_text(self) -> str:
        """The spread as text; empty if there is no spread."""
        return "" if self.spread is None else f"{self.spread[0]:.4g} to {self.spread[1]:.4g}"

    @property
    def sign_text(self) -> str:
        """Text that says whether the sign of the trend agrees; empty if the row is not about a trend."""
        if self.sign_agrees is None:
            return ""
        return "agrees" if self.sign_agrees else "not all" if self.ok else "does not agree"

    @property
    def source_text(self) -> str:
        """The source and the tag of its reliability."""
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
"""Attributes of a row that are written to `validate.json`."""


Chapter = Callable[[bool], Iterator[Row]]
"""Function for a part of the report, which runs scenes and yields each row as soon as it is finished. Its argument
`quick` says whether parts that take more than a few seconds are left out. If a run fails, `model` of the row is NaN,
and the note gives the reason."""


def number(value: float | None) -> str:
    """Return a number as text; empty for None and NaN."""
    return "" if value is None or math.isnan(value) else f"{value:.4g}"
