"""Comparisons of robots with published speeds, where the model has the same kind of actuators as the robot.

The actuators come from `worm3d.physics.technologies` and have their default sizes. The period is chosen so that the
model is fastest. The scene of each robot lists the published values and the assumptions.
`scenes.studies.validate.robots` explains the method.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenes.studies.validate.comparison import Comparison, Source, chapter, within
from scenes.studies.validate.measures import Changes, Figure, StoppedError
from scenes.studies.validate.robots import CMMWORM, GROUNDS, SOFT_TO_STIFF

BRAID_TABLE = Source("the table of robots of Active Braid Crawler's authors", "R2", "robot")
FACTORS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.085, 0.06, 0.042, 0.03, 0.021)
"""Periods in the order of the search, as multiples of the scene's period. The search ends when two consecutive periods
are slower than an earlier period. A single slower period is not enough, because it may be a local minimum of the
speed."""
STRONG = ("actuator.reserve=10", "actuator.room=0.3")
"""Changes for actuators with five times the default force."""
FASTER_COILS = ("actuator.rise_s=0.17", "actuator.fall_s=0.67")
SLOWER_COILS = ("actuator.rise_s=0.34", "actuator.fall_s=1.7")
"""Changes for coils with the shortest and the longest times that are published for a coil of 2 mm. To reach 90 %, they
take 0.5 s to warm up and 2 s to cool, or 1 s and 5 s."""


@dataclass(frozen=True)
class Fastest:
    """Measure: the highest speed of a scene over the period of its gait [BL/s]."""

    scene: str
    period: float
    """Period of the scene's gait [s]."""

    def __call__(self, changes: Changes = ()) -> float:
        """Run the scene at several periods, with further changes, and return the highest speed.

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
        "The robot also has coils along the body, which shorten the segments that the coils around the body have made "
        "longer. In the model, the springs of the mesh shorten these segments. Assumed: mass, friction, springs, coils "
        "of the default size (or five times as strong), times of the coils, moving segments.",
        unit="BL/s",
        unknown=(STRONG, FASTER_COILS, SLOWER_COILS, (*STRONG, *FASTER_COILS), *GROUNDS, ("gait.moving=0.6",)),
    ),
    Comparison(
        "Origami worm, coils of NiTi: fastest",
        Fastest("origami_worm", 10.0),
        0.0031,
        within(2.0, 0.0031),
        BRAID_TABLE,
        "The published speed may not be the highest speed of the robot; the gait and the times of the coils are not "
        "published. A coil that is strong enough for the model is thin, 0.7 mm, and therefore fast. Assumed: "
        "amplitude and times of the coils, which have the largest effect, friction, springs, number of segments.",
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
"""Function that runs the comparisons and yields their rows one by one. With `quick`, the spreads are left out."""
