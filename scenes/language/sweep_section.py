"""Sections of a scene that is not run once: [sweep], what is varied, and [study], what is learnt from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from scenes.language.mistakes import Mistake, schema_mistakes
from scenes.language.schema import Section, keys_in, setting

SWEEP, STUDY = "sweep", "study"
"""Names of the sections."""


CASE_LIMIT = 3600.0
"""Default of the longest time of a case, from its first step on [s]. Cases take seconds to minutes. With half of it
long ones fail on slow machines, with double a case that never ends holds up the others longer."""
LONGEST_CASE_LIMIT = 1e7
"""Longest time limit of a case that can be given [s]: 16 weeks. Timers overflow at some hundred times as much, and
half or double of it makes no difference to sweeps."""


class Sweep(Section):
    """Keys that are varied, and how many cases are drawn."""

    vary: dict[str, Any] = setting(
        meaning='keys and their values: { "gait.period_s" = [2, 3], "worm.segments" = "3:7:5" }', aka=("values", "keys")
    )
    random: int | None = setting(ge=1, left_out="none are drawn", meaning="cases drawn from keys given as lo:hi")
    case_limit_s: float = setting(
        CASE_LIMIT, unit="s", gt=0, le=LONGEST_CASE_LIMIT, meaning="longest time of a case; one that takes longer fails"
    )
    choices: dict[str, dict[str, dict[str, Any]]] = setting(
        {},
        meaning='names for values of several keys: { ground = { ice = { "friction.forward" = 0.01 }, felt = {} } }',
    )
    set: dict[str, Any] = setting(
        {}, meaning='keys that follow from varied ones by a formula: { "worm.mass_kg" = "= worm.segments / 60" }'
    )


class Study(Section):
    """What a sweep is to tell."""

    question: str = setting("", meaning="the question that it answers")
    held: str = setting("", meaning="what is the same in all cases")
    measures: dict[str, Literal["more", "less", ""]] = setting(
        {}, meaning='figures of the summary that matter, and which is better: { speed_bl_s = "more" }'
    )
    yes: dict[str, Literal["rises", "falls"]] = setting(
        {},
        meaning='what a figure does along the first varied key if the answer is yes: { cost_of_transport = "falls" }',
    )
    by: str = setting("", meaning="varied key by which cases are brought to equal figures")
    names: dict[str, str] = setting({}, meaning='words for keys, variables and figures: { ratio = "anisotropy" }')
    equal: dict[str, float] = setting(
        {}, meaning="figures at which costs (less is better) are compared too: { speed_bl_s = 0.05 }"
    )
    marked: dict[str, str] = setting(
        {}, meaning='cases to mark, by a formula: { "tips over" = "= roll_margin_deg < 0" }'
    )


class _Outside(Section):
    sweep: Sweep = Sweep(vary={})
    study: Study = Study()


OUTSIDE = tuple(keys_in(_Outside))
"""Sections of a scene's file that do not belong to the scene itself."""


def outside_mistakes(given: Mapping[str, object]) -> list[Mistake]:
    """Return what is wrong with these sections."""
    return schema_mistakes(_Outside, given)


def varied_keys(vary: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of each varied key; those of a table `gait` with a key `period_s` are of `gait.period_s`."""
    found: dict[str, Any] = {}
    for name, values in vary.items():
        inner = isinstance(values, Mapping)
        found |= varied_keys(values, f"{before}{name}.") if inner else {f"{before}{name}": values}
    return found
