"""The keys of a scene that a fit varies, each with a range and a start value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scenes.language.errors import SceneError
from scenes.language.mistakes import meant_key
from scenes.language.schema import Key, key_at
from scenes.language.toml import path_of
from scenes.models.loading import Scene
from scenes.sweep.links import value_at

Wanted = Sequence[str] | Mapping[str, tuple[float, float] | None]
"""Keys to vary: a sequence of strings `key` or `key=lo:hi`, or a mapping from keys to ranges (lo, hi). A range of None
means the range that the key has in all scenes."""


@dataclass(frozen=True)
class Varied:
    """A key that a fit varies."""

    key: str
    """Dotted name, such as `friction.forward`."""
    start: float
    """Initial value of the search."""
    low: float
    """Lower end of the range; may be infinite."""
    high: float
    """Upper end of the range; may be infinite."""
    unit: str
    """Unit; "1" for a dimensionless key."""
    title: str
    """Meaning of the key, in a few words."""

    @property
    def scale(self) -> float:
        """Magnitude of the start value. If the start value is 0, the width of the range, or 1 if it is infinite."""
        width = self.high - self.low
        return abs(self.start) or (width if math.isfinite(width) else 1.0)


def varied_of(scene: Scene, wanted: Wanted) -> tuple[Varied, ...]:
    """Return the varied keys with their ranges and start values.

    The start value is the scene's value. If the scene has no value for the key, it is the middle of the range.

    Raises
    ------
    SceneError
        No key is given, a key is given twice, a key is unknown or not a real number, or a range is invalid or does not
        contain the scene's value.
    """
    ranges = wanted if isinstance(wanted, Mapping) else _parsed(wanted)
    if not ranges:
        raise SceneError("nothing to fit: name at least one key of the scene, such as --vary friction.forward")
    return tuple(_varied(scene, key, given) for key, given in ranges.items())


def _parsed(wanted: Sequence[str]) -> dict[str, tuple[float, float] | None]:
    ranges: dict[str, tuple[float, float] | None] = {}
    for text in wanted:
        key, equals, span = text.partition("=")
        if path_of(key) in map(path_of, ranges):
            raise SceneError(f"--vary {key.strip()}: given twice, must be there once")
        ranges[key.strip()] = _range(key.strip(), span) if equals else None
    return ranges


def _range(key: str, text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise SceneError(
            f"--vary {key}: got '{text}', must be a range lo:hi of two numbers, or no range: --vary {key}"
        ) from None
    return low, high


def _varied(scene: Scene, key: str, given: tuple[float, float] | None) -> Varied:
    path = path_of(key)
    known = key_at(scene.model.schema, path) if all(path) else None
    value = value_at(scene.settings, key, KeyError)
    if known is None or value is KeyError:
        meant = meant_key(scene.model.schema, path) if all(path) else None
        guess = f"; did you mean '{meant}'?" if meant else ";"
        raise SceneError(
            f"--vary {key}: the scene {scene.name} has no such key{guess} 'worm3d init FILE' lists all keys"
        )
    if not known.is_number:
        raise SceneError(f"--vary {key}: is no number, a fit varies numbers")
    if isinstance(value, tuple | str):
        raise SceneError(f"--vary {key}: got {value!r} in the scene, must be one number; set it with -o {key}=NUMBER")
    if known.is_whole:
        raise SceneError(f"--vary {key}: is an integer, a fit varies real numbers; 'worm3d sweep' varies any key")
    low, high = _bounds(known, value)
    if given is not None:
        if not (math.isfinite(given[0]) and math.isfinite(given[1]) and given[0] < given[1]):
            raise SceneError(f"--vary {key}: got {given[0]:g}:{given[1]:g}, must be two finite numbers lo < hi")
        if not (low <= given[0] and given[1] <= high):
            raise SceneError(f"--vary {key}: got {given[0]:g}:{given[1]:g}, must lie within {known.span}")
        low, high = given
    if value is None and given is None:
        raise SceneError(f"--vary {key}: left out in the scene, so there is no start; give a range, {key}=lo:hi")
    if value is not None and not low <= value <= high:
        raise SceneError(
            f"--vary {key}: the fit starts from {value:g}, must lie within {low:g}:{high:g}; start elsewhere with "
            f"-o {key}=NUMBER, or widen the range"
        )
    start = 0.5 * (low + high) if value is None else float(value)
    return Varied(key, start, low, high, known.unit_or_one, known.meaning_in_section)


def _bounds(known: Key, value: float | None) -> tuple[float, float]:
    """Return the range of a key. An end that is not allowed itself is moved inwards by 1e-6 of the scene's value."""
    bounds = known.bounds
    hair = 1e-6 * (abs(value) if value else 1.0)
    low = bounds.get("ge", bounds["gt"] + hair if "gt" in bounds else -math.inf)
    high = bounds.get("le", bounds["lt"] - hair if "lt" in bounds else math.inf)
    return low, high
