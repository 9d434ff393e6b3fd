"""The trials of `worm3d bench control`: scenes with controllers, with changes as after -o, and what each is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scenes.language.errors import SceneError
from worm3d.values.spelling import did_you_mean

OFFSET, HEADING, SPEED = "cross_track_rms_bl", "heading_error_rms_deg", "speed_error_rms_relative"


class Trial(NamedTuple):
    """A scene, with changes as after -o."""

    name: str
    scene: str
    overrides: tuple[str, ...] = ()
    metric: str = OFFSET
    """What it is about: the metric that counts in the score."""


SCENES = (
    *(Trial(name, name, metric=SPEED) for name in ("velocity_step", "velocity_sine", "stop_and_go")),
    Trial("heading_hold", "heading_hold", metric=HEADING),
    *(Trial(name, name) for name in ("path_line", "path_circle", "path_s_curve", "path_waypoints", "there_and_back")),
    Trial("velocity_pipe", "velocity_pipe", metric=SPEED),
    *(Trial(name, name) for name in ("path_s_curve_slope", "disturbance_push")),
)
"""The scenes that ship, as they are."""
UNSCORED = ("obstacles",)
"""Scenes that ask for something that no metric of the score tells, such as to leave the path for an obstacle."""
SIDE = ("world.slope_deg=2", "world.heading_deg=90")
CORNER = "reference.points=[{x_m=0.5, y_m=0.0}, {x_m=2.0, y_m=0.0}, {x_m=2.0, y_m=3.0}]"
# The line passes 0.2 m to the right of the worm's middle at (0.5, 0), 0.5 rad to the right of where the worm looks.
APART = ("reference.start_m=[0.40411, -0.17552]", "reference.azimuth_deg=-28.648")
USUAL_MAP = "controller.map=default"
HARD = (
    Trial("path_line_uphill", "path_line", ("world.slope_deg=3.0",)),
    Trial("side_slope", "path_line", SIDE),
    Trial("side_slope_compass", "path_line", (*SIDE, "sensor.heading=true")),
    Trial("from_apart", "path_line", APART),
    Trial("circle_0.6", "path_circle", ("reference.radius_m=0.6",)),
    Trial("circle_0.4", "path_circle", ("reference.radius_m=0.4",)),
    Trial("corner", "path_waypoints", (CORNER, "reference.radius_m=0.02", "run.duration_s=45")),
    Trial("s_curve_slow", "path_s_curve", ("reference.speed_m_s=0.02",)),
    Trial("s_curve_fast", "path_s_curve", ("reference.speed_m_s=0.14",)),
    Trial("s_curve_noise", "path_s_curve", ("sensor.com_noise_m=0.02",)),
    Trial("eight_segments", "path_s_curve", ("worm.segments=8", USUAL_MAP)),
    Trial("soft_springs", "path_s_curve", ("worm.spring_N=6.5", USUAL_MAP)),
)
"""What the scenes are not: steep, turned away, sharp, slow, fast, noisy, or by another worm than the map is of."""
FULL = (*SCENES, *HARD)
RETUNED = {
    "circle_0.4": ("controller.gain_reach=0.1", "controller.gain_heading_per_s=1.2"),
    "corner": ("controller.gain_reach=0.15", "controller.gain_heading_per_s=1.2"),
    "s_curve_fast": ("controller.gain_reach=0.5", "controller.gain_heading_per_s=2.0"),
}
"""Line-of-sight as retuned for a trial: the best of 12 runs with seed 10, with reaches of 0.1 to 0.5 body lengths (on
the fast S-curve 0.15 to 0.5) and K_h of 0.8, 1.2 and 2 rad/s. At the corner the default gains are the best."""
SHORT = ("run.duration_s=12", "run.record_every=2")
QUICK = tuple(Trial(name, name, SHORT) for name in ("path_line", "path_circle"))
"""Trials to try it out: too short to say much."""
METRIC = {trial.name: trial.metric for trial in FULL}
"""What each trial is about."""


def chosen(names: Sequence[str]) -> tuple[Trial, ...]:
    """Return trials by their names, all if there are none; SceneError for a name that no trial has."""
    known = {trial.name: trial for trial in FULL}
    for name in names:
        if name not in known:
            meant = did_you_mean(name, [(each, each) for each in known])
            hint = f"; did you mean '{meant}'?" if meant else f"; known are {', '.join(known)}"
            raise SceneError(f"--trial: got '{name}', which no trial is called{hint}")
    return tuple(known[name] for name in dict.fromkeys(names)) if names else FULL
