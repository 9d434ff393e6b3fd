"""Gaits: open-loop patterns of contraction, and the waves that controllers drive."""

from control.gaits.extension_wave import ExtensionWave
from control.gaits.gait import GAITS, Body, BoundGait, Direction, Gait
from control.gaits.patterns import (
    Breathing,
    ContractionEngine_segmentdriven,
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
