"""A run of the 3D worm as variables of a record, and its checkpoint, both ways."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import worm3d
from scenes.records.record import Record, Variable

SERIES = (
    ("time", "", "s", "time"),
    ("joints", "joint axis", "m", "joints, from tail to head"),
    ("joint_velocity", "joint axis", "m/s", "their velocity"),
    (
        "points",
        "segment point axis",
        "m",
        "apexes L-below, -above, -outward, R-below, -above, -outward; tail, head face",
    ),
    ("directors", "segment axis", "1", "unit vector to the left of each segment"),
    ("bend", "segment", "rad", "chamber bend: the left chamber is offset x bend shorter than the segment"),
    ("chamber_length", "segment chamber", "m", "length of each chamber [left, right]"),
    ("command", "segment chamber", "1", "contraction asked of each chamber [left, right], within its stroke"),
    ("contraction", "segment chamber", "1", "contraction given by the actuators, after lag and limits"),
    ("hinge", "inner_joint", "rad", "hinge angle given at joints 1 to N-1"),
    ("force", "segment chamber", "N", "extra force of each chamber [left, right] given by the actuators"),
    ("com", "axis", "m", "centre of mass of joints and apexes"),
    ("com_velocity", "axis", "m/s", "its velocity"),
    ("momentum", "axis", "kg m/s", "momentum"),
    ("angular_momentum", "axis", "kg m^2/s", "angular momentum about the origin"),
    ("heading", "", "rad", "azimuth of the tail-to-head chord, unwrapped; NaN where it is vertical"),
    ("normal_load", "segment apex", "N", "normal load of each apex"),
    ("slip", "segment apex", "m", "metres slid by each apex since the row before"),
    ("joint_load", "joint", "N", "normal load of end faces and inner joints; clamped: of each joint, (P9)"),
    ("joint_slip", "joint", "m", "metres slid by them since the row before"),
    ("contact_force", "segment point axis", "N", "force of the world on each point: normal load and friction"),
    ("joint_friction", "joint axis", "N", "friction (P10) on each joint of the clamped worm"),
    ("anchors", "segment point axis", "m", "where the contacts stick"),
)
"""Of each stored instant: name in the result, dimensions after time, unit, meaning."""

ENERGIES = {
    "work_contract": "work of the actuators",
    "work_external": "work of external forces",
    "load_change": "anchor energy changed by normal loads and turning tangents",
    "kinetic": "change of kinetic energy",
    "elastic": "change of elastic energy",
    "potential": "change of potential energy of the weight",
    "penetration": "change of energy of the normal contact",
    "anchor": "change of energy of the friction's anchors",
    "friction_loss": "loss to friction",
    "viscous_loss": "loss to Kelvin-Voigt damping, medium and friction's dampers",
    "impact": "loss to impacts on the world",
    "numerical_loss": "numerical loss of the integrator",
    "drag_loss": "part of the viscous loss: to the medium",
    "work_contract_positive": "positive part of the work of the actuators",
    "work_contract_p11": "work F.dq of the contraction force, (P11)",
    "work_friction_p13": "work F.dq of the friction force, (P13)",
}
"""Terms of the ledger, each since the row before."""

COUNTERS = {
    "newton_iterations": "evaluations with a new Jacobian, whole or in part",
    "gradient_evaluations": "further evaluations of the residual",
    "breakaways": "rounds of contacts that broke away",
    "fallbacks": "falls back from Newton's direction to descent",
}
"""Of each step."""

DERIVED = ("com_velocity", "heading")
"""Series that the result computes from others."""

STATE = {
    "joints": "m",
    "directors": "1",
    "bend": "rad",
    "joint_velocity": "m/s",
    "roll_rate": "rad/s",
    "bend_rate": "rad/s",
    "time": "s",
}
"""Fields of a state, and their units."""

FIELD, MEMORY = "state_", "memory_"
"""What a checkpoint puts before the name of a state's field, and of an array of its memory."""


def variables_of(result: worm3d.Result) -> tuple[Variable, ...]:
    """Return a run as variables."""
    energy, steps = result.energy, len(result.newton_iterations)
    ends = result.dt * np.arange(1, steps + 1)
    return (
        *(
            Variable(name, ("time", *dims.split()), getattr(result, name), unit, meaning)
            for name, dims, unit, meaning in SERIES
        ),
        *(Variable(name, ("time",), getattr(energy, name), "J", meaning) for name, meaning in ENERGIES.items()),
        Variable("residual", ("time",), energy.residual, "J", "what comes in less what is stored or lost"),
        Variable("step_time", ("step",), ends, "s", "end of each time step"),
        *(Variable(name, ("step",), getattr(result, name), "1", meaning) for name, meaning in COUNTERS.items()),
        Variable("halved_steps", (), result.halved_steps, "1", "steps that were taken in parts"),
        Variable(
            "settling", (), _number(result.settling), "m", "way to rest before the run; NaN: was not brought to it"
        ),
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def missing(earlier: Record) -> list[str]:
    """Return what a record lacks to be gone on from: it was made by another version of the program."""
    known = {variable.name for variable in (*earlier.variables, *earlier.checkpoint)}
    needed = (
        *(name for name, *_ in SERIES),
        *ENERGIES,
        *COUNTERS,
        "halved_steps",
        "settling",
        *(FIELD + name for name in STATE),
    )
    return [name for name in needed if name not in known]


def joined(earlier: Record, rest: worm3d.Result) -> worm3d.Result:
    """Return the run of which a record is the first part and a result the rest: it was begun at the record's end."""

    def whole(name: str, tail: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([earlier[name], tail])

    series: dict[str, Any] = {name: whole(name, getattr(rest, name)[1:]) for name, *_ in SERIES if name not in DERIVED}
    counters: dict[str, Any] = {name: whole(name, getattr(rest, name)) for name in COUNTERS}
    energy = worm3d.Energy(**{name: whole(name, getattr(rest.energy, name)[1:]) for name in ENERGIES})
    wall_s = next(float(v.values) for v in earlier.timing if v.name == "wall_s")
    return replace(
        rest,
        **series,
        **counters,
        energy=energy,
        halved_steps=int(earlier["halved_steps"]) + rest.halved_steps,
        settling=None if np.isnan(earlier["settling"]) else float(earlier["settling"]),
        stop=replace(rest.stop, step=rest.stop.step + earlier.sizes["step"]),
        wall_s=wall_s + rest.wall_s,
    )


def checkpoint_of(state: worm3d.State) -> tuple[Variable, ...]:
    """Return a state with its memory as variables."""
    arrays = {FIELD + name: (getattr(state, name), unit, f"{name} at the end") for name, unit in STATE.items()}
    for name, array in state.memory.items():
        arrays[MEMORY + name] = (array, "SI", f"what the next step depends on: {name}, in the solver's layout")
    return tuple(
        Variable(name, tuple(f"size_{n}" for n in np.shape(array)), array, unit, meaning)
        for name, (array, unit, meaning) in arrays.items()
    )


def state_of(record: Record) -> worm3d.State:
    """Return the state of a record's checkpoint."""
    values = {variable.name: variable.values for variable in record.checkpoint}
    memory = {name.removeprefix(MEMORY): array for name, array in values.items() if name.startswith(MEMORY)}
    given: dict[str, Any] = {name: values[FIELD + name] for name in STATE}
    return worm3d.State(**{**given, "time": float(given["time"])}, memory=memory)
