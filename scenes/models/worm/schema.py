"""Sections of a scene of the 3D worm. The defaults are the defaults of `worm3d`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Literal

from control.gaits.reflexes import REFLEXES
from control.parts import ACTUATOR, GAIT, HYSTERESIS, LAW_KIND, LOAD_KIND, MEASURE, MEDIUM_KIND, REFLEX, SEGMENT_KIND
from planar.linkage import Linkage
from scenes.language.parts import ITSELF, Keys, PartSection, chosen, keys_of
from scenes.language.schema import Each, Pair, Section, Triple, parts_key, setting
from scenes.models.sections import BODY_BOUNDS, Run, Settings, gait_keys, planar_gait_keys
from scenes.models.sensors import ChannelSection, channel_keys
from scenes.models.switched import switched_keys
from scenes.models.worlds.schema import World
from worm3d.physics.friction import Friction as PlantFriction
from worm3d.physics.worm import Worm as PlantWorm
from worm3d.values.named import is_own

NO_LAW = NO_RECORD = "none"
"""Value of the key `file` of the sections [segment] and [gait] if there is no file."""


def _of_hinges(registry: Mapping[str, Any]) -> Keys:
    """Return the keys of a section that chooses an actuator for the hinges, among the actuators that can drive them."""
    parts = {name: part for name, part in registry.items() if is_own(name) or getattr(part, "drives_hinges", True)}
    return chosen(parts, meaning="actuator of the hinges")


class Actuator(
    PartSection, holds={"kind": ACTUATOR}, keys=partial(chosen, meaning="actuator of the chambers", own_defaults=True)
):
    """Actuator of the chambers: the response to the commands."""


class HingeActuator(PartSection, holds={"kind": ACTUATOR}, keys=_of_hinges):
    """Actuator of the hinges: the response to the commands."""


class Hysteresis(
    PartSection,
    holds={"kind": HYSTERESIS},
    keys=partial(chosen, meaning="friction in the joints of the chambers, which rub"),
):
    """Friction in the joints of the chambers: rate-independent hysteresis."""


class Medium(
    PartSection,
    holds={"kind": MEDIUM_KIND},
    keys=partial(chosen, meaning="viscous medium: how worm.drag_N_s_m follows the shape"),
):
    """Viscous medium around the worm."""


class Segment(
    PartSection,
    holds={"kind": SEGMENT_KIND},
    keys=partial(chosen, meaning="segment law: energy and outline of a segment as functions of its length and command"),
):
    """Segment law. With the kind learned, sizes and stiffness of the worm follow from the file."""

    file: str = setting(
        NO_LAW,
        meaning="file of the law that 'worm3d law' wrote: beside the scene, shipped, or a path",
        is_file=True,
        only=("learned",),
        aka=("law", "path"),
    )


class Load(PartSection, holds={"kind": LOAD_KIND}, keys=partial(chosen, meaning="load that the worm carries or drags")):
    """External load on a joint of the worm."""


_laws = partial(
    chosen, by="law", meaning="law of friction: the force as a function of the coefficients", aka=("kind", "type")
)


class Worm(
    PartSection, keys=keys_of(PlantWorm, without=("flat",), bounds={**BODY_BOUNDS, "chamber_offset": {"gt": 0}})
):
    """The chain of rhombic linkages with left and right chambers."""


class PlanarWorm(PartSection, keys=keys_of(Linkage, bounds=BODY_BOUNDS)):
    """The chain of rhombic linkages, with the parameters of the planar model."""


class Friction(PartSection, more=keys_of(PlantFriction), holds={"law": LAW_KIND}, keys=_laws):
    """Directional friction with sticking."""


class PlanarFriction(
    PartSection, more=keys_of(PlantFriction, without=("lateral",)), holds={"law": LAW_KIND}, keys=_laws
):
    """Directional friction with sticking, along the plane."""


class WormGait(PartSection, holds={"kind": GAIT}, keys=gait_keys):
    """Commands of the chambers, to shorten by amplitude times activation, and of the hinges."""

    pressure_Pa: float | None = setting(
        unit="Pa", gt=0, left_out="gait.amplitude", meaning="amplitude as the pressure of a learned segment law"
    )
    cable_N: float | None = setting(
        unit="N",
        gt=0,
        left_out="gait.amplitude",
        meaning="amplitude as the force of the cable of a learned segment law",
    )
    file: str = setting(
        NO_RECORD,
        meaning="a CSV file with recorded commands in place of the gait: time_s and pressure_kPa, pressure_0_1_kPa "
        "(segment, side), cable_N or contraction: beside the scene, shipped, or a path",
        is_file=True,
        aka=("record", "path"),
    )


class PlanarGait(PartSection, holds={"kind": GAIT}, keys=planar_gait_keys):
    """Commands of the chambers, to shorten by amplitude times activation."""


class Reflexes(PartSection, keys=switched_keys(REFLEXES), holds={ITSELF: REFLEX}):
    """Reflexes that change the gait's contractions based on sensor signals, in this order; each has a switch."""


