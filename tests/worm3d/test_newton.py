"""Parts of Newton's method that are plain functions of vectors and numbers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from worm3d.solver import newton


@pytest.mark.parametrize("stiffer", [1.15, 0.9])
def test_broydens_correction_leads_to_the_solution_of_a_linear_system(stiffer: float) -> None:
    """The residual is J e, e being the error of x; by a Jacobian J/stiffer every step is stiffer times the error."""
    error = np.array([0.3, -0.2, 0.5])
    before = stiffer * error
    step = stiffer * (error - before)
    newton._correct(step, before)
    assert_allclose(error - before - step, 0.0, atol=1e-15)


def test_broydens_correction_leaves_a_step_that_the_one_before_does_not_explain() -> None:
    for share in (0.5, -0.5):
        step, before = share * np.array([1.0, 2.0]), np.array([1.0, 2.0])
        newton._correct(step, before)
        assert_array_equal(step, share * before)
    step = np.array([2.0, -1.0])
    newton._correct(step, np.array([1.0, 2.0]))
    assert_array_equal(step, [2.0, -1.0])
