"""Residual and Jacobian of a whole step, in its band, against central differences of potential and residual."""

import numpy as np
import pytest
from bands import dense
from numpy.testing import assert_allclose

from worm3d import Friction, Plane, Worm
from worm3d.machine.banded import lu_factor, lu_solve
from worm3d.machine.compiled import njit
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import point
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.recorded.state import State
from worm3d.running.plant import Plant
from worm3d.solver import arrays
from worm3d.solver.advance import OK, advance
from worm3d.solver.arrays import Core
from worm3d.solver.evaluate import LOAD_ROW, LOCAL_HESSIAN, NO_HESSIAN, WHOLE_HESSIAN, evaluate
from worm3d.solver.newton import _newton_step
from worm3d.solver.regimes import EXCESS, evaluate_yielding

DT = 0.01
"""[s]"""


def a_plant(friction: Friction, n: int = 5) -> Plant:
    """Return an uneven worm on a slope, two steps after a start in general position: the second one is of BDF2."""
    rng = np.random.default_rng(11)
    worm = Worm(
        segments=n,
        length=0.8,
        half_height=rng.uniform(0.05, 0.07, n),
        k_spring=rng.uniform(5, 30, n),
        k_torsion=rng.uniform(1, 4, n - 1),
        k_yaw=rng.uniform(0.5, 2, n - 1),
        k_twist=rng.uniform(0.5, 2, n - 1),
        cross0=rng.uniform(-0.1, 0.1, n - 1),
        k_apex=rng.uniform(0.05, 0.2, n),
        drag=0.3,
    )
    state = State(
        joints=State.straight(worm, Plane(0.2, 0.4), azimuth=0.3).joints + 0.01 * rng.standard_normal((n + 1, 3)),
        bend=rng.uniform(-0.3, 0.3, n),
        joint_velocity=0.1 * rng.standard_normal((n + 1, 3)),
        roll_rate=rng.standard_normal(n),
        bend_rate=rng.standard_normal(n),
    )
    free = np.zeros(5 * (n + 1), dtype=bool)
    free[-2:] = True  # the last block has neither roll nor bend
    plant = Plant(worm, Plane(0.2, 0.4), friction, np.array([0.3, -0.2, -9.81]), free)
    plant.set_pose(state)
    commands = np.hstack(
        [rng.uniform(0, 0.2, (2, 2 * n)), rng.uniform(-1, 1, (2, 2 * n)), rng.uniform(-0.4, 0.4, (2, n))]
    )
    forces, counters = 0.1 * rng.standard_normal((2, 3, n + 1)), np.zeros((2, arrays.COUNTERS), dtype=np.int64)
    forces, pace = np.concatenate([forces[:1], forces]), np.array([0.0, np.inf, 0.0, 0.0])
    records = plant.records(3)
    given = plant.core, records.block, counters, commands, forces, 0, 1, DT, True, pace, (1, 1, 0)
    assert advance(*given) == (2, OK)
    return plant


def soften(plant: Plant, rng: np.random.Generator) -> None:
    """Make contact and friction soft enough for differences, and stuck and sliding points common."""
    points, layout = plant.arrays["point_in"], point.POINT_LAYOUT
    touching = points[layout.first("stiffness")] > 0.0
    reach = rng.choice([0.001, 0.05], points.shape[1])
    anchor = slice(layout.first("anchor"), layout.first("anchor") + 3)
    points[anchor] = points[:3] + reach * rng.standard_normal((3, points.shape[1]))
    values = {"stiffness": 300.0 * touching, "damping": 2.0 * touching, "yield_gauge": 0.003, "gauge_damping": 2.0}
    values |= {"load": rng.uniform(0.5, 2.0, points.shape[1]), "slide_n": 0.001}
    damping, drag, depth = 2.0 * touching / DT, 2.0 / DT, points[layout.first("depth_n")]
    stiff, r = 300.0 * touching + damping, 1.0 / (1.0 / 0.003 + drag)
    values |= {"stiff": stiff, "carried": damping * depth / np.maximum(stiff, 1.0), "r": r, "centre": drag * r * 0.001}
    for name, value in values.items():
        first = layout.first(name)
        points[first : first + layout.sizes[name]] = value


