"""Gaits: open-loop patterns of contraction, and the waves that controllers drive."""

from control.gaits.patterns import (
    Body,
    BoundGait,
    ContractionEngine_segmentdriven,
    Direction,
    Gait,
    Pulse,
    TravellingWave,
    WaveDirection,
)

__all__ = [
    "BoundGait",
    "Body",
    "ContractionEngine_segmentdriven",
    "Direction",
    "Gait",
    "Pulse",
    "TravellingWave",
    "WaveDirection",
]
