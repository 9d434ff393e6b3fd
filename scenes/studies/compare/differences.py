"""Differences of runs and measurements: of scenes, of the figures in the summaries, and of series."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from scenes.records import measured
from scenes.records.columns import MARKER
from scenes.records.record import Record
from scenes.studies.compare.sources import Source, flat
from scenes.sweep.key import KEY_LENGTH
from worm3d.values.arrays import FloatArray
from worm3d.values.metrics import METRIC_ROUNDING, named

ROUNDED = 1e-9
"""Largest range of a series that counts as constant, as a fraction of the series' largest magnitude."""
CASE = re.compile(rf"[0-9a-f]{{{KEY_LENGTH}}}$")
"""Pattern of the hexadecimal key that ends the label of a sweep case without a name of its own."""
MOST_SETTINGS = 3
"""Largest number of differing settings in the label of a sweep case."""
ABSENT = "-"
"""Value of a key that a scene does not have."""


@dataclass(frozen=True)
class Difference:
    """Difference between a source and the reference in one figure or one series."""

    kind: str
    """`figure` for a figure of the summary, `both` for the displacement or the turn over the time that both records
    have, `series` for a series over this time."""
    name: str
    unit: str
    """SI unit or degree; "1" for a dimensionless quantity."""
    source: str
    """Label of the source that is compared with the reference."""
    reference: float | None
    """Value of the reference. For a series, this is the largest range over time of any component in either record."""
    value: float | None
    """Value of the source. For a series, this is the largest difference at any instant."""
    difference: float | None
    """`value` minus `reference`. For a series, this is the root mean square difference."""
    relative: float | None
    """`difference` divided by the magnitude of `reference`; None if `reference` is 0 or as small as a rounding
    error."""


class Setting(NamedTuple):
    """A key of the scene that differs between sources."""

    key: str
    values: tuple[str, ...]
    """Text of the value in each source; `ABSENT` if a source has no such key."""


def settings(given: Sequence[Source]) -> list[Setting]:
    """Return the keys that differ between the scenes of simulations."""
    scenes = [{} if source.is_measured else flat(source.scene) for source in given]
    simulated = [scene for source, scene in zip(given, scenes, strict=True) if not source.is_measured]
    keys = dict.fromkeys(key for scene in simulated for key in scene)
    shown = [key for key in keys if key not in ("title", "says")]  # these two do not affect the run
    differing = [key for key in shown if len({scene.get(key) for scene in simulated}) > 1]
    return [Setting(key, tuple(scene.get(key, ABSENT) for scene in scenes)) for key in differing]


def named_by_settings(given: Sequence[Source]) -> list[Source]:
    """Return the sources with readable labels.

    A sweep case gets its differing settings as label, or the first eight digits of its key if these settings do not
    distinguish it. Other sources keep their labels.
    """
    simulated = [k for k, source in enumerate(given) if not source.is_measured]
    shared = [each for each in settings(given) if all(each.values[k] != ABSENT for k in simulated)]
    differing = sorted(shared, key=lambda each: each.key == "seed")[:MOST_SETTINGS]
    unseeded = [each for each in differing if each.key != "seed"]
    cases = {k: case.start() for k, source in enumerate(given) if (case := CASE.search(source.label))}
    if len({tuple(each.values[k] for each in unseeded) for k in cases}) == len(cases):
        differing = unseeded or differing
    texts = {k: ", ".join(f"{key} = {values[k]}" for key, values in differing) for k in cases}
    labels = [source.label for source in given]
    for k, begin in cases.items():
        is_one = texts[k] and [*texts.values()].count(texts[k]) == 1
        labels[k] = texts[k] if is_one else labels[k][: begin + 8]  # the first eight digits of the key
    if len(set(labels)) < len(labels):
        return list(given)
    return [replace(source, label=label) for source, label in zip(given, labels, strict=True)]


def figures(given: Sequence[Source]) -> list[Difference]:
    """Return the differences of all summary figures that the reference or another source has."""
    first, *others = given
    names = dict.fromkeys(name for source in given for name, value in source.figures.items() if _is_number(value))
    return [
        _difference("figure", name, unit_of(name), source.label, _number(first, name), _number(source, name))
        for name in names
        for source in others
    ]


def series(given: Sequence[Source]) -> list[Difference]:
    """Return the differences over time of all series that the reference and another source have in common."""
    first, *others = given
    return [
        each
        for source in others
        if first.record is not None and source.record is not None
        for each in _of_series(source.label, first.record, source.record)
    ]


