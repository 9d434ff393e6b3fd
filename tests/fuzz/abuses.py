"""Every argument of the public constructors and functions, what kind of thing it is, and what it is not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import worm3d
from control import baselines
from control import gaits as gait
from control.gaits import steering
from control.sensing import sensors
from control.tracking import paths, references
from planar import linkage, published
from worm3d.values.parameters import Parameter, parameters_of

NAN, INF = float("nan"), float("inf")
NOTHING = (None, "1", "", True, 1j, (), [], {}, object(), NAN, b"1", 10**400, np.array([None]), np.array(["1"]))

WRONG: dict[str, tuple[Any, ...]] = {
    "number": (*NOTHING, INF, -INF, np.array([1.0, 2.0]), [1.0], 1e300, float, np.array(True)),
    "infinite": (*NOTHING, -INF, np.array([1.0, 2.0]), [1.0], 1e300, float),  # it may be infinite
    "positive": (*NOTHING, INF, 0.0, -1.0, 1e300, 1e-300, [1.0], np.array([1.0, 2.0]), float),
    "each": (None, "1", True, 1j, [], {}, object(), NAN, INF, [[1.0]], [1.0, [2.0]], ["1"], 1e300, [None], 10**400),
    "whole": (*NOTHING, 1.5, -1, 10**30, 2.0, [1], INF, np.array([1, 2]), int),
    "array": (None, "1", "abc", True, 1j, {}, object(), NAN, [NAN], [INF], [[[1.0]]], ["1"], [None], [1.0, [2.0]]),
    "flag": (None, 0, 1, "no", "True", NAN, [], 1j, object(), np.array([True, False])),
    "choice": (None, 3, NAN, "no such", "", ["left"], True, object(), b"left"),
    "object": (3, "x", NAN, [], {}, object(), True, 1j, float, b"x"),
    "function": (3, "x", NAN, [], {}, object(), True, float),
}
"""By the kind of an argument, what it must refuse."""


@dataclass(frozen=True)
class Target:
    """Something to call: its arguments as they should be, and what kind each is; "?" behind it: None will do."""

    make: Callable[..., Any]
    good: dict[str, Any]
    kinds: dict[str, str]


def _kinds(**groups: str) -> dict[str, str]:
    """Return the kind of each argument, of names by kind."""
    return {name: kind.rstrip("_") for kind, names in groups.items() for name in names.split()}


def _declared(part: type) -> dict[str, str]:
    """Return the kind of each parameter of a dataclass that declares them."""
    return {name: _kind(known) + "?" * known.optional for name, known in parameters_of(part).items()}


def _kind(known: Parameter) -> str:
    if known.each or known.choices or known.is_pair:
        return "each" if known.each else "choice" if known.choices else "array"
    if known.hint in (bool, int):
        return "flag" if known.hint is bool else "whole"
    return "infinite" if known.infinite else "positive" if known.bounds.get("gt") == 0 else "number"


WORM, PLANE = worm3d.Worm(), worm3d.Plane()
JOINTS = np.column_stack([np.linspace(0.0, 1.0, 7), np.zeros(7), np.full(7, 0.06)])
LINE = worm3d.Centreline.of([worm3d.Straight(2.0)])
HEIGHTS = np.zeros((5, 6))
LINKAGE = linkage.Linkage()
RUN = {"worm": WORM, "world": PLANE, "duration": 0.02}
SPEED = references.Constant(0.05)


def plain(t: float) -> worm3d.Command:
    return worm3d.Command(np.zeros((6, 2)))


def flat(t: float) -> np.ndarray:
    return np.zeros(6)


TARGETS: dict[str, Target] = {
    "Worm": Target(worm3d.Worm, {}, _declared(worm3d.Worm)),
    "Worm.planar": Target(
        worm3d.Worm.planar,
        {},
        _kinds(whole="segments", positive="length density depth", number="apex_mass_fraction drag")
        | {"half_height": "each?", "mass": "positive?", "k_spring": "each"},
    ),
    "Friction": Target(worm3d.Friction, {}, _declared(worm3d.Friction)),
    "Command": Target(
        worm3d.Command, {"contraction": np.zeros((6, 2))}, _kinds(array="contraction", each="hinge force")
    ),
    "State": Target(
        worm3d.State,
        {"joints": JOINTS},
        _kinds(array="joints", each="bend joint_velocity roll_rate bend_rate contraction", number="time")
        | {"directors": "array?"},
    ),
    "State.straight": Target(
        worm3d.State.straight,
        {"worm": WORM, "world": PLANE},
        _kinds(object="worm", array="position", number="azimuth", each="contraction") | {"world": "object?"},
    ),
    "Plane": Target(worm3d.Plane, {}, _kinds(number="slope heading") | {"patches": "tuple"}),
    "Patch": Target(worm3d.Patch, {"grip": 0.5}, _kinds(number="grip", array="along across")),
    "ClampedGround": Target(worm3d.ClampedGround, {}, _kinds(number="velocity_threshold")),
    "Straight": Target(worm3d.Straight, {"length": 1.0}, _kinds(positive="length")),
    "Bend": Target(worm3d.Bend, {"angle": 1.0, "radius": 1.0}, _kinds(positive="angle radius", choice="towards")),
    "Centreline.of": Target(
        worm3d.Centreline.of,
        {"pieces": [worm3d.Straight(1.0)]},
        _kinds(object="pieces", array="start", number="heading tilt"),
    ),
    "Centreline.through": Target(worm3d.Centreline.through, {"points": JOINTS}, _kinds(array="points", whole="spans")),
    "Profile": Target(
        worm3d.Profile,
        {"along": [0.0, 1.0], "radius": [0.1, 0.12]},
        _kinds(array="along radius") | {"rounding": "positive?"},
    ),
    "Pipe": Target(
        worm3d.Pipe,
        {"centreline": LINE, "radius": 0.12},
        _kinds(positive="radius", flag="start_wall end_wall") | {"patches": "tuple"},
    ),
    "Union": Target(worm3d.Union, {"worlds": [PLANE]}, _kinds(object="worlds")),
    "slope_into_pipe": Target(
        worm3d.slope_into_pipe,
        {"slope": 0.3, "mouth": 1.0, "pieces": [worm3d.Straight(1.0)], "radius": 0.12},
        _kinds(number="slope mouth tilt heading", object="pieces", positive="radius"),
    ),
    "Heightfield": Target(
        worm3d.Heightfield,
        {"heights": HEIGHTS, "spacing": 0.1},
        _kinds(array="heights origin", positive="spacing", each="grip"),
    ),
    "Heightfield.rubble": Target(
        worm3d.Heightfield.rubble,
        {"length": 1.0, "width": 1.0, "spacing": 0.1, "height": 0.02, "size": 0.2},
        _kinds(positive="length width spacing size", number="height", whole="seed"),
    ),
    "Heightfield.steps": Target(
        worm3d.Heightfield.steps,
        {"length": 1.0, "width": 1.0, "spacing": 0.1, "height": 0.02, "tread": 0.2, "ramp": 0.1},
        _kinds(positive="length width spacing tread ramp", number="height"),
    ),
    "Heightfield.sinusoid": Target(
        worm3d.Heightfield.sinusoid,
        {"length": 1.0, "width": 1.0, "spacing": 0.1, "amplitude": 0.02, "wavelength": 0.5},
        _kinds(positive="length width spacing wavelength", number="amplitude azimuth"),
    ),
    "Mesh": Target(
        worm3d.Mesh,
        {"path": "gone.stl", "units": "m"},
        _kinds(choice="solid up", array="position", number="grip") | {"cell": "positive?", "path": "path"},
    ),
    "simulate": Target(
        worm3d.simulate,
        RUN,
        _kinds(positive="duration dt tolerance", object="worm", choice="integrator", array="gravity")
        | _kinds(whole="record_every every")
        | {"world": "object?", "ground": "object?", "state": "object?", "actuation": "object?", "held": "held"}
        | {"external_force": "function?", "sensor": "function?", "settle_first": "flag?"}
        | {"observer": "function?", "live": "object?"},
    ),
    "simulate_batch": Target(
        worm3d.simulate_batch,
        {**RUN, "world": [PLANE]},
        _kinds(whole="threads record_every", positive="duration dt", object="worm"),
    ),
    "Live": Target(worm3d.Live, {}, _kinds(infinite="speed", flag="open_browser", function="began")),
    **{part.__name__: Target(part, {}, _declared(part)) for part in gait.GAITS.values()},
    "GaitParameters": Target(
        steering.GaitParameters,
        {"amplitude": 0.2, "frequency": 1.0},
        _kinds(number="amplitude bias hinge", positive="frequency"),
    ),
    "Schedule": Target(
        steering.Schedule,
        {},
        _kinds(positive="wavelength steering_wavelength", number="bias_phase hinge_phase lead", choice="direction"),
    ),
    "SteeredWave": Target(
        steering.SteeredWave,
        {"parameters": steering.GaitParameters(0.2, 1.0)},
        _kinds(object="parameters schedule", positive="blend"),
    ),
    "WaveGenerator": Target(
        steering.WaveGenerator,
        {"schedule": steering.Schedule(), "body": WORM},
        _kinds(object="schedule body", positive="blend"),
    ),
    "Channel": Target(sensors.Channel, {"noise": 0.1}, _kinds(number="noise bias delay dropout", infinite="rate")),
    "Sensors": Target(
        sensors.Sensors,
        {},
        _kinds(whole="seed", flag="mirrored") | dict.fromkeys(("strain", "com", "heading"), "object?"),
    ),
    "Line": Target(paths.Line, {}, _kinds(array="start", number="azimuth", infinite="length")),
    "Circle": Target(
        paths.Circle, {"radius": 1.0}, _kinds(array="start", number="azimuth", positive="radius", choice="towards")
    ),
    "SCurve": Target(
        paths.SCurve,
        {},
        _kinds(array="start", number="azimuth", positive="amplitude wavelength waves", choice="towards"),
    ),
    "SplinePath": Target(paths.SplinePath, {"points": JOINTS[:, :2]}, _kinds(array="points", flag="closed")),
    "WayPoints": Target(
        paths.WayPoints, {"points": [[0, 0], [5, 0], [5, 5]]}, _kinds(array="points", positive="radius")
    ),
    "PlanView": Target(paths.PlanView, {"centreline": LINE}, _kinds(object="centreline")),
    "Constant": Target(references.Constant, {"value": 0.1}, _kinds(number="value")),
    "Steps": Target(
        references.Steps,
        {"first": 0.1, "times": (1.0,), "values": (0.2,)},
        _kinds(number="first", array="times values"),
    ),
    "Sine": Target(
        references.Sine,
        {"mean": 0.1, "amplitude": 0.1, "period": 1.0},
        _kinds(number="mean amplitude", positive="period"),
    ),
    "Reference": Target(
        references.Reference,
        {"speed": SPEED},
        _kinds(function="speed") | {"heading": "function?", "path": "object?"},
    ),
    "Gains": Target(baselines.Gains, {}, _kinds(number="speed speed_integral heading", positive="reach")),
    "published.Parameters": Target(
        published.Parameters,
        {},
        _kinds(positive="length k_spring k_link mass connector_mass wavelength tolerance")
        | _kinds(number="gravity mu_forward velocity_threshold contraction_force ground_clearance elastic_sign")
        | _kinds(whole="max_iterations", choice="normal_load", flag="snap rectified"),
    ),
    "published.simulate": Target(
        published.simulate,
        {"steps": 2},
        _kinds(whole="n steps", positive="T_wave dt") | {"activation": "function?", "parameters": "object?"},
    ),
    "Linkage": Target(
        linkage.Linkage,
        {},
        _kinds(whole="segments", positive="length density depth", number="apex_mass_fraction kelvin_voigt_time drag")
        | _kinds(each="k_spring k_torsion cross0 k_apex")
        | {"half_height": "each?", "mass": "positive?", "segment": "path"},
    ),
    "linkage.Friction": Target(linkage.Friction, {}, _kinds(each="forward backward", positive="static_ratio")),
    "linkage.simulate": Target(
        linkage.simulate,
        {"worm": LINKAGE, "gait": flat, "duration": 0.02},
        _kinds(object="worm", function="gait", positive="duration dt", choice="ground friction_law")
        | _kinds(number="gravity slope velocity_threshold")
        | {"settle": "flag?"}
        | {"friction": "object?", "external_force": "function?", "start": "array?", "observer": "function?"},
    ),
}

WRONG["path"] = (None, 3, NAN, object(), [], True)
WRONG["tuple"] = (3, "x", NAN, None, [3], {}, object(), True, 1j, float, (PLANE,))
WRONG["held"] = ("x", 3, NAN, object(), [0], [[True], [True, False]])


def cases() -> Iterator[tuple[str, str, Any]]:
    """Yield each target, argument and wrong value of it."""
    for name, target in TARGETS.items():
        for argument, kind in target.kinds.items():
            for value in WRONG[kind.rstrip("?")]:
                if not (value is None and kind.endswith("?")):
                    yield name, argument, value