class Senses(ChannelSection, keys=channel_keys(exact=True)):
    """Errors of the sensor signals for the gait and its reflexes; without entries, the signals are exact."""


class Measures(
    PartSection,
    keys={"parts": parts_key((), meaning="measures of your own, in addition to the measures of every summary")},
    holds={"parts": MEASURE},
):
    """Measures for the evaluation of the run."""


class PlanarStart(Section):
    """Start of the straight worm: position."""

    position_m: Pair = setting(
        (0.0, 0.0), unit="m", meaning="x, y of the tail, seen from above; in a pipe: distance along the pipe, and 0"
    )
    lift_m: float = setting(0.0, unit="m", ge=0, meaning="height above the place where the worm touches the world")
    settle: bool | None = setting(
        meaning="whether the worm is first brought to rest on the world; false: the worm falls from the start",
        left_out="true if the worm touches the world",
    )


class AimedStart(PlanarStart):
    """Start of the straight worm: position and heading."""

    azimuth_deg: float = setting(
        0.0,
        unit="deg",
        meaning="heading, from x towards y; in a pipe: 0 is along the pipe, 180 back",
        aka=("heading_deg", "direction_deg"),
    )


class Start(AimedStart):
    """Start of the straight worm: position, heading, and whether the gait contracts the chambers at the start."""

    contracted: bool = setting(
        False,
        meaning="whether the chambers start with the gait's contractions, so that the worm is wedged in a steep pipe",
    )


class Push(Section):
    """An external force on one joint, from a given time on, for ever or for a given duration."""

    joint: int = setting(0, ge=0, meaning="which joint: 0 is the tail, the number of segments is the head")
    force_N: Triple = setting((0.0, 0.0, 0.0), unit="N", meaning="x, y, z of the force; all 0: no push")
    begin_s: float = setting(0.0, unit="s", ge=0, meaning="start of the push")
    duration_s: float | None = setting(unit="s", gt=0, left_out="to the end of the run", meaning="duration of the push")


class WormRun(Run):
    """Duration, time step, integrator, gravity and recording of the run."""

    integrator: Literal["bdf2", "implicit_euler"] = setting(
        "bdf2", meaning="bdf2 is of second order; implicit_euler is the method of the paper"
    )
    accuracy: float | None = setting(
        ge=1e-4,
        le=0.1,
        left_out="steps of dt_s, whose error is not known",
        meaning="largest error of the distance, relative to the distance or to 0.1 body lengths; the steps are as long "
        "as this error allows, and dt_s is the time between rows and between decisions of a controller",
    )
    tolerance: float = setting(
        2e-15,
        ge=2e-15,
        le=1e-7,
        meaning="tolerance of Newton's method: motion as a fraction of the body length; 1e-9 is a fifth faster",
    )
    gravity_m_s2: Each[float] = setting(9.81, unit="m/s^2", meaning="g, downwards; or a list of x, y, z", aka=("g",))


class Surroundings(Settings):
    """Sections that scenes of the 3D worm and of the planar worm have in common."""

    run: WormRun = WormRun()
    world: World = World()
    push: Push = Push()
    measures: Measures = Measures()
    segment: Segment = Segment()


class SpatialScene(Surroundings):
    """Sections that all scenes of the 3D worm have in common, with a gait or with a controller."""

    worm: Worm = Worm()
    actuator: Actuator = Actuator()
    hinge_actuator: HingeActuator = HingeActuator()
    hysteresis: Hysteresis = Hysteresis()
    medium: Medium = Medium()
    load: Load = Load()
    friction: Friction = Friction()
    start: AimedStart = AimedStart()


class WormScene(SpatialScene):
    """A whole scene."""

    model: Literal["worm"] = setting(meaning="which simulation the scene is for")
    gait: WormGait = WormGait()
    reflexes: Reflexes = Reflexes()
    sensor: Senses = Senses()
    start: Start = Start()


class PlanarWormScene(Surroundings):
    """A whole scene of the planar worm, with the keys of the model planar_linkage and the grounds of the 3D worm."""

    model: Literal["worm_planar"] = setting(meaning="which simulation the scene is for")
    worm: PlanarWorm = PlanarWorm()
    friction: PlanarFriction = PlanarFriction()
    gait: PlanarGait = PlanarGait()
    reflexes: Reflexes = Reflexes()
    sensor: Senses = Senses()
    start: PlanarStart = PlanarStart()


GaitScene = WormScene | PlanarWormScene
"""Scene of a worm that is driven by a gait."""

AnyWormScene = GaitScene | SpatialScene
