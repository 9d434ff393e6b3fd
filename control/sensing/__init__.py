"""Sensors, the measurements that they make, and the gate that refuses what cannot be a measurement."""

from control.sensing.gate import Gate
from control.sensing.sensors import QUANTITIES, Channel, Measurement, Quantity, Sample, Sensors

__all__ = ["QUANTITIES", "Channel", "Gate", "Measurement", "Quantity", "Sample", "Sensors"]
