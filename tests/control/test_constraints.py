"""Soft constraints of a plan: what they call an excess."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.planning.constraints import Clearance, Corridor, Roll


@pytest.mark.parametrize(("offset", "excess"), [(0.14, (2.0, -17.0)), (-0.24, (-17.0, 2.0)), (0.0, (-5.0, -10.0))])
def test_a_corridor_is_exceeded_to_its_left_and_to_its_right(offset: float, excess: tuple[float, float]) -> None:
    at = SimpleNamespace(offset=ca.SX(offset), wanted=SimpleNamespace(left=0.1, right=0.2), length=2.0)
    assert_allclose(np.array(ca.DM(Corridor(tolerance=0.01).excesses(at))).ravel(), excess, rtol=1e-12)


@pytest.mark.parametrize(("roll", "excess"), [(0.145, 2.0), (0.085, -1.0)])
def test_a_roll_beyond_its_limit_is_an_excess(roll: float, excess: float) -> None:
    at = SimpleNamespace(roll=ca.SX(roll))
    assert float(ca.DM(Roll(limit=0.105, tolerance=0.02).excesses(at))) == pytest.approx(excess)


@pytest.mark.parametrize("turn", [0.3, -0.3])
def test_both_ends_of_a_body_count_as_near_what_is_beside_it(turn: float) -> None:
    """Ends of a body of 2 m that is turned by 0.3 rad are sin 0.3 to either side of its middle, at 0.1 m."""
    wanted = SimpleNamespace(room_left=0.2, room_right=0.3, heading=1.0)
    at = SimpleNamespace(offset=ca.SX(0.1), wanted=wanted, length=2.0, state=SimpleNamespace(heading=1.0 + turn))
    head, tail = 0.1 + np.sin(turn), 0.1 - np.sin(turn)
    excess = np.array([head - 0.2, tail - 0.2, -head - 0.3, -tail - 0.3]) / (0.01 * 2.0)
    assert_allclose(np.array(ca.DM(Clearance(tolerance=0.01).excesses(at))).ravel(), excess, rtol=1e-12)
