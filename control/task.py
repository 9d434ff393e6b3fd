"""Task of a controller: worm, reference, identified map, mechanism, control period and sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from control.gaits.steering import Mechanism
from control.identification.identified import Identified, SteeringMap
from control.sensing.sensors import Channel
from control.tracking.detour import Body
from control.tracking.guide import led
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values import arguments
from worm3d.values.spelling import Spelled


@dataclass(frozen=True, eq=False)
class ControlTask(Spelled):
    """Everything that a controller is built from.

    Raises
    ------
    ValueError
        A field of another type, a mechanism that was not identified, a period that is not above 0, or obstacles that
        leave no way.
    """

    worm: Worm
    reference: Reference
    """Reference of the worm; the path leads around the obstacles that are known from the start."""
    map: Identified
    """Identified map of the waves of the worm."""
    mechanism: Mechanism = "hinge"
    """Mechanism that steers, one of those in the map."""
    period: float = 0.2
    """Time between two decisions [s]."""
    sensors: Mapping[str, Channel] = field(default_factory=dict)
    """Quality of the sensors by name, as in `control.sensing.sensors.Sensors.channels`; default quality if left out."""

    def __post_init__(self) -> None:
        arguments.instance("worm", self.worm, Worm, "a worm: worm3d.Worm()")
        arguments.instance("reference", self.reference, Reference, "a control.tracking.references.Reference")
        arguments.instance("map", self.map, Identified, "a map: control.identification.identified.load(worm)")
        arguments.instance("sensors", self.sensors, Mapping, "channels by name: Sensors().channels")
        arguments.number("period", self.period, "s", gt=0.0)
        if self.mechanism not in self.map.maps:
            known = ", ".join(map(repr, self.map.maps))
            raise ValueError(f"mechanism: got {self.mechanism!r}, must be one of the identified mechanisms: {known}")
        object.__setattr__(self, "reference", led(self.reference, Body.of(self.worm)))

    @property
    def found(self) -> SteeringMap:
        """The map of the mechanism that steers."""
        return self.map.maps[self.mechanism]

    def fields(self) -> tuple[Any, ...]:
        """Return the values of all fields in order, for a controller that takes the fields as separate arguments."""
        return tuple(getattr(self, each.name) for each in fields(self))
