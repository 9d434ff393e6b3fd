"""2D = 3D for random worms: the study `planar_worms.py` with few steps; WORM3D_PLANAR_STEPS asks for more."""

import os

import numpy as np
import planar_worms as study
import pytest

from planar import linkage

STEPS = int(os.environ.get("WORM3D_PLANAR_STEPS", "20"))
COUNT = 80


@pytest.fixture(scope="module")
def outcomes() -> list[study.Outcome]:
    return [study.outcome(study.case(1, index), STEPS) for index in range(COUNT)]


@pytest.mark.slow
def test_all_agree_but_for_steps_with_two_solutions(outcomes: list[study.Outcome]) -> None:
    """At least 99 % to 1e-9 m; a step with high coefficients may have several solutions, and both found one."""
    admitted = [one for one in outcomes if not one.refused]
    assert len(admitted) > 0.95 * COUNT
    assert sum(one.agree for one in admitted) >= 0.99 * len(admitted), [one for one in admitted if not one.agree]
    for one in admitted:
        assert one.agree or one.two_solutions, one


def test_the_check_of_a_step_tells_solutions_from_others() -> None:
    """What `planar.linkage` found solves its step; the place a micrometre beside it or the one before does not."""
    it = study.case(1, 3)
    run = linkage.simulate(
        linkage.Linkage(**it.worm),
        it.gait,
        duration=12 * it.dt,
        dt=it.dt,
        friction=linkage.Friction(*it.friction),
        slope=it.slope,
    )
    for step in (1, 12):
        slid, found = run.slip[step - 1], run.joints[step]
        near = study.solution_near(it, run, step, found + 1e-10, slid)
        assert near is not None
        np.testing.assert_allclose(near, found, rtol=0, atol=1e-11)
        assert study.solution_near(it, run, step, found + 1e-6, slid) is None
        assert study.solution_near(it, run, step, run.joints[step - 1], slid) is None


def test_a_case_is_always_the_same() -> None:
    one, same, other = study.case(1, 3), study.case(1, 3), study.case(1, 4)
    assert one.sentence == same.sentence != other.sentence
    np.testing.assert_array_equal(one.gait(0.3), same.gait(0.3))
