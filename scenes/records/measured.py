"""Measured trajectories: CSV files read as records, and what a simulation says at the instants of a measurement.

A file has lines `# name: text`, such as title, source and licence, and a line for each marker on the body, such as
`# marker head: joint 6` or `# marker m2: body 0.5` (the share of the segments behind it: tail 0, head 1). A row of
column names follows (`scenes.records.columns`) and a row for each instant. Blank cells and `nan` are missing values.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenes.language.errors import SceneError
from scenes.language.toml import value as toml_value
from scenes.records import columns, csv_file
from scenes.records.columns import MARKER
from scenes.records.record import Record, Summary
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

MODEL = "measured"
"""Value of `Record.model` of a measurement."""
ENDING = ".csv"

JOINTS = ("joints", "joint", "main_node")
"""Variables that are the joints of a worm, from tail to head, in the records of different models."""

ROUNDING = 1e-9
"""Part of the duration by which an instant may lie outside of a simulation."""

_MARKER = re.compile(r"marker\s+(?P<name>\w+)")
_PLACE = re.compile(r"(?P<kind>joint|body)\s+(?P<number>\d+(\.\d*)?([eE][-+]?\d+)?)")


def load(path: Path) -> Record:
    """Read a measurement as a record of the model `measured`, in SI units.

    Raises
    ------
    SceneError
        Not a table of numbers with names and units, without two instants, or with instants that do not ascend.
    DiscError
        The file may not be read.
    """
    header, titles, rows = csv_file.split(path)
    try:
        variables = columns.variables_of(titles, csv_file.table(titles, rows))
        _require_instants(variables, [number for number, _ in rows])
        _require_markers(header, variables)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    return Record(
        name=path.stem,
        model=MODEL,
        scene=_scene(header),
        status="done",
        sentence="measured",
        seed=0,
        versions={},
        summary=Summary({"status": "done", "duration_s": float(np.ptp(variables_by(variables)["time"].values))}),
        variables=variables,
    )


def variables_by(variables: tuple[Variable, ...]) -> dict[str, Variable]:
    """Return variables by their names."""
    return {variable.name: variable for variable in variables}


def simulated_like(simulated: Record, measured: Record) -> dict[str, FloatArray]:
    """Return what a simulation says where and when something was measured: arrays like those of the measurement.

    Between the stored instants of the simulation it moves on straight lines. Markers are places on the line of joints,
    `strain` is the strain of each segment between its joints, a heading is taken in the turn nearest to the measured.

    Parameters
    ----------
    simulated, measured : Record

    Returns
    -------
    dict of str to ndarray
        By the measured quantity, each of the measured shape, in SI units; NaN at instants outside of the simulation.
        Quantities that the simulation does not have are left out (`unmatched` says why).

    Raises
    ------
    SceneError
        They have no quantity in common.
    """
    found = {name: array for name, array in _matched(simulated, measured) if not isinstance(array, str)}
    if not found:
        reasons = "; ".join(unmatched(simulated, measured).values())
        raise SceneError(f"{measured.name}: nothing of it can be compared with {simulated.name}: {reasons}")
    return found


def unmatched(simulated: Record, measured: Record) -> dict[str, str]:
    """Return why measured quantities have no counterpart in a simulation, by their names."""
    return {name: reason for name, reason in _matched(simulated, measured) if isinstance(reason, str)}


def _matched(simulated: Record, measured: Record) -> Iterator[tuple[str, FloatArray | str]]:
    """Yield each measured quantity with its simulated counterpart, or why there is none."""
    for variable in measured.variables:
        if variable.name == "time" or variable.dims[:1] != ("time",):
            continue
        try:
            series = _series(simulated, measured, variable)
        except SceneError as error:
            yield variable.name, str(error)
            continue
        like = _fitted(at_instants(simulated["time"], series, measured["time"]), variable.values.shape)
        if variable.name == "heading":
            turns = np.round((variable.values - like) / (2.0 * np.pi))
            like = like + 2.0 * np.pi * np.where(np.isfinite(turns), turns, 0.0)
        yield variable.name, like


def at_instants(time: FloatArray, values: NDArray[np.floating], instants: FloatArray) -> FloatArray:
    """Return series, shape (T, ...), at ascending times, (T,), at other instants, (K,); NaN outside, shape (K, ...)."""
    slack = ROUNDING * float(time[-1] - time[0])
    t = np.clip(instants, time[0], time[-1])
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(len(time) - 2, 0))
    after = np.minimum(k + 1, len(time) - 1)
    span = np.where(after > k, time[after] - time[k], 1.0)
    share = ((t - time[k]) / span).reshape(-1, *(1,) * (values.ndim - 1))
    found: FloatArray = np.where(share == 0.0, values[k], np.where(share == 1.0, values[after], np.nan))
    between = np.broadcast_to((share > 0.0) & (share < 1.0), found.shape)
    found = np.where(between, (1.0 - share) * values[k] + share * values[after], found)
    found[(instants < time[0] - slack) | (instants > time[-1] + slack)] = np.nan
    return found


def _fitted(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the leading part of an array in another shape, NaN where it has nothing: axes and first indices."""
    fitted = np.full(shape, np.nan)
    part = tuple(slice(0, min(sizes)) for sizes in zip(values.shape, shape, strict=True))
    fitted[part] = values[part]
    return fitted


