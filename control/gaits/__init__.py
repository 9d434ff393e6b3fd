"""Gaits: patterns of contraction over time, with or without sensors, and the waves that controllers steer."""

from typing import Any

from control.gaits.anchoring import Inchworm as Inchworm
from control.gaits.anchoring import TwoAnchor as TwoAnchor
from control.gaits.discrete import Discrete as Discrete
from control.gaits.extension_wave import ExtensionWave as ExtensionWave
from control.gaits.feedback import Feedback as Feedback
from control.gaits.feedback import FeedbackGait as FeedbackGait
from control.gaits.feedback import Felt as Felt
from control.gaits.feedback import Memory as Memory
from control.gaits.gait import GAITS as GAITS
from control.gaits.gait import Body as Body
from control.gaits.gait import BoundGait as BoundGait
from control.gaits.gait import Direction as Direction
from control.gaits.gait import Gait as Gait
from control.gaits.larva_ei.gait import LarvaEI as LarvaEI
from control.gaits.neural.chain import EiChain as EiChain
from control.gaits.patterns import Breathing as Breathing
from control.gaits.patterns import ContractionEngine_segmentdriven as ContractionEngine_segmentdriven
from control.gaits.patterns import Pulse as Pulse
from control.gaits.patterns import TravellingWave as TravellingWave
from control.gaits.patterns import WaveDirection as WaveDirection
from control.gaits.periodic import Periodic as Periodic
from control.gaits.periodic import Spline as Spline
from control.gaits.planned_turn import PlannedTurn as PlannedTurn
from control.gaits.recorded import RecordedCommands as RecordedCommands
from control.gaits.reflexes import REFLEXES as REFLEXES
from control.gaits.reflexes import Reach as Reach
from control.gaits.reflexes import Reflex as Reflex
from control.gaits.reflexes import Wait as Wait
from control.gaits.reflexes import WallLoad as WallLoad
from control.gaits.reflexive import Reflexive as Reflexive
from control.gaits.shc.gait import SHC as SHC
from control.gaits.steered import Steered as Steered
from worm3d.values.spelling import no_attribute

__all__ = [name for name in globals() if name[0].isupper() and name != "Any"]


def __getattr__(name: str) -> Any:
    raise no_attribute(__name__, name, __all__, ("control.sensing", "control.gaits.steering"))
