"""Robots with the actuators that they are built with, at their fastest period, beside published speeds.

The actuators come from `worm3d.physics.technologies`, with their default sizes. The scene of each robot lists the
published values and the assumptions. `scenes.studies.validate.robots` explains the rows.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenes.studies.validate.comparison import Comparison, Source, chapter, within
from scenes.studies.validate.measures import Changes, Figure, StoppedError
from scenes.studies.validate.robots import CMMWORM, GROUNDS, SOFT_TO_STIFF

BRAID_TABLE = Source("the table of robots of Active Braid Crawler's authors", "R2", "robot")
FACTORS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.085, 0.06, 0.042, 0.03, 0.021)
"""Periods of the search over the scene's period, in turn, until two in a row are slower than the fastest.

One slower period may be a dip.
"""
STRONG = ("actuator.reserve=10", "actuator.room=0.3")
"""Actuators with five times the default force."""
FASTER_COILS = ("actuator.rise_s=0.17", "actuator.fall_s=0.67")
SLOWER_COILS = ("actuator.rise_s=0.34", "actuator.fall_s=1.7")
"""Coils with the extreme times that are published for a coil of 2 mm: 0.5 and 2 s, or 1 and 5 s, to 90 %."""


@dataclass(frozen=True)
class Fastest:
    """Largest speed of a scene over increasingly short periods of the gait [BL/s]."""

    scene: str
    period: float
    """Period of the scene's gait [s]."""

    def __call__(self, changes: Changes = ()) -> float:
        """Return the speed, with further changes of the scene.

        Raises
        ------
        StoppedError
            None of the runs finished.
        """
        found, why = list[float](), ""
        for factor in FACTORS:
            if len(found) > 2 and max(found) not in found[-2:]:
                break
            period = factor * self.period
            told = (f"gait.period_s={period!r}", f"run.duration_s={8 * period!r}", f"run.dt_s={period / 400.0!r}")
            try:
                found.append(Figure("speed_BL_s", self.scene, told)(changes))
            except StoppedError as stopped:
                why = str(stopped)
        if not found:
            raise StoppedError(why)
        return max(found)


POWERED_COMPARISONS = (
    Comparison(
        "CMMWorm, servos and cables: fastest",
        Fastest("cmmworm_cable", 10.2),
        0.0036,
        within(2.0, 0.0036),
        CMMWORM,
        "Assumed: friction 0.4 (0.2 to 0.8), springs of 100 N (50 to 5000), two moving segments (or three). The joints "
        "of the mesh do not rub here.",
        unit="BL/s",
        unknown=(*SOFT_TO_STIFF, *GROUNDS, ("gait.moving=0.5",)),
    ),
    Comparison(
        "Meshworm, coils of NiTi: fastest",
        Fastest("meshworm", 10.0),
        0.017,
        within(2.0, 0.017),
        BRAID_TABLE,
        "Missing in the model: the coils along the body, which pull back what those around it have squeezed long; here "
        "the mesh's springs do. Assumed: mass, friction, springs, coils of the default size (or five times as strong), "
        "times of the coils, moving segments.",
        unit="BL/s",
        unknown=(STRONG, FASTER_COILS, SLOWER_COILS, (*STRONG, *FASTER_COILS), *GROUNDS, ("gait.moving=0.6",)),
    ),
    Comparison(
        "Origami worm, coils of NiTi: fastest",
        Fastest("origami_worm", 10.0),
        0.0031,
        within(2.0, 0.0031),
        BRAID_TABLE,
        "The published speed may not be the fastest: its gait and its times are not known. The coil that is strong "
        "enough for the model is thin, 0.7 mm, and so it is fast. Assumed: amplitude and times of the coils, which "
        "decide most, friction, springs, number of segments.",
        unit="BL/s",
        unknown=(
            SLOWER_COILS,
            FASTER_COILS,
            ("gait.amplitude=0.2",),
            ("worm.segments=4",),
            ("friction.forward=0.3",),
            ("worm.spring_N=3.0",),
            ("gait.amplitude=0.2", "friction.forward=0.3", *SLOWER_COILS),
        ),
    ),
)

rows = chapter(POWERED_COMPARISONS)
"""Function that yields each row as soon as the row is known; its argument `quick` leaves out the spreads."""
