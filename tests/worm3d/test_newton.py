"""Parts of Newton's method that are plain functions of vectors and numbers."""

from types import SimpleNamespace

import pytest

from worm3d.solver import newton
from worm3d.solver.evaluate import LOCAL_HESSIAN, NO_HESSIAN


def test_a_step_is_the_last_one_within_the_tolerance() -> None:
    assert newton._converged(0.9e-10, 1.0, 1, 1e-10)
    assert not newton._converged(1.1e-10, 1.0, 1, 1e-10)


def test_steps_that_rounding_keeps_from_shrinking_are_the_last_but_for_the_first_of_a_jacobian() -> None:
    assert newton._converged(5e-13, 6e-13, 2, 1e-14)
    assert not newton._converged(5e-13, 6e-13, 1, 1e-14)
    assert not newton._converged(5e-13, 2e-12, 2, 1e-14), "it still shrinks"
    assert not newton._converged(2e-12, 2e-12, 2, 1e-14), "too large for rounding"


@pytest.mark.parametrize(
    ("segments", "before", "excused"),
    [(6, newton.CONTACT_CHANGED, True), (6, newton.CONTACT_TURNED, False), (9, newton.CONTACT_TURNED, True)],
)
def test_a_step_may_be_large_after_a_contact_has_changed_its_regime(segments: int, before: int, excused: bool) -> None:
    body = SimpleNamespace(n=segments)
    assert newton._excused(body, LOCAL_HESSIAN, before) == excused
    assert not newton._excused(body, NO_HESSIAN, before)
