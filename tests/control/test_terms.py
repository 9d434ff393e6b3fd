"""Terms of the cost in numbers, and that all lengths among them count in body lengths."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.ground import GroundTrust
from control.estimation.kalman import Uncertainty
from control.identification.identified import load
from control.planning.feed_forward import FeedForward
from control.planning.suited import suited
from control.planning.terms import WALLED, Arrival, Change, CostTerm, Frequency, Heading, Offset, Speed, Steering
from control.tracking.preview import Preview
from worm3d import Worm

FOUND = load(Worm()).maps["hinge"]
AT = SimpleNamespace(
    state=SimpleNamespace(heading=ca.SX(0.5)),
    offset=ca.SX(0.1),
    speed=ca.SX(0.2),
    sideways=ca.SX(0.02),
    scaled=ca.SX([0.1, 0.4, -0.6]),
    before=ca.SX([0.4, 0.0, 0.4]),
    wanted=SimpleNamespace(speed=ca.SX(0.1), heading=ca.SX(0.2), crab=ca.SX(5.0), frequency=ca.SX(0.7)),
    length=2.0,
)
"""A worm of 2 m."""


@pytest.mark.parametrize(
    ("term", "misses"),
    [
        (Speed(0.004, large=1e6), [0.1 / 2.0 / 0.004]),
        (Offset(0.01), [0.1 / 2.0 / 0.01]),
        (Arrival(0.01), [0.1 / 2.0 / 0.01]),
        (Heading(0.07, large=1e6), [(0.5 - 0.2 + 5.0 * 0.02) / 0.07]),
        (Change(0.3, 0.2, 0.25), [-0.3 / 0.3, 0.4 / 0.2, -1.0 / 0.25]),
        (Frequency(2.0), [(0.4 - 0.7) / 2.0]),
        (Steering(0.2), [-0.6 / 0.2]),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, CostTerm) else "",
)
def test_misses_are_over_their_tolerances(term: CostTerm, misses: list[float]) -> None:
    assert_allclose(np.array(ca.DM(term.misses(AT))).ravel(), misses, rtol=1e-9)


def test_the_arrival_counts_an_offset_as_it_dies_away_by_the_other_terms() -> None:
    """Least squares of offset and heading let it die away over L = a_e/a_h, so that an endless horizon adds L/2."""
    assert Arrival().tolerance == Offset().tolerance
    assert_allclose(Arrival().way, Offset().tolerance / Heading().tolerance)


def test_a_large_miss_costs_what_it_is_and_a_small_one_its_square() -> None:
    """(O7) of misses of 0.1 and 0.001 body lengths/s, with 0.02 for large."""
    term, large = Speed(0.004, large=0.02), 0.02
    for miss in (0.1, -0.1, 0.001):
        at = SimpleNamespace(speed=ca.SX(miss), wanted=SimpleNamespace(speed=ca.SX(0.0)), length=1.0)
        found = float(ca.DM(term.misses(at)))
        assert 0.5 * found**2 == pytest.approx((large / 0.004) ** 2 * (np.hypot(1.0, miss / large) - 1.0))
        assert np.sign(found) == np.sign(miss)


def test_a_worm_twice_as_long_goes_twice_as_fast() -> None:
    one, two = FeedForward(FOUND, 1.0), FeedForward(FOUND, 2.0)
    for name in ("slowest", "fastest", "least_divisor"):
        assert getattr(two, name) == pytest.approx(2.0 * getattr(one, name))
    assert two(0.16, 0.02) == pytest.approx(one(0.08, 0.02))
    assert_allclose(two.reach(0.4), 2.0 * one.reach(0.8))
    assert [suited(0.16, FOUND, length) for length in (1.0, 2.0)] == ["steep", "sine"]
    assert suited(-0.16, FOUND, 1.0) == "steep"


def test_what_is_trusted_goes_with_the_length() -> None:
    """Lengths in proportion; the slope changes along the way as a random walk, whose unit is 1/sqrt(m)."""
    ground, doubled = GroundTrust(), GroundTrust().sized(4.0)
    assert (doubled.standing, doubled.stride) == pytest.approx((4.0 * ground.standing, 4.0 * ground.stride))
    assert (doubled.change, doubled.slope, doubled.height) == (ground.change / 2.0, ground.slope, ground.height)
    trust, longer = Uncertainty(), Uncertainty().sized(2.0)
    for name in ("place", "speed", "drift", "rocking"):
        assert getattr(longer, name) == 2.0 * getattr(trust, name)
    assert (longer.turn_rate, longer.com) == (trust.turn_rate, trust.com)


@pytest.mark.parametrize(("follows", "walled", "kept"), [(True, False, 1.0), (True, True, WALLED), (False, False, 0.0)])
def test_terms_of_a_path_weigh_where_there_is_one_and_the_arrival_weighs_at_the_end(
    follows: bool, walled: bool, kept: float
) -> None:
    """The arrival weighs as many steps of its size as L, the way in which an offset dies away, has of them."""
    none, far = np.zeros(3), np.full(3, np.inf)
    for way in (0.04, 0.16, -0.16):
        ways = np.full(3, way)
        ahead = Preview(none, np.zeros((3, 2)), none, follows, follows, 0.0, far, far, far, far, ways, walled)
        assert Offset().weight(ahead) == kept
        weights = np.asarray(Arrival(way=0.08).weight(ahead))
        assert_allclose(weights, [0.0, 0.0, kept * np.sqrt(0.08 / abs(way))])
        assert (Heading().weight(ahead), Steering().weight(ahead)) == (float(follows), float(not follows))
        assert (Speed().weight(ahead), Change().weight(ahead), Frequency().weight(ahead)) == (1.0, 1.0, 1.0)
    standing = Preview(none, np.zeros((3, 2)), none, follows, follows, 0.0, far, far, far, far, none, walled)
    assert np.isfinite(np.asarray(Arrival().weight(standing))).all()
