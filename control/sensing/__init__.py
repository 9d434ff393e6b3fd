"""Sensors, their measurements, and the gate that refuses impossible measurements."""

from typing import Any

from control.sensing.gate import Gate
from control.sensing.sensors import QUANTITIES, Channel, Measurement, Quantity, Sample, Sensors
from worm3d.values.spelling import no_attribute

__all__ = ["QUANTITIES", "Channel", "Gate", "Measurement", "Quantity", "Sample", "Sensors"]


def __getattr__(name: str) -> Any:
    raise no_attribute(__name__, name, __all__)
