"""Task of a controller, a collection of everything that a controller is built from."""

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
    """Worm, reference, identified map, steering mechanism, control period and sensors of a controller.

    Raises
    ------
    ValueError
        A field has the wrong type, the mechanism was not identified, the period is not above 0, or the obstacles leave
        no way for the worm.
    """

    worm: Worm
    reference: Reference
    """Reference of the worm. Its path is replaced by a path around the obstacles that are known from the start."""
    map: Identified
    """Identified map of the worm: speed and turn rate of its waves."""
    mechanism: Mechanism = "hinge"
    """Mechanism that steers, a key of `map.maps`."""
    period: float = 0.2
    """Time between two decisions [s]."""
    sensors: Mapping[str, Channel] = field(default_factory=dict)
    """Quality of the sensors by name, as in `control.sensing.sensors.Sensors.channels`. Missing sensors have the
    default quality."""

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
        """Identified map of the mechanism that steers."""
        return self.map.maps[self.mechanism]

    def fields(self) -> tuple[Any, ...]:
        """Return the values of all fields in order, for a controller that takes the fields as separate arguments."""
        return tuple(getattr(self, each.name) for each in fields(self))
