"""Kinds of parts that scenes accept as `module:NAME`, and the decorator that marks a user's part.

Subclasses of the base class of a kind count as marked. Other classes must be marked with the decorator, for example a
controller that shares nothing with the supplied controllers:

    @part("controller")
    class Mine:
        @classmethod
        def of(cls, task): ...

A scene calls only parts that are marked with the kind that the key expects. A section of a scene that `holds` a kind
(`scenes.language.parts.PartSection`) takes parts of this kind by a key, by a list, or as sub-sections. To add a kind,
add a row to this file. The schema, `worm3d init`, `worm3d list`, error messages, saving and loading all use this row.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Any, TypeVar

from worm3d.values.named import Kind, marked

T = TypeVar("T", bound=Callable[..., Any])

GAIT = Kind("gait", "a gait", "control.gaits", "Gait", table="GAITS")
REFLEX = Kind("reflex", "a reflex", "control.gaits", "Reflex", table="REFLEXES")
FAULT = Kind("fault", "a fault", "control.faults.injected", "Injected", table="INJECTED")
CHANNEL = Kind("channel", "a channel of sensors", "control.sensing.sensors", "Quantity", table="QUANTITIES")
WORLD = Kind("world", "a world", "worm3d.worlds", "World", table="WORLDS")
ACTUATOR = Kind("actuator", "an actuator", "worm3d.physics.actuator_names", "Actuator", table="ACTUATORS")
HYSTERESIS = Kind("hysteresis", "a friction of joints", "worm3d.physics.hysteresis", "Hysteresis", table="HYSTERESES")
MEDIUM_KIND = Kind("medium", "a medium", "worm3d.physics.media", "Medium", table="MEDIA")
SEGMENT_KIND = Kind("segment", "a segment law", "worm3d.physics.segment_law_names", "SegmentLaw", table="SEGMENT_LAWS")
LOAD_KIND = Kind("load", "a load", "worm3d.physics.loads", "Load", table="LOADS")
LAW_KIND = Kind("law", "a law of friction", "worm3d.physics.friction_laws", "FrictionLaw", table="LAWS")
MEASURE = Kind("measure", "a measure", "worm3d.measures", "Measure", table="MEASURES")
CONTROLLER = Kind("controller", "a controller", "control.loop", "WaveController", form="of(task)")
ESTIMATOR = Kind(
    "estimator",
    "an estimator",
    "control.estimation.estimator",
    "Estimator",
    form="for_sensors(worm, model, schedule, sensors)",
)
MODEL_KIND = Kind(
    "model", "a model", "control.estimation.reduced", "ReducedModel", form="of(worm, identified, mechanism)"
)
TERM = Kind("term", "a term of the cost", "control.planning.terms", "CostTerm", table="TERMS")
CONSTRAINT = Kind("constraint", "a constraint", "control.planning.constraints", "Constraint", table="CONSTRAINTS")
PATH_KIND = Kind("path", "a path", "control.tracking.paths", "Path")
OBSTACLE = Kind("obstacle", "an obstacle", "control.tracking.obstacles", "Obstacle", table="OBSTACLES")
OF_THE_PLANT = (GAIT, REFLEX, WORLD, ACTUATOR, HYSTERESIS, MEDIUM_KIND, SEGMENT_KIND, LOAD_KIND, LAW_KIND, MEASURE)
OF_CONTROL = (FAULT, CHANNEL, CONTROLLER, ESTIMATOR, MODEL_KIND, TERM, CONSTRAINT, PATH_KIND, OBSTACLE)
PART_KINDS = MappingProxyType({kind.name: kind for kind in (*OF_THE_PLANT, *OF_CONTROL)})
"""All kinds of parts by name."""


def part(kind: str) -> Callable[[T], T]:
    """Return a decorator that marks a class as a part of a kind, or a function that returns an object of this kind."""
    if not isinstance(kind, str) or kind not in PART_KINDS:
        known = ", ".join(map(repr, PART_KINDS))
        raise ValueError(f"part: got {getattr(kind, '__name__', kind)!r}, must be one of {known}: @part('controller')")
    return lambda given: marked(kind, given)
