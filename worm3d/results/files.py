"""Files of results, for `Result.save` and `worm3d.load`. The command `worm3d run` also writes such files.

A file has the series of a result as variables, and the state at the end in the group `checkpoint`. The attribute `run`
describes the worm, the world and the end of the run as JSON text. Larger arrays of this description are in the group
`run`. Nothing is pickled, and reading a file imports no user code. For a part of a user-defined class, the file has the
parameters and the class attributes that a result needs. For a world of a user-defined class, the file has the surface
around the worm's path. The metrics of such runs are stored, because they cannot be computed from the file.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from os import PathLike, fspath
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from worm3d.measures import Metric, reasons, summary
from worm3d.physics.friction_laws import FrictionLaw
from worm3d.physics.kernels import GREATEST_CONTRACTION
from worm3d.physics.part import Part
from worm3d.physics.worm import Worm
from worm3d.recorded.energy import Energy
from worm3d.recorded.finished import FinishedRun
from worm3d.recorded.series import Recorded, Steps, series_of, states_of
from worm3d.recorded.state import State
from worm3d.recorded.status import Status, Stop
from worm3d.values import arguments, netcdf
from worm3d.values.named import EXCEPTIONS
from worm3d.values.netcdf import Content, FileError
from worm3d.values.spelling import did_you_mean
from worm3d.values.variable import Variable
from worm3d.worlds import World
from worm3d.worlds.sampled import SampledWorld

RESULT = "result.nc"
"""Name of the file in a folder written by `worm3d run`."""

RUN, CHECKPOINT = "run", "checkpoint"
"""Names of the groups with the arrays of worm and world, and with the state at the end."""

STATE_FIELDS = {
    "joints": "m",
    "directors": "1",
    "bend": "rad",
    "joint_velocity": "m/s",
    "roll_rate": "rad/s",
    "bend_rate": "rad/s",
    "contraction": "1",
    "time": "s",
}
"""Units of the numeric fields of a state."""

FIELD_PREFIX, MEMORY_PREFIX = "state_", "memory_"
"""Prefixes of the names of variables in the group `checkpoint`: fields of the state, and arrays of its memory."""

KEPT_MARGIN = 0.4
"""A user-defined world is stored up to this distance from the worm's path [body lengths]. Pictures show 0.3 body
lengths. With half this value, pictures would show the edge of the stored part. With double this value, the cells of the
grid would be a third wider."""


def save(result: FinishedRun, path: str | PathLike[str]) -> None:
    """Write a result; see `Result.save`."""
    arguments.instance("path", path, str | PathLike, "the path of a file")
    text, arrays = described(result)
    content = Content(
        {
            "name": "result",
            "model": "python",
            "scene": "",
            "status": result.status.name.lower(),
            "sentence": result.stop.sentence,
            "seed": 0,
            "versions": json.dumps({"worm3d": version("worm3d")}),
            "summary": json.dumps({"status": "done", **summary(result), "reasons": reasons(result)}),
            "run": text,
        },
        {
            netcdf.ROOT: tuple(result.variables()),
            netcdf.TIMING: (Variable("wall_s", (), result.wall_s, "s", "wall time of the simulation"),),
            CHECKPOINT: checkpoint_of(result.state),
            RUN: arrays,
        },
    )
    netcdf.write_whole(Path(path), netcdf.packed(netcdf.signed(content)))


def read(path: str | PathLike[str], worm: Worm | None, world: Any) -> tuple[dict[str, Any], dict[str, Metric]]:
    """Return the fields of the result in a file, and the metrics that cannot be computed from the file.

    Parameters and errors are the same as in `worm3d.load`.
    """
    arguments.instance("path", path, str | PathLike, "the path of a file")
    file = Path(path) / RESULT if Path(path).is_dir() else Path(path)
    _require_there(file)
    content, name = netcdf.load(file), str(file)
    content.require_digest(name)
    if "run" not in content.attributes:
        raise FileError(
            f"{name}: does not say which worm it is of: made by an earlier version of worm3d, or not by the 3D worm; "
            "run it again"
        )
    try:
        return _fields(content, worm, world), _figures(content)
    except (KeyError, TypeError, AttributeError) as error:
        raise FileError(f"{name}: made by another version of worm3d: {type(error).__name__}: {error}") from error
    except ValueError as error:
        raise FileError(f"{name}: {error}") from error


def _require_there(file: Path) -> None:
    """Raise FileNotFoundError if a file does not exist. The message names a similar file if there is one."""
    if file.exists():
        return
    beside = [(each.name, str(each)) for each in file.parent.iterdir()] if file.parent.is_dir() else []
    meant = did_you_mean(file.name, beside)
    hint = f"; did you mean {meant!r}?" if meant else ""
    raise FileNotFoundError(
        f"{file}: no such file; a result is what Result.save wrote, or the folder that 'worm3d run' wrote{hint}"
    )


def _fields(content: Content, worm: Worm | None, world: Any) -> dict[str, Any]:
    run = json.loads(content.attributes["run"])
    arrays = [variable.values for variable in content.groups.get(RUN, ())]
    values = {variable.name: variable.values for variable in content.groups[netcdf.ROOT]}
    timing = {variable.name: variable.values for variable in content.groups[netcdf.TIMING]}
    found: Worm = restored("worm", run["worm"], arrays) if worm is None else worm
    names = [name for name, series in (series_of(Recorded) | series_of(Steps)).items() if not series.derived]
    given: dict[str, Any] = {name: values[name] for name in names}
    settling = float(given.pop("settling"))
    return dict(
        given,
        halved_steps=int(given["halved_steps"]),
        worm=found,
        world=restored("world", run["world"], arrays) if world is ... else world,
        gravity=restored("gravity", run["gravity"], arrays),
        dt=run["dt"],
        period=run["period"],
        settling=None if np.isnan(settling) else settling,
        actuator_states={name: values[f"actuator_{name}"] for name in states_of(found)},
        energy=Energy(**{each.name: values[each.name] for each in fields(Energy)}),
        state=_state(content.groups.get(CHECKPOINT, ()), given, run["laid"]),
        stop=Stop(**{**run["stop"], "status": Status[run["stop"]["status"]]}),
        wall_s=float(timing["wall_s"]),
        error_estimate=restored("error_estimate", run.get("error_estimate"), arrays),
    )


def _figures(content: Content) -> dict[str, Metric]:
    """Return the stored metrics of a run with user-defined parts or measures, with reasons for missing values."""
    figures = json.loads(content.attributes["summary"])
    kept = json.loads(content.attributes["run"]).get("measured", ())
    return {name: (figures[name], figures["reasons"].get(name, "")) for name in kept if name in figures}


def world_of(said: str, parts: tuple[Variable, ...]) -> Any:
    """Return the world that the attribute `run` describes. `parts` are the variables of the group `run`."""
    return restored("world", json.loads(said)["world"], [variable.values for variable in parts])


def described(result: FinishedRun, measured: Iterable[str] = ()) -> tuple[str, tuple[Variable, ...]]:
    """Return the attribute `run` with worm, world and end of a run, and the variables of the group `run`.

    `measured` are the names of user-defined measures whose values have to be stored.
    """
    arrays: list[NDArray[Any]] = []
    worm, world = plain(result.worm, arrays), plain(result.world, arrays)
    own = [*measured]
    if '"unknown"' in json.dumps(world):
        world = plain(_seen(result), arrays)
        own += [*summary(result)]
    elif '"own"' in json.dumps(worm):
        own += [*summary(result)]
    stop = {each.name: getattr(result.stop, each.name) for each in fields(Stop)}
    said = {
        "worm": worm,
        "world": world,
        "gravity": plain(result.gravity, arrays),
        "dt": result.dt,
        "period": result.period,
        "laid": result.state.laid,
        **({} if result.error_estimate is None else {"error_estimate": plain(result.error_estimate, arrays)}),
        "stop": {**stop, "status": result.status.name},
        **({"measured": [*dict.fromkeys(own)]} if own else {}),
    }
    variables = (
        Variable(
            f"array_{k}", tuple(f"array_{k}_{n}" for n in range(array.ndim)), array, "SI", "of the worm or its world"
        )
        for k, array in enumerate(arrays)
    )
    return json.dumps(said), tuple(variables)


def _seen(result: FinishedRun) -> World | None:
    """Return a sampled copy of the visible part of a user-defined world, or None if the world raises an error."""
    assert result.world is not None
    with suppress(*EXCEPTIONS):
        return SampledWorld.around(result.world, result.points, KEPT_MARGIN * result.worm.length)
    return None


def checkpoint_of(state: State) -> tuple[Variable, ...]:
    """Return the variables of the group `checkpoint` for a state with its memory."""
    arrays = {
        FIELD_PREFIX + name: (getattr(state, name), unit, f"{name} at the end") for name, unit in STATE_FIELDS.items()
    }
    for name, array in state.memory.items():
        arrays[MEMORY_PREFIX + name] = (array, "SI", f"what the next step depends on: {name}, in the solver's layout")
    return tuple(
        Variable(name, tuple(f"size_{n}" for n in np.shape(array)), array, unit, meaning)
        for name, (array, unit, meaning) in arrays.items()
    )


def state_of(checkpoint: tuple[Variable, ...], laid: bool = False) -> State:
    """Return the state from the variables of the group `checkpoint`."""
    values = {variable.name: variable.values for variable in checkpoint}
    memory = {
        name.removeprefix(MEMORY_PREFIX): array for name, array in values.items() if name.startswith(MEMORY_PREFIX)
    }
    given: dict[str, Any] = {
        name: values[FIELD_PREFIX + name] for name in STATE_FIELDS if FIELD_PREFIX + name in values
    }
    return State(**{**given, "time": float(given["time"])}, memory=memory, laid=laid)


def _state(checkpoint: tuple[Variable, ...], series: Mapping[str, NDArray[Any]], laid: bool) -> State:
    """Return the state at the end of a run, from the checkpoint if there is one, otherwise from the last row."""
    if checkpoint:
        return state_of(checkpoint, laid)
    last = {name: series[name][-1] for name in ("joints", "directors", "bend", "joint_velocity", "contraction")}
    last["contraction"] = np.minimum(last["contraction"], GREATEST_CONTRACTION)
    return State(**last, time=float(series["time"][-1]))


def plain(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """Return a value as an object that JSON can represent. Larger arrays are appended to `arrays` instead."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.size <= 16:  # larger arrays are variables
            return {"array": value.tolist(), "type": value.dtype.str}
        arrays.append(value.astype(np.uint8) if value.dtype == bool else value)
        return {"array": len(arrays) - 1, "type": value.dtype.str}
    if isinstance(value, PathLike):
        return fspath(value)
    if isinstance(value, tuple | list):
        return [plain(each, arrays) for each in value]
    if is_dataclass(value) and (name := _name_of(type(value))):
        return {"class": name, **{each.name: plain(getattr(value, each.name), arrays) for each in fields(value)}}
    if isinstance(value, Part) and not isinstance(value, FrictionLaw):  # without its functions a law is Coulomb's
        return _of_own(value, arrays)
    return {"unknown": type(value).__qualname__}