def unit_of(name: str) -> str:
    """Return the unit of a figure by the ending of its name."""
    return named(name)[1] or "1"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(source: Source, name: str) -> float | None:
    value = source.figures.get(name)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def _difference(
    kind: str, name: str, unit: str, source: str, reference: float | None, value: float | None
) -> Difference:
    difference = None if value is None or reference is None else value - reference
    known = reference is not None and abs(reference) >= METRIC_ROUNDING.get(unit, 0.0)
    relative = _over(difference, reference) if known else None
    return Difference(kind, name, unit, source, reference, value, difference, relative)


def _over(difference: float | None, reference: float | None) -> float | None:
    return None if difference is None or not reference else difference / abs(reference)


def _of_series(label: str, reference: Record, other: Record) -> Iterator[Difference]:
    for name, (unit, ours, theirs) in common(reference, other).items():
        known = np.isfinite(ours) & np.isfinite(theirs)
        if not known.any():
            continue
        yield from _of_both(label, name, unit, ours, theirs)
        off = np.abs(theirs - ours)[known]
        rms, most = float(np.sqrt(np.mean(off**2))), float(off.max())
        wide = max(_range(ours), _range(theirs))
        largest = float(max(np.abs(ours[known]).max(), np.abs(theirs[known]).max()))
        varies = wide > max(ROUNDED * largest, METRIC_ROUNDING.get(unit, 0.0))
        yield Difference("series", name, unit, label, wide, most, rms, _over(rms, wide) if varies else None)


def _of_both(label: str, name: str, unit: str, ours: FloatArray, theirs: FloatArray) -> Iterator[Difference]:
    """Yield the displacement of a point, or the change of the heading, between the first and the last common instant.

    Nothing is yielded for other series.
    """
    if name == "heading":
        name, unit, ours, theirs = "heading_change", "deg", np.rad2deg(ours)[:, None], np.rad2deg(theirs)[:, None]
    elif (name == "com" or name.startswith(MARKER)) and ours.ndim == 2:
        name = f"{name}_displacement"
    else:
        return
    known = np.isfinite(ours) & np.isfinite(theirs)
    axes = known.any(axis=0)
    rows = known[:, axes].all(axis=1)
    ours, theirs = ours[rows][:, axes], theirs[rows][:, axes]
    if len(ours) > 1:
        reference, value = (_moved(each, signed=unit == "deg") for each in (ours, theirs))
        yield _difference("both", name, unit, label, reference, value)


def _moved(values: FloatArray, *, signed: bool) -> float:
    change = values[-1] - values[0]
    return float(change[0]) if signed else float(np.linalg.norm(change))


def _range(values: FloatArray) -> float:
    """Return the largest range over time of any component of a series of shape (T, ...); NaN values are ignored."""
    columns = values.reshape(len(values), -1)
    columns = columns[:, np.isfinite(columns).any(axis=0)]
    return float(np.max(np.nanmax(columns, axis=0) - np.nanmin(columns, axis=0)))


def common(reference: Record, other: Record) -> dict[str, tuple[str, FloatArray, FloatArray]]:
    """Return the series that two records have in common.

    The result maps the name of each series to its unit, the values of the reference, and the values of the other record
    at the same instants. The instants come from the measurement if one record is a measurement, otherwise from the
    reference. A value is NaN if its record has no value at this instant.
    """
    if measured.is_measured(other) and not measured.is_measured(reference):
        return {name: (unit, ours, theirs) for name, (unit, theirs, ours) in common(other, reference).items()}
    if measured.is_measured(reference):
        like = measured.matched(other, reference)[0]
        return {name: (reference.variable(name).units, reference[name], like[name]) for name in like}
    mine, its = measured.series_of(reference), measured.series_of(other)
    same = [n for n in mine if n in its and mine[n].values.shape[1:] == its[n].values.shape[1:]]
    instants = reference["time"]
    return {
        name: (mine[name].units, mine[name].values, measured.at_instants(other["time"], its[name].values, instants))
        for name in same
        if mine[name].units == its[name].units
    }


def left_out(given: Sequence[Source]) -> list[str]:
    """Return sentences that name the measured series that are not compared, with the reasons."""
    first, *others = given
    pairs = [(first, source) for source in others] + [(source, first) for source in others]
    return [
        f"{lab.label}: {reason}"
        for lab, other in pairs
        if lab.is_measured and lab.record is not None and other.record is not None
        for reason in measured.unmatched(other.record, lab.record).values()
    ]


def rows_by_name(found: Sequence[Difference]) -> Mapping[str, list[Difference]]:
    """Return differences grouped by name, in order."""
    rows: dict[str, list[Difference]] = {}
    for each in found:
        rows.setdefault(each.name, []).append(each)
    return rows
