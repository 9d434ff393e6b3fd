"""Sections of a scene that is run many times: [sweep], with the varied keys, and [study], with what to evaluate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from scenes.language.schema import Section, setting

SWEEP, STUDY = "sweep", "study"
"""Names of the sections."""


CASE_LIMIT = 3600.0
"""Default time limit of a case [s], counted from the first step. Usual cases take seconds to minutes. With half this
limit, long cases would fail on slow machines. With twice this limit, a case that never ends would delay the sweep
longer."""
LONGEST_CASE_LIMIT = 1e7
"""Largest value that the time limit of a case can have [s], which is 16 weeks. Timers overflow at some hundred times
this value. For sweeps, half or twice this value would make no difference."""


class Sweep(Section):
    """The keys to vary, and the number of cases to draw."""

    vary: dict[str, Any] = setting(
        meaning='keys and their values: { "gait.period_s" = [2, 3], "worm.segments" = "3:7:5" }', aka=("values", "keys")
    )
    random: int | None = setting(ge=1, left_out="none are drawn", meaning="cases drawn from keys given as lo:hi")
    case_limit_s: float = setting(
        CASE_LIMIT, unit="s", gt=0, le=LONGEST_CASE_LIMIT, meaning="longest time of a case; one that takes longer fails"
    )
    choices: dict[str, dict[str, dict[str, Any]]] = setting(
        {}, meaning='names for values of several keys: { ground = { ice = { "friction.forward" = 0.01 }, felt = {} } }'
    )
    set: dict[str, Any] = setting(
        {}, meaning='keys that follow from varied ones by a formula: { "worm.mass_kg" = "= worm.segments / 60" }'
    )


class Study(Section):
    """The results that a sweep is to report."""

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


class Outside(Section):
    """Sections of a scene file that do not belong to the scene itself."""

    sweep: Sweep = Sweep(vary={})
    study: Study = Study()


def varied_keys(vary: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of each varied key, by dotted name. Keys may be nested in tables.

    For example, the key `period_s` in a table `gait` has the name `gait.period_s`.
    """
    found: dict[str, Any] = {}
    for name, values in vary.items():
        inner = isinstance(values, Mapping)
        found |= varied_keys(values, f"{before}{name}.") if inner else {f"{before}{name}": values}
    return found
