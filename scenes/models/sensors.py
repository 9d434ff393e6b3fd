"""Keys for the quality of each sensor channel, and the channels that these keys describe."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any

from control.parts import CHANNEL
from control.sensing.sensors import QUANTITIES, Channel, Quantity, require_known
from scenes.language.parts import ITSELF, Keys, PartSection, keys_of, part_of
from scenes.language.schema import keys_in, new_key
from worm3d.values import named
from worm3d.values.named import is_own


def _units(quantity: Quantity) -> dict[str, str]:
    """Return the units of those parameters of a channel that have the unit of the measured quantity."""
    return dict.fromkeys(("noise", "bias"), quantity.unit)


def channel_keys(*, exact: bool = False) -> Keys:
    """Return the keys of all channels. The defaults are those of usual sensors, or of exact sensors if `exact` is true.

    Among usual sensors, a channel that not every robot has is switched on by a key with its name.
    """
    keys: Keys = {}
    for name, what in QUANTITIES.items():
        if not (what.standard or exact):
            keys[name] = new_key(False, hint=bool, meaning=f"{what.meaning}: whether there is a sensor")
        usual, about = asdict(Channel(noise=0.0) if exact else what.default), f"{what.meaning}: "
        keys |= keys_of(Channel, prefix=f"{name}_", defaults=usual, units=_units(what), about=about)
    return keys


class ChannelSection(PartSection, holds={ITSELF: CHANNEL}):
    """A section of sensors, channel by channel."""

    @classmethod
    def each(cls, name: str, part: Any) -> Keys:
        """Return the keys of the sub-section of a user's own channel, and register the channel under its name."""
        QUANTITIES.setdefault(own_name(name), part)
        return keys_of(Channel, defaults=asdict(part.default), units=_units(part))


def channels_of(section: Any, names: Collection[str]) -> Mapping[str, Channel]:
    """Return the channels `names` as a section describes them, and the user's own channels in the section.

    A channel without keys in the section is a usual sensor. This happens if a module that was imported after the
    section was defined, for example the module of a controller, added the channel to `QUANTITIES`.

    Raises
    ------
    ValueError
        If a name is not the name of a channel.
    """
    own = own_channels(section)
    require_known(names)
    shipped = {
        name: part_of(Channel, section, prefix=f"{name}_", units=_units(QUANTITIES[name]))
        if any(each.startswith(f"{name}_") for each in keys_in(type(section)))
        else QUANTITIES[name].default
        for name in names
    }
    return shipped | {
        channel: part_of(Channel, getattr(section, name), units=_units(QUANTITIES[channel]))
        for name, channel in own.items()
    }


def own_channels(section: Any) -> dict[str, str]:
    """Return the user's own channels in a section, as a dictionary from `module:NAME` to NAME.

    Controllers use NAME for the channel, and the channel is registered under NAME in `QUANTITIES`.

    Raises
    ------
    ValueError
        If another channel has the same NAME.
    """
    found = {}
    for name in (name for name, _ in section if is_own(name)):
        quantity, channel = named.ready(name, CHANNEL), own_name(name)
        if QUANTITIES.setdefault(channel, quantity) is not quantity:
            raise ValueError(f"{name}: there is another channel {channel!r}; rename it")
        found[name] = channel
    return found


def own_name(name: str) -> str:
    """Return the name that controllers use for a user's own channel, `module:NAME`."""
    return name.partition(":")[2]
