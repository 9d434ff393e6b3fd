"""Scene of a study: the corrected planar worm with one number of it varied."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from planar.linkage.simulate import bytes_per_step
from scenes.language.checks import Check, Found, cross_mistakes
from scenes.language.mistakes import dotted, schema_mistakes
from scenes.language.schema import Numbers, Section, field_at, is_number, quantity, setting
from scenes.models.checks import RUN_CHECKS, too_much_memory
from scenes.models.planar.linkage_checks import RULES
from scenes.models.planar.linkage_scene import LinkageScene, LinkageSettings

VARIABLE = ("worm", "friction", "ground", "gait")
"""Sections whose numbers may be varied; all cases share the time steps."""


class Study(Section):
    """What is varied."""

    vary: str = setting("worm.segments", title="the number that is varied, such as gait.period_s", aka=("key",))
    values: Numbers = quantity((3, 4, 5, 6, 7), title="its value in each case, in place of the scene's own")


class StudyScene(LinkageSettings):
    """A whole scene."""

    model: Literal["planar_study"] = setting(title="which simulation the scene is for")
    study: Study = Study()

    @property
    def steps(self) -> int:
        """Number of time steps of all cases."""
        return self.run.steps * len(self.study.values)

    def case(self, value: float) -> LinkageScene:
        """Return the scene of one case."""
        sections = self.model_dump(include={"run", *VARIABLE}, exclude_none=True)
        return LinkageScene.model_validate(case_data(sections, self.study.vary, value))


def case_data(sections: Mapping[str, Any], vary: str, value: float) -> dict[str, Any]:
    """Return the scene of one case as data."""
    section, key = vary.split(".")
    field = field_at(LinkageScene, (section, key))
    assert field is not None
    number = int(value) if field.annotation is int and float(value).is_integer() else value
    return {"model": "planar_linkage", **sections, section: {**sections[section], key: number}}


def _is_a_number(vary: str) -> str | None:
    path = tuple(vary.split("."))
    field = field_at(LinkageScene, path) if len(path) == 2 and path[0] in VARIABLE else None
    if field is not None and is_number(field):
        return None
    return f"got '{vary}': must be a number of {', '.join(VARIABLE)}, such as worm.segments or gait.period_s"


def _cases_are_right(values: tuple[float, ...], vary: str, *sections: Mapping[str, Any]) -> str | None:
    data = dict(zip(("run", *VARIABLE), sections, strict=True))
    return next((text for value in values for text in _case_mistakes(data, vary, value)), None)


def _case_mistakes(sections: Mapping[str, Any], vary: str, value: float) -> Iterator[str]:
    case = case_data(sections, vary, value)
    found = schema_mistakes(LinkageScene, case)
    for mistake in (*found, *cross_mistakes(RULES, LinkageScene, case, found)):
        yield f"with {vary} = {value:g}: {dotted(mistake.path)}: {mistake.text}"


def _fits_into_memory(dt_s: float, duration_s: float, values: tuple[float, ...], vary: str, segments: int) -> Found:
    numbers = [int(value) for value in values] if vary == "worm.segments" else [segments] * len(values)
    steps = duration_s / dt_s
    needed = sum(steps * bytes_per_step(number) for number in numbers)
    return too_much_memory(needed, steps * len(numbers), max(numbers))


CHECKS = (
    *RUN_CHECKS,
    Check(("run.dt_s", "run.duration_s", "study.values", "study.vary", "worm.segments"), _fits_into_memory),
    Check(("study.vary",), _is_a_number),
    Check(("study.values", "study.vary", "run", *VARIABLE), _cases_are_right),
)
