"""Comparisons of simulated robots with published numbers.

Sizes, masses and gaits come from the sources. Quantities that the sources do not give are assumed in the scene and
named in the note of the comparison. The fields `unknown` and `others` have other values of these quantities, and the
report gives the spread of the model's number over all these values. No value was chosen to make a comparison agree,
with one exception: the segment law and the friction of the segment in the load frame were fitted to the measured
record. The comparisons with this record are therefore marked as fitted and do not count.
"""

from __future__ import annotations

from scenes.studies.validate.comparison import (
    ABOVE_1,
    BELOW_1,
    Comparison,
    Source,
    chapter,
    friction,
    pipe,
    speed,
    within,
)
from scenes.studies.validate.measures import Figure, Ratio

CMMWORM = Source("Horchler et al., Soft Robotics 2 (2015) 135, abstract", "R", "robot")
KANDHARI = Source("Kandhari et al., An Analysis of Peristaltic Locomotion (2019), abstract", "R", "other model")
RIDDLE = Source(
    "Riddle et al., Bioinspiration & Biomimetics 20 (2025) 066001, a simulation, as quoted in talks on it",
    "R2",
    "other model",
)
LOAD_FRAME = Source(
    "Riddle et al. 2025, load-frame record of a segment (data/mesh_segment_load_frame.csv)", "R", "robot"
)
BRAID = Source("Active Braid Crawler, its authors' table", "R", "robot")

SOFT_TO_STIFF = tuple((f"worm.spring_N={k}",) for k in (50.0, 200.0, 1000.0, 5000.0))
GROUNDS = tuple(friction(mu) for mu in (0.2, 0.8))
RUBBING_JOINTS = (
    "hysteresis.kind=jenkins",
    "hysteresis.moment_N_m=0.66",
    "hysteresis.load_ratio=0.0",
    "hysteresis.give_J=0.02",
)
"""Changes for joints with friction. A segment then loses 3.0 J per cycle, as measured for a segment of CMMWorm-SES: two
hinges with a friction moment of 0.66 N m turn by 1.13 rad and back."""
RUBBING = ("worm.spring_N=1000.0", *RUBBING_JOINTS)
"""Changes for joints with friction and stiff servos."""
THREE_MOVE = ("gait.moving=0.5", "gait.held=0.3333333333333333")
"""Changes for a gait with three of six segments moving at a time, called waveform 3x1 in the source."""

PIPES = (0.0725, 0.0775)
"""Further radii of the braid crawler's pipe, for which the model's number is computed too [m]."""


def in_pipe_over_free(radius: float) -> Ratio:
    """Return the ratio of the braid crawler's speed in a level pipe, with a radius [m], to its speed on the ground."""
    return Ratio(speed("braid_crawler", *pipe(radius)), speed("braid_crawler"))


def up_over_level(radius: float) -> Ratio:
    """Return the ratio of the braid crawler's speeds in a vertical and in a level pipe, both with a radius [m]."""
    level, up = pipe(radius), pipe(radius, "world.tilt_deg=90")
    return Ratio(speed("braid_crawler", *up), speed("braid_crawler", *level))


def on_more_friction(*changes: str) -> Ratio:
    """Return the ratio of the speeds of CMMWorm-SES, with some changes, on friction of 0.9 and on friction of 0.1."""
    return Ratio(*(speed("cmmworm_ses", *changes, *friction(mu)) for mu in (0.9, 0.1)))


