"""Gaits: open-loop patterns of contraction, and the waves that controllers drive."""

from control.gaits.crawlers import Breathing, TwoAnchor
from control.gaits.patterns import (
    GAITS,
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
    "GAITS",
    "BoundGait",
    "Breathing",
    "Body",
    "ContractionEngine_segmentdriven",
    "Direction",
    "Gait",
    "Pulse",
    "TravellingWave",
    "TwoAnchor",
    "WaveDirection",
]
