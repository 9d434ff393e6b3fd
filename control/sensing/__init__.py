"""Sensors, the measurements that they make, and the gate that refuses what cannot be a measurement."""
