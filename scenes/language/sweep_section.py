"""Sections of a scene that is run many times: [sweep] with the varied keys, and [study] with the conclusions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from scenes.language.schema import Section, setting

SWEEP, STUDY = "sweep", "study"
"""Names of the sections."""


CASE_LIMIT = 3600.0
"""Default of the maximum computing time of a case, counted from its first step [s]. Most cases take seconds to minutes.
A smaller limit would make long cases fail on slow machines. With a larger limit, a case that never ends would delay the
other cases longer."""
LONGEST_CASE_LIMIT = 1e7
"""Largest value that a user may set as the limit [s], 16 weeks. Timers overflow at a few hundred times this value."""


class Sweep(Section):
    """The keys that a sweep varies."""

    vary: dict[str, Any] = setting(
        meaning='keys and their values: { "gait.period_s" = [2, 3], "worm.segments" = "3:7:5" }', aka=("values", "keys")
    )
    random: int | None = setting(
        ge=1, left_out="no random cases", meaning="number of random cases, for keys with values lo:hi"
    )
    case_limit_s: float = setting(
        CASE_LIMIT,
        unit="s",
        gt=0,
        le=LONGEST_CASE_LIMIT,
        meaning="maximum computing time of a case; a slower case fails",
    )
    choices: dict[str, dict[str, dict[str, Any]]] = setting(
        {}, meaning='names for values of several keys: { ground = { ice = { "friction.forward" = 0.01 }, felt = {} } }'
    )
    set: dict[str, Any] = setting(
        {}, meaning='keys computed from varied keys by a formula: { "worm.mass_kg" = "= worm.segments / 60" }'
    )


class Study(Section):
    """The conclusions that a sweep reports. A figure is a number in the summary of a run."""

    question: str = setting("", meaning="the question that the study answers")
    held: str = setting("", meaning="conditions that are the same in all cases, in words")
    measures: dict[str, Literal["more", "less", ""]] = setting(
        {}, meaning='figures of the summary to report, and whether more or less is better: { speed_bl_s = "more" }'
    )
    yes: dict[str, Literal["rises", "falls"]] = setting(
        {},
        meaning="whether a figure rises or falls with the first varied key if the answer to the question is yes: "
        '{ cost_of_transport = "falls" }',
    )
    by: str = setting("", meaning="varied key that is adjusted so that cases have equal figures (see equal)")
    names: dict[str, str] = setting(
        {}, meaning='names of keys, variables and figures in the report: { ratio = "anisotropy" }'
    )
    equal: dict[str, float] = setting(
        {}, meaning="figures for whose equal values costs (less is better) are also compared: { speed_bl_s = 0.05 }"
    )
    marked: dict[str, str] = setting(
        {}, meaning='marks for the cases whose formula is true: { "tips over" = "= roll_margin_deg < 0" }'
    )


class Outside(Section):
    """Sections of a scene file that do not belong to the scene itself."""

    sweep: Sweep = Sweep(vary={})
    study: Study = Study()


def varied_keys(vary: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of each varied key by its dotted name.

    The dotted name of a key `period_s` in a table `gait` is `gait.period_s`.
    """
    found: dict[str, Any] = {}
    for name, values in vary.items():
        inner = isinstance(values, Mapping)
        found |= varied_keys(values, f"{before}{name}.") if inner else {f"{before}{name}": values}
    return found
