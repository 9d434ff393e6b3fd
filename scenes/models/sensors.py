"""Keys for the quality of sensors, channel by channel, and the sensors that they describe."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any

from control.sensing.sensors import QUANTITIES, Channel
from scenes.language.parts import Keys, keys_of, part_of
from scenes.language.schema import setting


def units_of(name: str) -> dict[str, str]:
    """Return the units of the parameters of a channel that have that of its quantity."""
    return dict.fromkeys(("noise", "bias"), QUANTITIES[name].unit)


def channel_keys(*, exact: bool = False) -> Keys:
    """Return the keys of all channels, those of usual sensors by default, or of `exact` ones.

    A usual sensor that a robot need not have is asked for by its name.
    """
    keys: Keys = {}
    for name, what in QUANTITIES.items():
        if not (what.standard or exact):
            keys[name] = bool, setting(False, title=f"{what.meaning}: whether there is a sensor")
        usual, about = asdict(Channel(noise=0.0) if exact else what.default), f"{what.meaning}: "
        keys |= keys_of(Channel, prefix=f"{name}_", defaults=usual, units=units_of(name), about=about)
    return keys


def channels_of(section: Any, names: Collection[str]) -> Mapping[str, Channel]:
    """Return the channels of some names, as a section describes them; one without keys there is a usual sensor.

    Such a channel was added to `QUANTITIES` by a module that was imported later, as that of a controller.
    """
    return {
        name: part_of(Channel, section, prefix=f"{name}_", units=units_of(name))
        if any(key.startswith(f"{name}_") for key in type(section).model_fields)
        else QUANTITIES[name].default
        for name in names
    }