ROBOT_COMPARISONS = (
    Comparison(
        "CMMWorm: speed on plywood",
        speed("cmmworm"),
        4.3e-3,
        within(2.0, 4.3e-3),
        CMMWORM,
        "Assumed: friction 0.4 (0.2 to 0.8), springs of 100 N (50 to 5000), joints that do not rub (or do), "
        "and the gait of the successor, two moving segments (or three).",
        unit="m/s",
        unknown=(*SOFT_TO_STIFF, RUBBING, *GROUNDS, THREE_MOVE),
    ),
    Comparison(
        "CMMWorm: speed, friction 0.8 over 0.2",
        Ratio(speed("cmmworm", *friction(0.8)), speed("cmmworm", *friction(0.2))),
        None,
        ABOVE_1,
        CMMWORM,
        "The robot is faster where friction is larger. In the model this is true for worms that are stiff or have "
        "joints that rub. Friction holds soft worms back.",
        unknown=(*SOFT_TO_STIFF, RUBBING),
        trend=True,
    ),
    Comparison(
        "CMMWorm: speed, 3 over 2 moving segments",
        Ratio(speed("cmmworm", *THREE_MOVE), speed("cmmworm")),
        None,
        ABOVE_1,
        KANDHARI,
        "Speed is largest with as many moving segments as possible.",
        unknown=(*SOFT_TO_STIFF, RUBBING, *GROUNDS),
        trend=True,
    ),
    Comparison(
        "CMMWorm: cost of transport, 3 over 2 moving segments",
        Ratio(Figure("cost_of_transport", "cmmworm", THREE_MOVE), Figure("cost_of_transport", "cmmworm")),
        None,
        ABOVE_1,
        KANDHARI,
        "The cost of transport is least with few moving segments. In the source, the cost is the power that holds the "
        "segments in shape.",
        unknown=(*SOFT_TO_STIFF, RUBBING, *GROUNDS),
        trend=True,
    ),
    Comparison(
        "CMMWorm-SES: speed on the ground",
        speed("cmmworm_ses"),
        0.0385,
        (0.029, 0.048),
        RIDDLE,
        "The published number is from another simulation, not measured: 29 to 48 mm/s for friction from 0.1 to 0.9.",
        unit="m/s",
        unknown=(*SOFT_TO_STIFF, RUBBING, friction(0.1), friction(0.9)),
    ),
    Comparison(
        "CMMWorm-SES: speed, friction 0.9 over 0.1, stiff mesh",
        on_more_friction("worm.spring_N=1000"),
        None,
        ABOVE_1,
        RIDDLE,
        "In the source, a stiff mesh is faster on more friction. Assumed for a stiff mesh: springs of 1000 N (500 to "
        "5000), joints that do not rub (or do).",
        others=(*(on_more_friction(f"worm.spring_N={k}") for k in (500, 5000)), on_more_friction(*RUBBING)),
        trend=True,
    ),
    Comparison(
        "CMMWorm-SES: speed, friction 0.9 over 0.1, soft mesh",
        on_more_friction(),
        None,
        BELOW_1,
        RIDDLE,
        "In the source, a soft mesh is slower on more friction. Assumed for a soft mesh: springs of 26 N (13 to 52), "
        "which follow from the measured work, joints that do not rub (or do).",
        unknown=(("worm.spring_N=13.0",), ("worm.spring_N=52.0",), RUBBING_JOINTS),
        trend=True,
    ),
    Comparison(
        "CMMWorm-SES, one segment: share of the work that is lost",
        Figure("work_lost_share", "mesh_segment"),
        0.91,
        (0.86, 0.96),
        LOAD_FRAME,
        "The segment law and the friction were fitted to this record. Without friction in its joints the segment would "
        "lose nothing.",
        standing="fitted",
    ),
    Comparison(
        "CMMWorm-SES, one segment: peak force",
        Figure("peak_force_N", "mesh_segment"),
        16.0,
        (15.2, 16.8),
        LOAD_FRAME,
        "As above. The band is 5 % of the peak, since the smooth loop differs from the jagged record by 3 % rms. A "
        "rhombus with springs that was fitted to the record (scene load_frame) has 14.3 N.",
        standing="fitted",
        unit="N",
    ),
    Comparison(
        "Active Braid Crawler: ratio of speeds, level pipe to ground",
        in_pipe_over_free(0.075),
        72 / 22,
        within(2.0, 72 / 22),
        BRAID,
        "On the ground, slip costs the robot 70 % of its speed in a pipe. The model's worm slips little, because its "
        "sections keep their lengths under any load.",
        unknown=(*GROUNDS, ("worm.spring_N=300.0",), ("worm.spring_N=3000.0",)),
        others=tuple(map(in_pipe_over_free, PIPES)),
        trend=True,
    ),
    Comparison(
        "Active Braid Crawler: ratio of speeds, vertical to level pipe",
        up_over_level(0.075),
        27 / 72,
        within(2.0, 27 / 72),
        BRAID,
        "In a pipe of 145 to 152 mm, the model's cranks lift the robot without slowing down or giving way. In a pipe "
        "of 155 mm, a single section has no hold at times, and the model's robot slides down.",
        unknown=(*GROUNDS, ("worm.spring_N=3000.0",)),
        others=tuple(map(up_over_level, PIPES)),
        trend=True,
    ),
)

rows = chapter(ROBOT_COMPARISONS)
"""Function that runs the comparisons and yields their rows one by one. With `quick`, the spreads are left out."""
