"""Sensors, the measurements that they make, and the gate that refuses what cannot be a measurement."""

from control.sensing.channels import QUANTITIES, Channel, Quantity
from control.sensing.gate import Gate
from control.sensing.sensors import Measurement, Sample, Sensors

__all__ = ["QUANTITIES", "Channel", "Gate", "Measurement", "Quantity", "Sample", "Sensors"]
