"""Continuation of a stored run of the 3D worm. `worm3d.recorded.series` declares the stored series."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np

import worm3d
from scenes.records.record import Record
from worm3d.recorded.series import Recorded, Steps, series_of, states_of
from worm3d.results.files import restored
from worm3d.values.arrays import FloatArray

STORED_SERIES = {
    name: series for name, series in (series_of(Recorded) | series_of(Steps)).items() if not series.derived
}
"""Series that a record stores. Series that can be computed from them are not stored."""

ENERGY_TERMS = tuple(each.name for each in fields(worm3d.Energy))


def joined(earlier: Record, rest: worm3d.Result) -> worm3d.Result:
    """Return the whole run. `earlier` is the record of the first part, and `rest` is the continuation."""

    def whole(name: str, later: FloatArray) -> FloatArray:
        """Return a series of the whole run.

        In series over time, the first row of the continuation repeats the last row of the record and is dropped.
        """
        begun = earlier[name]
        return np.concatenate(
            [begun, later[0 if name in STORED_SERIES and STORED_SERIES[name].dims[0] == "step" else 1 :]]
        )

    both: dict[str, Any] = {
        name: whole(name, getattr(rest, name)) for name, series in STORED_SERIES.items() if series.dims
    }
    states = {name: whole(f"actuator_{name}", rest.actuator_states[name]) for name in states_of(rest.worm)}
    settling = float(earlier["settling"])
    return replace(
        rest,
        **both,
        actuator_states=states,
        energy=worm3d.Energy(**{name: whole(name, getattr(rest.energy, name)) for name in ENERGY_TERMS}),
        halved_steps=int(earlier["halved_steps"]) + rest.halved_steps,
        settling=None if np.isnan(settling) else settling,
        error_estimate=_error(earlier, rest),
        stop=replace(rest.stop, step=rest.stop.step + earlier.sizes["step"]),
        wall_s=next(float(v.values) for v in earlier.timing if v.name == "wall_s") + rest.wall_s,
    )


def _error(earlier: Record, rest: worm3d.Result) -> worm3d.ErrorEstimate | None:
    """Return the error estimate of the whole run.

    Return None if one of the two parts has no estimate, or if the stored estimate is of another version.
    """
    begun = None
    with suppress(KeyError):
        begun = restored("error_estimate", json.loads(earlier.run).get("error_estimate"), [])
    return None if begun is None or rest.error_estimate is None else begun + rest.error_estimate
