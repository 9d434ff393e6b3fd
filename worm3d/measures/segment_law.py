"""Measures of how sure a segment law is, from the ensemble of laws that were fitted to the same table."""

from __future__ import annotations

from functools import partial

from worm3d.measures.table import NoValueError, measure
from worm3d.physics.segment_laws.law import Spread
from worm3d.recorded.finished import FinishedRun
from worm3d.values.read_only import kept

MOST_STATES = 20_000
"""Largest number of states of chambers at which the laws are compared. Of longer runs, rows at equal steps are taken.
With a quarter of the states, the measures of ten seconds of crawling change by less than 1 %."""

MEANINGS = {
    "law_spread_N": ("force", "rms standard deviation, between the laws of the ensemble, of the force of a segment"),
    "law_spread_share": ("force_share", "law_spread_N divided by the rms force of a segment"),
    "law_spread_m": ("radius", "rms standard deviation, between the laws of the ensemble, of the radius of a segment"),
}
"""Field of `Spread` and meaning of each measure."""


@kept
def _spread(result: FinishedRun) -> Spread:
    length, contraction = result.chamber_length, result.contraction
    rows = slice(None, None, max(1, -(-length.size // MOST_STATES)))
    found = result.worm.segment.spread(length[rows], contraction[rows])
    if found is None:
        raise NoValueError("the segment law is exact, or its file has no ensemble of laws")
    return found


def _part(result: FinishedRun, name: str) -> float:
    return float(getattr(_spread(result), name))


for _name, (_field, _meaning) in MEANINGS.items():
    measure(_name, _meaning)(partial(_part, name=_field))
