"""Sections of a scene in which a controller drives the 3D worm: the controller, its sensors and its reference."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Literal

from control.baselines import Gains
from control.controllers import CONTROLLERS, ESTIMATORS, MODELS, Listed
from control.faults.injected import INJECTED
from control.gaits.steering import Mechanism, Wave
from control.parts import CONSTRAINT, CONTROLLER, ESTIMATOR, FAULT, MODEL, OBSTACLE, PATH, TERM
from control.planning.constraints import CONSTRAINTS
from control.planning.terms import TERMS
from control.tracking.obstacles import OBSTACLES
from scenes.language.parts import ITSELF, Keys, PartSection, chosen, keys_of, meanings
from scenes.language.schema import OWN, Key, Pair, Section, Tables, part_key, parts_key, setting
from scenes.models.sensors import ChannelSection, channel_keys
from scenes.models.switched import switched_keys
from scenes.models.worm.schema import SpatialScene

HEADING, LINE, CIRCLE, S_CURVE, SPLINE, WAY_POINTS = "heading", "line", "circle", "s_curve", "spline", "way_points"
BEGUN = (LINE, CIRCLE, S_CURVE)
"""Kinds of paths that have a start and a direction there; others are where their points are."""
AUTO: Literal["auto"] = "auto"
"""Name of the wave that is chosen as a run begins."""


def _listed(registry: Mapping[str, Listed], what: str = "") -> Key:
    """Return the key that names one of a registry; the first is the default."""
    title = "; ".join(f"{name}: {listed.title}" for name, listed in registry.items())
    return part_key(tuple(registry), meaning=what + title, aka=() if what else ("type",))


def _parts_keys(registry: Mapping[str, type], what: str) -> Keys:
    """Return the keys of a section with the parts of a registry: which of them count, and the parameters of each."""
    keys: Keys = {
        "parts": parts_key(tuple(registry), meaning=f"which {what} count, in any order: {meanings(registry)}")
    }
    for name, each in registry.items():
        keys |= keys_of(each, prefix=f"{name}_", about=f"{name}: ")
    return keys


class Controller(
    PartSection,
    keys={
        "kind": _listed(CONTROLLERS),
        "estimator": _listed(ESTIMATORS, "what finds the state from measurements: "),
        "model": _listed(MODELS, "what planner and estimator take the worm for: "),
        **keys_of(Gains, prefix="gain_", only=("pi_los", OWN)),
    },
    holds={"kind": CONTROLLER, "estimator": ESTIMATOR, "model": MODEL},
):
    """Controller that drives the worm."""

    mechanism: Mechanism = setting(
        "hinge",
        meaning="what steers: hinges, unequal chambers, or both at once",
        left_out="that of its kind: 'both' for mpc, 'hinge' for all others",
        own={"mpc": "both", OWN: "hinge"},
    )
    wave: Literal[Wave, "auto"] = setting(
        "sine",
        meaning="form of the contraction. sine: half a sine; steep: segments stay short for longer, so that it is "
        "faster and takes less work, but turns less sharply, and not well below 0.04 m/s; auto: the steep one in a "
        "run in which a speed is asked for that the sine hardly reaches, otherwise the sine",
        left_out="that of its kind: 'auto' for mpc, 'sine' for all others",
        own={"mpc": AUTO, OWN: "sine"},
    )
    period_s: float = setting(0.2, unit="s", gt=0, meaning="time between two decisions", aka=("control_period_s",))
    map: Literal["own", "nearby", "default"] = setting(
        "own",
        meaning="which map of what a wave does it goes by. own: that of this worm on this friction if it was "
        "identified, otherwise nearby; nearby: the default worm's, corrected by some seconds of runs as the scene "
        "starts; default: the default worm's, whatever the worm is",
    )
    told: bool = setting(
        True, meaning="whether it is told how good the sensors are; false: it takes them for usual ones"
    )


class Cost(PartSection, keys=_parts_keys(TERMS, "terms"), holds={"parts": TERM}):
    """Cost of a plan: its terms, and what weighs 1 in each."""


class Constraints(PartSection, keys=_parts_keys(CONSTRAINTS, "constraints"), holds={"parts": CONSTRAINT}):
    """Soft constraints of a plan, and what weighs 1 in each."""


class Sensor(ChannelSection, keys=channel_keys()):
    """Quality of the sensors, channel by channel."""


class SpeedStep(Section):
    """Step of the speed that is asked for."""

    at_s: float = setting(unit="s", gt=0, meaning="when")
    speed_m_s: float = setting(unit="m/s", meaning="speed from then on, below 0 backwards")


class HeadingStep(Section):
    """Step of the heading that is asked for."""

    at_s: float = setting(unit="s", gt=0, meaning="when")
    heading_deg: float = setting(unit="deg", meaning="heading from then on")


class Obstacle(PartSection, holds={"kind": OBSTACLE}, keys=partial(chosen, meaning="what it is")):
    """Obstacle on the ground that the centre of mass goes around."""


class Point(Section):
    """A point of a path."""

    x_m: float = setting(unit="m", meaning="x")
    y_m: float = setting(unit="m", meaning="y")


ENDING = (LINE, S_CURVE, SPLINE, WAY_POINTS, "pipe", OWN)
"""Kinds of paths that may have an end."""
PATHS = (*ENDING, CIRCLE)
KINDS = (*(kind for kind in PATHS if kind != OWN), HEADING, "none")
KIND = part_key(
    KINDS,
    meaning="what to keep to: a path, such as the centre line of the pipe, a heading, or nothing",
    aka=("path", "type"),
)


class Reference(PartSection, keys={"kind": KIND}, holds={"kind": PATH}):
    """Task of the worm: how fast to go, and where to."""

    speed_m_s: float = setting(0.08, unit="m/s", meaning="speed forward, at first; below 0 backwards")
    speed_steps: Tables[SpeedStep] = setting((), meaning="steps of the speed, each a table of at_s and speed_m_s")
    speed_sine_m_s: float = setting(0.0, unit="m/s", ge=0, meaning="amplitude of a sine that is added to the speed")
    speed_sine_period_s: float = setting(20.0, unit="s", gt=0, meaning="its period")
    heading_deg: float = setting(0.0, unit="deg", only=HEADING, meaning="at first")
    heading_steps: Tables[HeadingStep] = setting(
        (), only=HEADING, meaning="steps of the heading, each a table of at_s and heading_deg"
    )
    start_m: Pair | None = setting(
        unit="m",
        only=BEGUN,
        left_out="the middle of the worm as it starts",
        meaning="where the path begins: x, y",
    )
    azimuth_deg: float | None = setting(
        unit="deg",
        only=BEGUN,
        left_out="where the worm looks as it starts",
        meaning="direction of the path where it begins",
    )
    length_m: float | None = setting(unit="m", gt=0, only=LINE, left_out="without end", meaning="length of the line")
    ends: bool = setting(False, only=ENDING, meaning="whether the worm stops at the end of the path and stays there")
    corridor_m: float | None = setting(
        unit="m", gt=0, only=PATHS, left_out="any", meaning="how far the middle may go to either side of the path"
    )
    obstacles: Tables[Obstacle] = setting(
        (),
        only=PATHS,
        meaning="what to go around, each a table: "
        + "; ".join(f'kind = "{name}" with {", ".join(keys_of(each))}' for name, each in OBSTACLES.items()),
    )
    radius_m: float = setting(1.5, unit="m", gt=0, only=(CIRCLE, WAY_POINTS), meaning="radius, or that of the corners")
    towards: Literal["left", "right"] = setting("left", only=(CIRCLE, S_CURVE), meaning="to which side it turns first")
    amplitude_m: float = setting(0.4, unit="m", gt=0, only=S_CURVE, meaning="amplitude of its sine")
    wavelength_m: float = setting(4.0, unit="m", gt=0, only=S_CURVE, meaning="wavelength of its sine")
    points: Tables[Point] = setting(
        (), only=(SPLINE, WAY_POINTS), meaning="points of the path, each a table of x_m and y_m"
    )
    closed: bool = setting(False, only=SPLINE, meaning="whether it goes on from its last point to its first")


class Faults(PartSection, keys=switched_keys(INJECTED), holds={ITSELF: FAULT}):
    """Faults that are put in on purpose, of which the controller is told nothing; any that are asked for by name."""


class ControlScene(SpatialScene):
    """A whole scene."""

    model: Literal["worm_control"] = setting(meaning="which simulation the scene is for")
    controller: Controller = Controller()
    cost: Cost = Cost()
    constraints: Constraints = Constraints()
    sensor: Sensor = Sensor()
    reference: Reference = Reference()
    fault: Faults = Faults()
