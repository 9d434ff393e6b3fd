"""Parts of Newton's method that are plain functions of vectors and numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from worm3d import Friction, Plane, Worm
from worm3d.machine.compiled import njit
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.running.plant import Plant
from worm3d.running.problem import held_mask
from worm3d.solver import newton
from worm3d.solver.arrays import Core
from worm3d.solver.evaluate import LOCAL_HESSIAN, NO_HESSIAN


@njit
def first_changed(core: Core) -> int:
    return newton._first_changed(core)


def test_the_jacobian_is_factored_anew_from_the_first_segment_on_that_has_a_changed_contact() -> None:
    """In a body of three vectors of segments, for each contact alone and with one of the last segment's."""
    worm, gravity = Worm(segments=20), np.array([0.0, 0.0, -9.81])
    plant = Plant(worm, Plane(), Friction(), gravity, held_mask(None, 20, flat=worm.flat, clamped=False))
    changed = plant.arrays["changed"].reshape(POINTS_PER_SEGMENT, -1)
    assert first_changed(plant.core) == 0
    for others in (0.0, 1.0):
        for point in range(POINTS_PER_SEGMENT):
            for segment in range(20):
                changed[:, 19], changed[point, segment] = others, 1.0
                assert first_changed(plant.core) == BLOCK_SIZE * segment
                changed[:] = 0.0


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
