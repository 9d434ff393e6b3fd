"""Measurements: reading them from CSV files, and values of a simulation at the instants of a measurement.

A file begins with lines `# name: text`, such as title, source and licence. Each marker on the body has a line such as
`# marker head: joint 6` or `# marker m2: body 0.5` (`scenes.records.markers`). Then follow a row of column names
(`scenes.records.columns`) and a row of numbers for each instant. Blank cells and `nan` are missing values.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenes.language.errors import SceneError
from scenes.language.toml import value as toml_value
from scenes.records import columns, csv_file, markers
from scenes.records.columns import MARKER
from scenes.records.record import Record, Summary
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

MEASURED_MODEL = "measured"
"""Value of `Record.model` for a measurement."""
ENDING = ".csv"
"""Ending of the file name of a measurement."""

JOINTS = ("joints", "joint", "main_node")
"""Names that the records of different models use for the variable with the joints, from tail to head."""

TIME_TOLERANCE = 1e-9
"""Fraction of the duration of a simulation by which an instant of a measurement may lie outside the simulation."""


def load(path: Path) -> Record:
    """Read a measurement as a record of the model `measured`, in SI units.

    Raises
    ------
    SceneError
        If the file is not a table of numbers with valid column names, or has fewer than two instants, or if the
        instants are not in ascending order.
    DiscError
        If the file cannot be read.
    """
    header, titles, rows = csv_file.split(path)
    try:
        variables = columns.variables_of(titles, csv_file.table(titles, rows))
        time = _instants(variables, [number for number, _ in rows])
        said = {each.name.removeprefix(MARKER) for each in variables if each.name.startswith(MARKER)}
        markers.require_same(markers.places(header), said)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    return Record(
        name=path.stem,
        model=MEASURED_MODEL,
        scene=as_scene(header),
        status="done",
        sentence="measured",
        seed=0,
        versions={},
        summary=Summary({"status": "done", "duration_s": float(np.ptp(time))}),
        variables=variables,
    )


def is_measured(record: Record) -> bool:
    """Return whether a record is a measurement, not a simulation."""
    return record.model == MEASURED_MODEL


def simulated_like(simulated: Record, measured: Record) -> dict[str, FloatArray]:
    """Return the values of a simulation that correspond to the values of a measurement.

    Between its stored instants, the simulation is interpolated linearly. Markers are positions on the line of joints,
    and `strain` is the strain of each segment, measured between its joints. A heading is shifted by whole turns to be
    nearest to the measured heading.

    Parameters
    ----------
    simulated, measured : Record

    Returns
    -------
    dict of str to ndarray
        For each measured quantity, an array of the shape of the measurement, in SI units. Values at instants outside
        the simulation are NaN. Quantities that the simulation does not have are left out (`unmatched` gives the
        reasons).

    Raises
    ------
    SceneError
        If the records have no quantity in common.
    """
    found, reasons = matched(simulated, measured)
    if not found:
        raise SceneError(
            f"{measured.name}: nothing of it can be compared with {simulated.name}: {'; '.join(reasons.values())}"
        )
    return found


def unmatched(simulated: Record, measured: Record) -> dict[str, str]:
    """Return, by name, the reasons why measured quantities have no counterpart in a simulation."""
    return matched(simulated, measured)[1]


def matched(simulated: Record, measured: Record) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Return the results of `simulated_like` and of `unmatched`. Each of the two dictionaries may be empty."""
    found: dict[str, FloatArray] = {}
    reasons: dict[str, str] = {}
    for name, variable in series_of(measured).items():
        try:
            series = counterpart(simulated, measured, variable)
        except SceneError as error:
            reasons[name] = str(error)
            continue
        like = _fitted(at_instants(simulated["time"], series, measured["time"]), variable.values.shape)
        found[name] = _turned(like, variable.values) if name == "heading" else like
    return found, reasons


def series_of(record: Record) -> dict[str, Variable]:
    """Return the variables of a record that have a value for each stored instant, by name.

    For a simulation, this includes the strains of the segments.
    """
    names = [v.name for v in record.variables if _is_series(v)]
    own = {name: one_series(record, name) for name in (*names, "strain")}
    return {name: variable for name, variable in own.items() if variable is not None}


def one_series(record: Record, name: str) -> Variable | None:
    """Return the entry of `series_of` with the given name, or None if there is none."""
    own = {v.name: v for v in record.variables if _is_series(v)}
    if name in own or name != "strain" or is_measured(record) or not any(each in own for each in JOINTS):
        return own.get(name)
    meaning = "distance of neighbouring joints over the rest length of a segment, less 1"
    return Variable("strain", ("time", "segment"), segment_strain(record), "1", meaning)


def _is_series(variable: Variable) -> bool:
    return variable.dims[:1] == ("time",) and variable.name != "time" and variable.values.dtype.kind in "iuf"