@pytest.mark.parametrize("coupled", [False, True])
def test_whole_step_against_central_differences(coupled: bool) -> None:
    """Potential, residual and banded Jacobian of a BDF2 step with everything switched on, half of the worm sunk in."""
    plant = a_plant(Friction(0.3, 0.6, 0.4))
    x, gradient, size = plant.arrays["x"][0], plant.arrays["gradient"][0], plant.arrays["x"].size
    rng = np.random.default_rng(12)
    x[:] += 0.003 * rng.standard_normal(size)
    x[2::BLOCK_SIZE] -= 0.03
    x[3:-BLOCK_SIZE:BLOCK_SIZE] += 0.2 * rng.standard_normal(plant.n)  # rolls
    x[-2:] = 0.0
    at, h = x.copy(), 1e-6
    evaluate(plant.core, arrays.X, coupled, WHOLE_HESSIAN)
    soften(plant, rng)
    evaluate(plant.core, arrays.X, coupled, WHOLE_HESSIAN)
    matrix, residual = dense(plant.arrays["band"][:size]), gradient.copy()
    loads, out = plant.arrays["point_out"][LOAD_ROW], plant.arrays["yielding_out"]
    evaluate_yielding(plant.core)
    sliding = (out[EXCESS] > 0.0) & (loads > 0.0)
    assert sliding.sum() >= 3
    assert (loads > 0.0).sum() - sliding.sum() >= 3
    columns, slopes = np.zeros((size, size)), np.zeros(size)
    for k in range(size - 2):
        for step, weight in ((h, 8.0), (-h, -8.0), (2 * h, -1.0), (-2 * h, 1.0)):
            x[:] = at
            x[k] += step
            slopes[k] += weight * evaluate(plant.core, arrays.X, coupled, NO_HESSIAN) / (12 * h)
            columns[:, k] += weight * gradient / (12 * h)
    scale = np.abs(columns).max()
    assert_allclose(matrix, columns, rtol=0, atol=1e-8 * scale)
    asymmetry = np.abs(matrix - matrix.T).max()
    assert (asymmetry > 1e-3 * scale) == coupled
    if not coupled:
        assert_allclose(residual, slopes, rtol=0, atol=1e-8 * np.abs(residual).max())
        assert asymmetry < 1e-13 * scale


@njit
def newton_step(core: Core, hessian: int) -> float:
    return float(_newton_step(core, hessian))


@pytest.mark.parametrize("n", [5, 11])
def test_a_contact_that_changes_is_exchanged_in_the_jacobian(n: int) -> None:
    """With other regimes, but the forces that were foreseen, Jacobian and step are those that would be made anew."""
    plant = a_plant(Friction(0.3, 0.6, 0.4), n)
    points, band, size = plant.arrays["point_in"], plant.arrays["band"], plant.arrays["x"].size
    rng = np.random.default_rng(13)
    soften(plant, rng)
    regime, foreseen = (points[point.POINT_LAYOUT.first(name)] for name in ("regime", "foreseen"))
    touching = points[point.POINT_LAYOUT.first("stiffness")] > 0.0
    regime[:], foreseen[:] = point.STICKING_FORWARD, 1.0
    newton_step(plant.core, WHOLE_HESSIAN)
    before = band[:size].copy()
    of_head = np.arange(touching.size) % (touching.size // POINTS_PER_SEGMENT) >= n // 2
    chosen = rng.permutation(np.flatnonzero(touching & of_head))[:7]
    for some in (chosen[:4], chosen[4:], chosen[:1]):  # one of them twice
        regime[some] = np.where(regime[some] == point.SLIDING, point.STICKING_BACK, point.SLIDING)
        plant.arrays["changed"][0, some] = 1.0
        newton_step(plant.core, LOCAL_HESSIAN)
        assert not plant.arrays["changed"].any()
    exchanged, residual, step = (plant.arrays[name].copy() for name in ("band", "gradient", "direction"))
    exchanged = exchanged[:size]
    newton_step(plant.core, WHOLE_HESSIAN)
    scale = np.abs(before).max()
    assert_allclose(exchanged, band[:size], rtol=0, atol=1e-12 * scale)
    assert_allclose(residual, plant.arrays["gradient"], rtol=0, atol=1e-12 * np.abs(residual).max())
    assert_allclose(step, plant.arrays["direction"], rtol=0, atol=1e-9 * np.abs(step).max())
    assert np.abs(exchanged - before).max() > 1e-3 * scale


def test_what_is_not_said_to_have_changed_stays_in_the_jacobian() -> None:
    plant = a_plant(Friction(0.3, 0.6, 0.4))
    soften(plant, np.random.default_rng(13))
    evaluate(plant.core, arrays.X, True, WHOLE_HESSIAN)
    before = plant.arrays["band"].copy()
    plant.arrays["point_in"][point.POINT_LAYOUT.first("regime")] = point.SLIDING
    evaluate(plant.core, arrays.X, True, LOCAL_HESSIAN)
    np.testing.assert_array_equal(plant.arrays["band"], before)


def test_the_jacobian_fits_into_the_groups_of_the_linear_solver() -> None:
    """A block and the 8 coordinates behind it; two that nothing but the mask holds stay."""
    plant = a_plant(Friction(0.3, 0.6, 0.4))
    size, band = plant.arrays["x"].size, plant.arrays["band"]
    within = np.zeros((size, size), dtype=bool)
    for first in range(0, size, BLOCK_SIZE):
        within[first : first + 13, first : first + 13] = True
    evaluate(plant.core, arrays.X, True, WHOLE_HESSIAN)
    matrix, residual = dense(band[:size]), plant.arrays["gradient"][0]
    assert not matrix[~within].any()
    assert np.count_nonzero(matrix) > 0.8 * np.count_nonzero(within)
    step, free = residual.copy(), slice(0, size - 2)
    lu_factor(band, plant.arrays["factor"])
    lu_solve(plant.arrays["factor"], step)
    expected = np.linalg.solve(matrix[free, free], residual[free])
    assert_allclose(step[free], expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    assert not step[size - 2 :].any()
