"""Slope of the ground and height of a worm on it, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.estimate import MAX_POSITION_DEVIATION, Estimate
from control.estimation.ground import Ground, GroundTrust, Standing
from control.estimation.reduced import STATES, ReducedState
from worm3d import Worm

TRUST = GroundTrust()
CLIMB = np.array([0.03, -0.02])


def walked(way: np.ndarray, trust: GroundTrust = TRUST) -> Ground:
    """Return the belief after steps along a way on a plane of a known climb."""
    ground = Ground.unknown(trust)
    for place in way:
        ground = ground.sampled(place, 0.4 + float(CLIMB @ place), trust)
    return ground


def test_the_climb_along_the_way_is_found_and_that_across_it_stays_unknown() -> None:
    ahead = np.column_stack([np.linspace(0.0, 4.0, 801), np.zeros(801)])
    ground = walked(ahead)
    assert ground.slope[0] == pytest.approx(CLIMB[0], rel=0.05)
    assert ground.slope[1] == 0.0
    assert ground.covariance[1, 1] < 0.5 * TRUST.slope**2 < TRUST.slope**2 <= ground.covariance[2, 2]
    aside = np.column_stack([np.full(801, 4.0), np.linspace(0.0, 4.0, 801)])
    assert_allclose(walked(np.vstack([ahead, aside])).slope, CLIMB, rtol=0.2)


def test_a_stride_is_one_sample_of_its_mean() -> None:
    ground = walked(np.column_stack([np.linspace(0.0, 0.051, 18), np.zeros(18)]))
    assert ground.place is not None
    assert_allclose(ground.place, [0.0255, 0.0], rtol=1e-9)
    assert ground.mean[0] == pytest.approx(0.4 + CLIMB[0] * 0.0255, abs=1e-6)
    variance = TRUST.standing**2 + TRUST.height**2 / 18
    assert ground.covariance[0, 0] == pytest.approx(variance, rel=1e-4)
    assert len(ground.gathered) == 0


def test_samples_that_scatter_are_trusted_less() -> None:
    way = np.column_stack([np.linspace(0.0, 0.051, 18), np.zeros(18)])
    ground = Ground.unknown(TRUST)
    for k, place in enumerate(way):
        ground = ground.sampled(place, 0.4 + 0.1 * (-1.0) ** k, TRUST)
    assert ground.covariance[0, 0] == pytest.approx(TRUST.standing**2 + 0.1**2 / 17, rel=1e-3)


def test_a_worm_stands_on_its_thickest_segments() -> None:
    """All alike: the half-height that the rhombus has; one that is thicker by more than delta bears nearly all."""
    worm = Worm()
    link, l0 = float(worm.link_length[0]), worm.l0
    standing, strain = Standing(worm), np.full((6, 2), -0.1)
    thick, thin = (np.sqrt(link**2 - (l0 * (1.0 + s) / 2.0) ** 2) for s in (-0.1, 0.1))
    assert standing.height(strain) == pytest.approx(thick)
    strain[1:] = 0.1
    assert thin < standing.height(strain) < thick
    assert standing.height(strain) == pytest.approx(thick, rel=0.01)
    strain[0, 0] = np.nan
    assert standing.height(strain) == pytest.approx(thick, rel=0.02)


@pytest.mark.parametrize(
    ("x", "deviation", "placed"),
    [(0.0, MAX_POSITION_DEVIATION - 0.1, True), (0.0, MAX_POSITION_DEVIATION + 0.1, False), (np.nan, 0.1, False)],
)
def test_a_place_is_known_where_it_is_finite_and_sure(x: float, deviation: float, placed: bool) -> None:
    covariance = np.diag([deviation**2, 0.01, *np.ones(STATES - 2)])
    state = ReducedState(x, 0.0, 0.0, 0.0, 0.0)
    assert Estimate(0.0, state, covariance, None).is_placed(1.0) == placed
    assert Estimate(0.0, state, 4.0 * covariance, None).is_placed(2.0) == placed
