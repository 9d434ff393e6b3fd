"""Gaits: patterns of contraction, with memory and senses or without, and the waves that controllers drive."""

from typing import Any

from control.gaits.anchoring import Inchworm, TwoAnchor
from control.gaits.discrete import Discrete
from control.gaits.extension_wave import ExtensionWave
from control.gaits.feedback import Feedback, FeedbackGait, Felt, Memory
from control.gaits.gait import GAITS, Body, BoundGait, Direction, Gait
from control.gaits.larva_ei.gait import LarvaEI
from control.gaits.neural.chain import EiChain
from control.gaits.patterns import (
    Breathing,
    ContractionEngine_segmentdriven,
    Pulse,
    TravellingWave,
    WaveDirection,
)
from control.gaits.periodic import Periodic, Spline
from control.gaits.planned_turn import PlannedTurn
from control.gaits.reflexes import REFLEXES, Reach, Reflex, Wait, WallLoad
from control.gaits.reflexive import Reflexive
from control.gaits.shc.gait import SHC
from control.gaits.steered import Steered
from worm3d.values.spelling import no_attribute

__all__ = [
    "Body",
    "BoundGait",
    "Breathing",
    "ContractionEngine_segmentdriven",
    "Direction",
    "Discrete",
    "EiChain",
    "ExtensionWave",
    "Feedback",
    "FeedbackGait",
    "Felt",
    "GAITS",
    "Gait",
    "Inchworm",
    "LarvaEI",
    "Memory",
    "Periodic",
    "PlannedTurn",
    "Pulse",
    "REFLEXES",
    "Reach",
    "Reflex",
    "Reflexive",
    "SHC",
    "Spline",
    "Steered",
    "TravellingWave",
    "TwoAnchor",
    "Wait",
    "WallLoad",
    "WaveDirection",
]


def __getattr__(name: str) -> Any:
    raise no_attribute(__name__, name, __all__, ("control.sensing", "control.gaits.steering"))