def _series(simulated: Record, measured: Record, variable: Variable) -> FloatArray:
    """Return the simulated counterpart of a measured quantity, at the stored instants."""
    name = variable.name
    if name.startswith(MARKER):
        values, unit = _marker(joints_of(simulated), _places(measured)[name.removeprefix(MARKER)], name), "m"
    elif name == "strain" and name not in simulated:
        values, unit = segment_strain(simulated), "1"
    else:
        if name not in simulated:
            raise SceneError(f"{simulated.name} has no {name}")
        values, unit = simulated[name], simulated.variable(name).units
    if unit != variable.units:
        raise SceneError(f"{name}: got a unit of [{variable.units}], must be one of [{unit}] as in {simulated.name}")
    has = variable.dims[1:].count("axis")
    if values.ndim != variable.values.ndim:
        raise SceneError(
            f"{name} has {variable.values.ndim - 1 - has} indices, in {simulated.name} {values.ndim - 1 - has}"
        )
    for size, most in zip(variable.values.shape[1 : variable.values.ndim - has], values.shape[1:], strict=False):
        if size > most:
            raise SceneError(f"{name} is measured up to index {size - 1}, {simulated.name} has 0 to {most - 1}")
    return np.asarray(values, dtype=float)


def joints_of(record: Record) -> FloatArray:
    """Return the joints of a simulated worm, shape (T, N+1, 2 or 3) [m]; a SceneError if the record has none."""
    for name in JOINTS:
        if name in record:
            joints: FloatArray = record[name]
            return joints
    raise SceneError(f"{record.name} has no joints")


def segment_strain(record: Record) -> FloatArray:
    """Return the distance of neighbouring joints over the rest length l0 of a segment, less 1, shape (T, N)."""
    joints = joints_of(record)
    if record.scene:
        length = tomllib.loads(record.scene)["worm"]["length_m"]
    else:
        length = json.loads(record.run)["worm"]["length"]
    strain: FloatArray = np.linalg.norm(np.diff(joints, axis=1), axis=2) * (joints.shape[1] - 1) / length - 1.0
    return strain


def _places(measured: Record) -> dict[str, tuple[str, float]]:
    """Return the kind of place of each marker, joint or body, and its number."""
    header: dict[str, str] = tomllib.loads(measured.scene)["header"]
    return {name: _place(name, text) for name, text in _markers(header).items()}


def _place(name: str, text: str) -> tuple[str, float]:
    if not (match := _PLACE.fullmatch(text)):
        raise SceneError(f"marker {name}: got '{text}', must be 'joint NUMBER' or 'body SHARE', such as 'body 0.5'")
    kind, number = match["kind"], float(match["number"])
    if kind == "joint" and not number.is_integer():
        raise SceneError(f"marker {name}: got '{text}', the number of a joint must be an integer, 0 for the tail")
    if kind == "body" and number > 1.0:
        raise SceneError(f"marker {name}: got '{text}', the share of the body must be from 0 (tail) to 1 (head)")
    return kind, number


def _marker(joints: FloatArray, place: tuple[str, float], name: str) -> FloatArray:
    """Return the positions of a marker, shape (T, 2 or 3) [m], on the line of joints (T, N+1, 2 or 3)."""
    kind, number = place
    last = joints.shape[1] - 1
    if kind == "joint" and number > last:
        raise SceneError(f"{name} sits on joint {number:g}, the simulated worm has joints 0 to {last}")
    along = number if kind == "joint" else number * last
    k = min(int(along), last - 1)
    found: FloatArray = joints[:, k] + (along - k) * (joints[:, k + 1] - joints[:, k])
    return found


def _require_instants(variables: tuple[Variable, ...], lines: list[int]) -> None:
    time = variables_by(variables).get("time")
    if time is None or time.dims != ("time",) or time.units != "s":
        raise SceneError("no column of time, must have one named time_s (or time_ms)")
    if len(variables) == 1:
        raise SceneError("only a column of time, must have one of what was measured, such as com_x_m")
    if np.isnan(time.values).any():
        raise SceneError(f"line {lines[int(np.argmax(np.isnan(time.values)))]}: without a time")
    if (later := np.diff(time.values) <= 0.0).any():
        k = int(np.argmax(later))
        raise SceneError(
            f"line {lines[k + 1]}: got the time {time.values[k + 1]:g} s after {time.values[k]:g} s, must ascend"
        )


def _require_markers(header: dict[str, str], variables: tuple[Variable, ...]) -> None:
    """Refuse markers without place on the body, and places without marker."""
    said = _markers(header)
    for name, text in said.items():
        _place(name, text)
    measured = {each.name.removeprefix(MARKER) for each in variables if each.name.startswith(MARKER)}
    for name in sorted(measured - said.keys()):
        raise SceneError(
            f"marker {name}: not said where on the body it sits, must have a line such as '# marker {name}: joint 0' "
            f"or '# marker {name}: body 0.5'"
        )
    for name in sorted(said.keys() - measured):
        raise SceneError(f"marker {name}: has no columns, must have marker_{name}_x_m and others, or no line")


def _markers(header: dict[str, str]) -> dict[str, str]:
    return {match["name"]: text for name, text in header.items() if (match := _MARKER.fullmatch(name))}


def _scene(header: dict[str, str]) -> str:
    """Return the header as TOML: what stands for the scene of a record."""
    title = [f"title = {toml_value(header['title'])}"] if "title" in header else []
    lines = (f"{toml_value(name)} = {toml_value(text)}" for name, text in header.items())
    return "\n".join([f"model = {toml_value(MODEL)}", *title, "", "[header]", *lines]) + "\n"
