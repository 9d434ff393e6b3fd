"""The section [sweep] of a scene: the keys that are varied where the scene is not run once but as a sweep."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scenes.language.mistakes import Mistake, schema_mistakes
from scenes.language.schema import Section, quantity, setting

SWEEP = "sweep"
"""Name of the section."""


class Sweep(Section):
    """Keys that are varied, and how many cases are drawn."""

    vary: dict[str, Any] = setting(
        title='keys and their values: { "gait.period_s" = [2, 3], "worm.segments" = "3:7:5" }', aka=("values", "keys")
    )
    random: int | None = quantity(ge=1, left_out="none are drawn", title="cases drawn from keys given as lo:hi")


class _Swept(Section):
    sweep: Sweep


def sweep_mistakes(given: object) -> list[Mistake]:
    """Return what is wrong with the section."""
    return schema_mistakes(_Swept, {SWEEP: given})


def varied_keys(vary: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of each varied key; those of a table `gait` with a key `period_s` are of `gait.period_s`."""
    found: dict[str, Any] = {}
    for name, values in vary.items():
        inner = isinstance(values, Mapping)
        found |= varied_keys(values, f"{before}{name}.") if inner else {f"{before}{name}": values}
    return found
