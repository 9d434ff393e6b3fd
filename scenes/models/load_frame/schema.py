"""Scene of a load frame: a segment of the 3D worm, the friction in its joints, and the motion of the hoop cable."""

from __future__ import annotations

from typing import Literal

from scenes.language.parts import PartSection, keys_of
from scenes.language.schema import Section, setting
from scenes.models.sections import BODY_BOUNDS, Settings
from scenes.models.worm.schema import Hysteresis, Segment
from worm3d.physics.worm import Worm as PlantWorm

NO_FILE = "none"

OF_A_SEGMENT = ("length", "half_height", "k_spring", "k_apex", "kelvin_voigt_time")
"""Parameters of the worm that affect a single segment."""


class Worm(PartSection, keys=keys_of(PlantWorm, these=OF_A_SEGMENT, bounds=BODY_BOUNDS)):
    """The worm, with one segment: the keys have the same meaning as in a whole worm."""


class Frame(Section):
    """Motion of the hoop cable around the segment: from a file, or in and out at a constant speed."""

    file: str = setting(
        NO_FILE,
        meaning="a CSV file with the columns time_s and cable_mm (or cable_m): beside the scene, shipped, or a path",
        is_file=True,
        aka=("record", "path"),
    )
    cable_m: float = setting(0.1, unit="m", gt=0, meaning="without a file: most cable that is taken in")
    speed_m_s: float = setting(0.01, unit="m/s", gt=0, meaning="without a file: speed of the cable, out and back")
    cable_per_diameter: float = setting(
        3.0,
        gt=0,
        meaning="cable taken in over the change of the diameter, which is twice the half-height: 3 around a hexagon, "
        "3.1416 around a circle",
    )


class LoadFrameScene(Settings):
    """A whole scene."""

    model: Literal["load_frame"] = setting(meaning="which simulation the scene is for")
    worm: Worm = Worm()
    hysteresis: Hysteresis = Hysteresis()
    segment: Segment = Segment()
    frame: Frame = Frame()
