"""Gaits: open-loop patterns of contraction, and the waves that controllers drive."""

from control.gaits.extension_wave import ExtensionWave
from control.gaits.patterns import (
    GAITS,
    Body,
    BoundGait,
    Breathing,
    ContractionEngine_segmentdriven,
    Direction,
    Gait,
    Pulse,
    TravellingWave,
    TwoAnchor,
    WaveDirection,
)

__all__ = [
    "GAITS",
    "BoundGait",
    "Breathing",
    "Body",
    "ContractionEngine_segmentdriven",
    "Direction",
    "ExtensionWave",
    "Gait",
    "Pulse",
    "TravellingWave",
    "TwoAnchor",
    "WaveDirection",
]