def counterpart(simulated: Record, measured: Record, variable: Variable) -> FloatArray:
    """Return the values of a simulation for a measured quantity, at the instants of the simulation.

    Raise SceneError if the simulation does not have the quantity.
    """
    name = variable.name
    if (own := one_series(simulated, name)) is not None:
        values, unit = own.values, own.units
    elif name.startswith(MARKER) and (joints := next((each for each in JOINTS if each in simulated), None)):
        place = markers.places(tomllib.loads(measured.scene)["header"])[name.removeprefix(MARKER)]
        values, unit = markers.positions(simulated[joints], place), "m"
    else:
        raise SceneError(f"{simulated.name} has no {name}")
    if unit != variable.units:
        raise SceneError(f"{name}: got a unit of [{variable.units}], must be one of [{unit}] as in {simulated.name}")
    numbered = variable.values.ndim - variable.dims.count("axis")
    if values.ndim != variable.values.ndim:
        shape, right = variable.values.shape[1:], values.shape[1:]
        raise SceneError(f"{name}: got shape {shape} at each instant, must be {right} as in {simulated.name}")
    for size, most in zip(variable.values.shape[1:numbered], values.shape[1:], strict=False):
        if size > most:
            raise SceneError(f"{name} is measured up to index {size - 1}, {simulated.name} has 0 to {most - 1}")
    return np.asarray(values, dtype=float)


def at_instants(time: FloatArray, values: NDArray[np.floating], instants: FloatArray) -> FloatArray:
    """Return the values of a series at other instants, interpolated linearly, shape (K, ...).

    `time` are the ascending times of the series, shape (T,), `values` its values, shape (T, ...), and `instants` the
    other instants, shape (K,). Values outside the range of `time` are NaN.
    """
    if np.array_equal(time, instants):
        return values.astype(float)
    slack = TIME_TOLERANCE * float(time[-1] - time[0])
    t = np.clip(instants, time[0], time[-1])
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(len(time) - 2, 0))
    after = np.minimum(k + 1, len(time) - 1)
    span = np.where(after > k, time[after] - time[k], 1.0)
    share = ((t - time[k]) / span).reshape(-1, *(1,) * (values.ndim - 1))
    # At a stored instant only its own value is used, so that a NaN at the neighbouring instant has no effect.
    found = np.where(
        share == 0.0,
        values[k],
        np.where(share == 1.0, values[after], (1.0 - share) * values[k] + share * values[after]),
    )
    found[(instants < time[0] - slack) | (instants > time[-1] + slack)] = np.nan
    return found


def segment_strain(record: Record) -> FloatArray:
    """Return the strains of the segments, shape (T, N).

    The strain is the distance between the two joints of a segment, divided by its length at rest, minus 1.
    """
    joints = next(record[name] for name in JOINTS if name in record)
    if record.scene:
        length = tomllib.loads(record.scene)["worm"]["length_m"]
    else:
        length = json.loads(record.run)["worm"]["length"]
    strain: FloatArray = np.linalg.norm(np.diff(joints, axis=1), axis=2) * (joints.shape[1] - 1) / length - 1.0
    return strain


def _fitted(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return an array that is cut to another shape, and filled with NaN where the array is smaller."""
    fitted = np.full(shape, np.nan)
    part = tuple(slice(0, min(sizes)) for sizes in zip(values.shape, shape, strict=True))
    fitted[part] = values[part]
    return fitted


def _turned(heading: FloatArray, towards: FloatArray) -> FloatArray:
    """Return a heading [rad] that is shifted by whole turns to be nearest to another heading."""
    turns = np.round((towards - heading) / (2.0 * np.pi))
    turned: FloatArray = heading + 2.0 * np.pi * np.where(np.isfinite(turns), turns, 0.0)
    return turned


def _instants(variables: tuple[Variable, ...], lines: list[int]) -> FloatArray:
    """Return the instants of a measurement, shape (T,) [s]; `lines` are their line numbers in the file."""
    found = next((v for v in variables if v.name == "time"), None)
    if found is None or found.dims != ("time",) or found.units != "s":
        raise SceneError("no column of time, must have one named time_s (or time_ms)")
    if len(variables) == 1:
        raise SceneError("only a column of time, must have one of what was measured, such as com_x_m")
    time: FloatArray = found.values
    if np.isnan(time).any():
        raise SceneError(f"line {lines[int(np.argmax(np.isnan(time)))]}: without a time")
    if (late := np.diff(time) <= 0.0).any():
        k = int(np.argmax(late))
        raise SceneError(f"line {lines[k + 1]}: got the time {time[k + 1]:g} s after {time[k]:g} s, must ascend")
    return time


def as_scene(header: dict[str, str]) -> str:
    """Return the header of a measurement as TOML, which a record stores in place of a scene."""
    title = [f"title = {toml_value(header['title'])}"] if "title" in header else []
    lines = (f"{toml_value(name)} = {toml_value(text)}" for name, text in header.items())
    return "\n".join([f"model = {toml_value(MEASURED_MODEL)}", *title, "", "[header]", *lines]) + "\n"
