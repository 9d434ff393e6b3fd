"""Gauss and Newton in a box: known minima, the certificate, mirror images, and how it says that it failed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.planning.gauss_newton import GaussNewton, PlanStatus, half_square

BOX = np.full(2, -2.0), np.full(2, 2.0)


def rosenbrock(z):
    return np.array([10.0 * (z[1] - z[0] ** 2), 1.0 - z[0]])


def rosenbrock_slopes(z):
    return rosenbrock(z), np.array([[-20.0 * z[0], 10.0], [-1.0, 0.0]])


def test_projection_on_a_box_takes_one_step() -> None:
    wanted = np.array([0.3, -5.0, 1.0, 9.0])
    bound = np.full(4, 2.0)
    found = GaussNewton(4, 5).minimise(
        lambda z: z - wanted, lambda z: (z - wanted, np.eye(4)), np.zeros(4), -bound, bound
    )
    assert_allclose(found.z, [0.3, -2.0, 1.0, 2.0], atol=1e-8)
    assert (found.outcome, found.iterations) == (PlanStatus.OPTIMAL, 2)
    assert found.certificate < 1e-8
    assert found.cost == pytest.approx((3.0**2 + 7.0**2) / 2.0)


def test_the_certificate_is_the_greatest_way_that_the_gradient_leads_within_the_box() -> None:
    wanted, start = np.array([0.3, 0.1, 5.0]), np.array([0.2, 0.5, 2.0])
    gradient = start - wanted
    found = GaussNewton(3, 1).minimise(
        lambda z: z - wanted, lambda z: (z - wanted, np.eye(3)), start, -np.full(3, 2.0), np.full(3, 2.0)
    )
    assert found.outcome is PlanStatus.BETTER
    assert found.certificate == pytest.approx(gradient[1]), "the third is held by its bound"


def test_rosenbrocks_valley_to_its_end_and_with_a_bound_in_the_way() -> None:
    free = GaussNewton(2, 100).minimise(rosenbrock, rosenbrock_slopes, np.array([-1.2, 1.0]), *BOX)
    assert_allclose(free.z, [1.0, 1.0], atol=1e-5)
    upper = np.array([0.5, 2.0])
    held = GaussNewton(2, 100).minimise(rosenbrock, rosenbrock_slopes, np.array([-1.2, 1.0]), BOX[0], upper)
    assert_allclose(held.z, [0.5, 0.25], atol=1e-5)  # the valley is z1 = z0^2
    for found in (free, held):
        assert found.outcome is PlanStatus.OPTIMAL
        assert found.certificate < 1e-2


def test_the_result_is_better_than_its_neighbours_in_the_box() -> None:
    upper = np.array([0.5, 2.0])
    found = GaussNewton(2, 100).minimise(rosenbrock, rosenbrock_slopes, np.array([-1.2, 1.0]), BOX[0], upper)
    random = np.random.default_rng(3)
    for _ in range(200):
        near = np.clip(found.z + 1e-2 * random.normal(size=2), BOX[0], upper)
        assert half_square(rosenbrock(near)) >= found.cost - 1e-9


def test_every_iterate_is_in_the_box_and_better() -> None:
    costs = []
    for budget in range(1, 12):
        found = GaussNewton(2, budget).minimise(rosenbrock, rosenbrock_slopes, np.array([-1.2, 1.0]), *BOX)
        assert (np.abs(found.z) <= 2.0).all()
        costs.append(found.cost)
    assert (np.diff(costs) <= 0.0).all()
    assert costs[0] < half_square(rosenbrock(np.array([-1.2, 1.0])))


@pytest.mark.parametrize("seed", range(20))
def test_no_residual_is_asked_for_beyond_the_box_and_no_point_is_beyond_it_by_rounding(seed: int) -> None:
    random, asked = np.random.default_rng(seed), []
    a, b = random.normal(size=(9, 6)), 3.0 * random.normal(size=9)
    lower, upper = -random.uniform(0.1, 1.0, 6), random.uniform(0.1, 1.0, 6)

    def residuals(z):
        asked.append(z)
        return a @ z - b + 0.3 * z[0] ** 2

    def slopes(z):
        return residuals(z), a + 0.6 * z[0] * np.eye(6)[0]

    found = GaussNewton(6, 4).minimise(residuals, slopes, random.uniform(lower, upper), lower, upper)
    assert np.maximum(lower - asked, asked - upper).max() < 1e-12
    assert ((found.z >= lower) & (found.z <= upper)).all()
    assert np.minimum(found.z - lower, upper - found.z).min() < 1e-12, "it must come to a bound"
    assert found.cost == pytest.approx(half_square(residuals(found.z)), rel=1e-12)


def test_a_mirrored_problem_has_mirrored_iterates_to_the_last_bit() -> None:
    random = np.random.default_rng(5)
    a, b = random.normal(size=(9, 4)), random.normal(size=9)
    flip = np.array([1.0, -1.0, 1.0, -1.0])
    bound = np.full(4, 0.2)

    def solved(signs):
        def residuals(z):
            return a @ (signs * z) - b + 0.3 * (signs * z)[0] ** 2

        def slopes(z):
            square = np.zeros((9, 4))
            square[:, 0] = 0.6 * (signs * z)[0] * signs[0]
            return residuals(z), a * signs + square

        return GaussNewton(4, 6).minimise(residuals, slopes, np.zeros(4), -bound, bound)

    assert_array_equal(solved(np.ones(4)).z, flip * solved(flip).z)


def test_a_direction_that_no_residual_sees_is_left_alone() -> None:
    bound = np.full(2, 2.0)
    found = GaussNewton(2, 3).minimise(
        lambda z: z[:1] - 1.0, lambda z: (z[:1] - 1.0, np.array([[1.0, 0.0]])), np.array([0.0, 0.5]), -bound, bound
    )
    assert found.outcome is PlanStatus.OPTIMAL
    assert_allclose(found.z, [1.0, 0.5], atol=1e-8)


def test_a_negligible_decrease_ends_the_search_where_it_is() -> None:
    """The promised decrease of a linear problem is the true one: half the square of the distance."""
    wanted, bound = np.zeros(2), np.full(2, 2.0)
    for decrease, outcome in ((0.8e-6, PlanStatus.OPTIMAL), (1.2e-6, PlanStatus.BETTER)):
        start = np.array([np.sqrt(2.0 * decrease), 0.0])
        found = GaussNewton(2, 1).minimise(
            lambda z: z - wanted, lambda z: (z - wanted, np.eye(2)), start, -bound, bound
        )
        assert found.outcome is outcome
        assert_allclose(found.z, start if outcome is PlanStatus.OPTIMAL else wanted, atol=1e-9)


def test_it_says_how_it_failed() -> None:
    start, method = np.array([0.5, 0.5]), GaussNewton(2, 5)
    nowhere = method.minimise(rosenbrock, lambda z: (np.full(2, np.nan), np.eye(2)), start, *BOX)
    assert (nowhere.outcome, nowhere.iterations) == (PlanStatus.NOT_FINITE, 0)
    assert_array_equal(nowhere.z, start)
    wrong_way = method.minimise(lambda z: z, lambda z: (z, -np.eye(2)), start, *BOX)
    assert (wrong_way.outcome, wrong_way.iterations) == (PlanStatus.NOT_BETTER, 1)
    assert_array_equal(wrong_way.z, start)
    short = GaussNewton(2, 1).minimise(rosenbrock, rosenbrock_slopes, np.array([-1.2, 1.0]), *BOX)
    assert (short.outcome, short.iterations) == (PlanStatus.BETTER, 1)


@pytest.mark.parametrize(("bound", "expected"), [(1.0, 1.1), (5.0, 2.0)])
def test_what_exceeds_a_limit_weighs_like_a_miss_and_what_keeps_it_weighs_nothing(bound, expected) -> None:
    """(z - 2)^2 + max(0, 3 (z - bound))^2 is least at z = (2 + 9 bound) / 10 if that exceeds the bound, else at 2."""
    slopes = np.array([[1.0], [3.0]])

    def residuals(z):
        return np.array([z[0] - 2.0, 3.0 * (z[0] - bound)])

    box = np.array([-10.0]), np.array([10.0])
    found = GaussNewton(1, 3).minimise(residuals, lambda z: (residuals(z), slopes), np.array([-4.0]), *box, limits=1)
    assert found.outcome is PlanStatus.OPTIMAL
    assert_allclose(found.z, expected, rtol=1e-7)
    assert found.cost == pytest.approx(half_square(residuals(found.z), 1))
    assert found.certificate < 1e-6


def test_what_is_negligible_is_so_beside_the_cost() -> None:
    """A decrease of 5e-3 ends the search beside a cost of 5e5, not beside none."""
    found = []
    for rest in (1e3, 0.0):
        residuals = lambda z, rest=rest: np.array([rest, z[0] - 0.1])  # noqa: E731
        slopes = lambda z, residuals=residuals: (residuals(z), np.array([[0.0], [1.0]]))  # noqa: E731
        found.append(GaussNewton(1, 5).minimise(residuals, slopes, np.zeros(1), -np.ones(1), np.ones(1)))
    assert [each.outcome for each in found] == [PlanStatus.OPTIMAL] * 2
    assert_array_equal(found[0].z, 0.0)
    assert_allclose(found[1].z, 0.1, atol=1e-9)