def _of_own(value: Part, arrays: list[NDArray[Any]]) -> Any:
    """Return a description of a part of a user-defined class: its parameters, and the attributes a result needs."""
    kind = type(value)
    base: Any = next(each for each in kind.__mro__ if _name_of(each))
    return {
        "own": f"{kind.__module__}:{kind.__qualname__}",
        "base": _name_of(base),
        "told": {name: getattr(kind, name) for name in base.told},
        "given": {each.name: plain(getattr(value, each.name), arrays) for each in fields(value)},
    }


def _name_of(kind: type) -> str:
    """Return a name from which `_class_of` finds a class of worm3d, or an empty text for any other class."""
    import worm3d

    if getattr(worm3d, kind.__name__, None) is kind:
        return str(kind.__name__)
    return f"{kind.__module__}:{kind.__qualname__}" if kind.__module__.startswith("worm3d.") else ""


def restored(name: str, said: Any, arrays: list[NDArray[Any]]) -> Any:
    """Return the value that `plain` converted to `said`. Lists become tuples, and paths become text.

    Raises
    ------
    ValueError
        The value has a class outside worm3d. The message asks for the argument `name` of `worm3d.load` instead.
    """
    if isinstance(said, list):
        return tuple(restored(name, each, arrays) for each in said)
    if not isinstance(said, dict):
        return said
    if "own" in said:
        base = _class_of(said["base"])
        made = type(
            said["own"].rpartition(":")[2], (base,), {**said["told"], "__module__": said["own"].partition(":")[0]}
        )()
        for field, value in said["given"].items():
            object.__setattr__(made, field, restored(name, value, arrays))
        return made
    if "unknown" in said:
        raise ValueError(
            f"its {name} has a part of the class {said['unknown']}, which a file cannot hold: give it, "
            f"worm3d.load(path, {name}=...)"
        )
    if "array" in said:
        held = arrays[said["array"]] if isinstance(said["array"], int) else np.array(said["array"])
        return np.array(held, dtype=said["type"])
    kind = _class_of(said["class"])
    given = {each.name: restored(name, said[each.name], arrays) for each in fields(kind)}
    if all(each.init for each in fields(kind)):
        return kind(**given)
    made = object.__new__(kind)  # a computed field, such as a mesh's grid, is not computed again
    cast(Any, made).__setstate__(given)
    return made


def _class_of(name: str) -> Any:
    module, _, qualname = name.rpartition(":")
    if module and not module.startswith("worm3d."):
        raise ValueError(f"has a part of the class {name}, which is none of worm3d")
    kind = getattr(importlib.import_module(module or "worm3d"), qualname)
    if not (isinstance(kind, type) and is_dataclass(kind)):
        raise ValueError(f"has a part of the class {name}, which is no part of a worm or world")
    return kind
