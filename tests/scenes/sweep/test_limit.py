"""Time limit of a case: from its first step on, and only as long as a sweep may wait."""

import pytest

from scenes.language.errors import SceneError
from scenes.language.sweep_section import CASE_LIMIT, LONGEST_CASE_LIMIT
from scenes.sweep import limit


def test_the_time_of_a_case_counts_from_its_first_step_on(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, now = limit.Clock(10.0), [100.0]
    monkeypatch.setattr(limit.time, "monotonic", lambda: now[0])
    now[0] = 500.0
    assert not clock.is_over, "it has not begun"
    assert clock.looks()
    for now[0], over in ((509.9, False), (510.1, True)):
        assert clock.is_over == over
        assert clock.looks() != over


@pytest.mark.parametrize(
    ("sweep", "asked", "found"),
    [({}, None, CASE_LIMIT), ({"case_limit_s": 5}, None, 5.0), ({"case_limit_s": 5}, 7.0, 7.0), ({}, 0.5, 0.5)],
)
def test_the_limit_is_the_one_asked_for_or_that_of_the_scene(sweep, asked: float | None, found: float) -> None:
    assert limit.limit_of(sweep, asked) == found


@pytest.mark.parametrize("wrong", [0.0, -1.0, LONGEST_CASE_LIMIT * 1.01, float("nan")])
def test_a_limit_that_is_none_is_refused(wrong: float) -> None:
    with pytest.raises(SceneError, match="must be above 0 and at most"):
        limit.limit_of({}, wrong)
    assert limit.limit_of({}, LONGEST_CASE_LIMIT) == LONGEST_CASE_LIMIT
