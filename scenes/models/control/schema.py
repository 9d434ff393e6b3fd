"""Sections of a scene where a controller drives the 3D worm: controller, cost, constraints, sensors and faults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from control.baselines import Gains
from control.controllers import CONTROLLERS, ESTIMATORS, MODELS, Listed
from control.faults.injected import INJECTED
from control.gaits.steering import Mechanism, Wave
from control.parts import CONSTRAINT, CONTROLLER, ESTIMATOR, FAULT, MODEL_KIND, TERM
from control.planning.constraints import CONSTRAINTS
from control.planning.terms import TERMS
from scenes.language.parts import ITSELF, Keys, PartSection, keys_of, meanings
from scenes.language.schema import OWN_KINDS, Key, part_key, parts_key, setting
from scenes.models.control.reference import Reference
from scenes.models.sensors import ChannelSection, channel_keys
from scenes.models.switched import switched_keys
from scenes.models.worm.schema import SpatialScene

AUTO: Literal["auto"] = "auto"
"""Value of the key `wave` that lets the program choose the wave at the beginning of a run."""


def _listed(registry: Mapping[str, Listed], what: str = "") -> Key:
    """Return the key whose value is a name in a registry; the first name is the default.

    `what` is the beginning of the key's description.
    """
    title = "; ".join(f"{name}: {listed.title}" for name, listed in registry.items())
    return part_key(tuple(registry), meaning=what + title, aka=() if what else ("type",))


def _parts_keys(registry: Mapping[str, type], what: str) -> Keys:
    """Return the keys of a section that lists parts of a registry.

    They are the key `parts`, the list of the parts in use, and the parameters of each part. `what` names the parts.
    """
    keys: Keys = {
        "parts": parts_key(tuple(registry), meaning=f"which {what} count, in any order; {meanings(registry)}")
    }
    for name, each in registry.items():
        keys |= keys_of(each, prefix=f"{name}_", about=f"{name}: ")
    return keys


class Controller(
    PartSection,
    keys={
        "kind": _listed(CONTROLLERS),
        "estimator": _listed(ESTIMATORS, "estimator of the state from measurements: "),
        "model": _listed(MODELS, "model of the worm in planner and estimator: "),
        **keys_of(Gains, prefix="gain_", only=("pi_los", OWN_KINDS)),
    },
    holds={"kind": CONTROLLER, "estimator": ESTIMATOR, "model": MODEL_KIND},
):
    """Controller that drives the worm."""

    mechanism: Mechanism = setting(
        "hinge",
        meaning="steering: hinges, unequal chambers, or both at once",
        left_out="that of its kind: 'both' for mpc, 'hinge' for all others",
        defaults_by_kind={"mpc": "both", OWN_KINDS: "hinge"},
    )
    wave: Literal[Wave, "auto"] = setting(
        "sine",
        meaning="form of the contraction. sine: half a sine; steep: segments stay short for longer, so that the "
        "worm is faster and takes less work, but turns less sharply, and not well below 0.04 m/s; auto: steep if the "
        "run asks for a speed that sine hardly reaches, otherwise sine",
        left_out="that of its kind: 'auto' for mpc, 'sine' for all others",
        defaults_by_kind={"mpc": AUTO, OWN_KINDS: "sine"},
    )
    period_s: float = setting(0.2, unit="s", gt=0, meaning="time between two decisions", aka=("control_period_s",))
    map: Literal["own", "nearby", "default"] = setting(
        "own",
        meaning="map from commands to motion. own: the map of this worm on this friction if the map was identified, "
        "otherwise nearby; nearby: the map of the default worm, corrected by some seconds of runs as the scene "
        "starts; default: the map of the default worm for any worm",
    )
    inner_loop: bool = setting(
        True,
        meaning="whether a chamber whose strain is too small gets larger or earlier commands than the others",
        left_out="that of its kind: false for pi_los and open_loop, true for all others",
        defaults_by_kind={"pi_los": False, "open_loop": False},
    )
    told: bool = setting(
        True,
        meaning="whether the controller knows how good the sensors are; false: the controller assumes usual sensors",
    )


class Cost(PartSection, keys=_parts_keys(TERMS, "terms"), holds={"parts": TERM}):
    """Cost of a plan: the terms, and for each term the error that costs 1."""


class Constraints(PartSection, keys=_parts_keys(CONSTRAINTS, "constraints"), holds={"parts": CONSTRAINT}):
    """Soft constraints of a plan, and for each constraint the excess that costs 1."""


class Sensor(ChannelSection, keys=channel_keys()):
    """Quality of the sensors, channel by channel."""


class Faults(PartSection, keys=switched_keys(INJECTED), holds={ITSELF: FAULT}):
    """Faults injected on purpose, each switched on by name; the controller gets no information about them."""


class ControlScene(SpatialScene):
    """A whole scene."""

    model: Literal["worm_control"] = setting(meaning="which simulation the scene is for")
    controller: Controller = Controller()
    cost: Cost = Cost()
    constraints: Constraints = Constraints()
    sensor: Sensor = Sensor()
    reference: Reference = Reference()
    fault: Faults = Faults()
