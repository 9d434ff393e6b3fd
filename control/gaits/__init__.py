"""Gaits: patterns of contraction, with memory and senses or without, and the waves that controllers drive."""

from control.gaits.extension_wave import ExtensionWave
from control.gaits.feedback import Feedback, FeedbackGait, Felt, Memory
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
    "Feedback",
    "FeedbackGait",
    "Felt",
    "Gait",
    "Memory",
    "Pulse",
    "TravellingWave",
    "TwoAnchor",
    "WaveDirection",
]
