"""The segment laws that come with worm3d, and the base class of new segment laws."""

from worm3d.physics.segment_laws.law import SEGMENT_LAWS, SegmentLaw, Spring
from worm3d.physics.segment_laws.learned import Learned
from worm3d.physics.segment_laws.shapes import Hydrostat, Rhombus

__all__ = ["SEGMENT_LAWS", "Hydrostat", "Learned", "Rhombus", "SegmentLaw", "Spring"]
