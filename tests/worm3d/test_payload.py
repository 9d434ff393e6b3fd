"""A mass on the head's joint: where the worm's mass is, and what that does, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d import Command, Plane, Worm, simulate


def test_it_is_part_of_the_mass() -> None:
    worm = Worm(segments=4, mass=0.2, payload=0.05, joint_mass_fraction=0.4)
    assert_allclose(worm.joint_mass, 0.06 / 4 * np.array([0.5, 1, 1, 1, 0.5]) + [0, 0, 0, 0, 0.05])
    assert_allclose(worm.joint_mass.sum() + worm.apex_mass.sum(), 0.2)


@pytest.mark.parametrize("payload", [0.0, 0.02, 0.08])
def test_the_ends_of_a_floating_segment_move_as_their_masses_say(payload: float) -> None:
    """Nothing acts from outside, so the tail moves by m_head/m of the shortening, the head back by m_tail/m."""
    worm = Worm(segments=1, joint_mass_fraction=1.0, payload=payload)
    run = simulate(worm, None, actuation=lambda t: Command(np.full((1, 2), 0.2)), duration=2.0, gravity=(0, 0, 0))
    moved = run.joints[-1, :, 0] - run.joints[0, :, 0]
    shorter = moved[0] - moved[1]
    assert shorter > 0.1
    tail, head = worm.joint_mass
    assert_allclose(moved, np.array([head, -tail]) / worm.mass * shorter, rtol=1e-9)


@pytest.mark.parametrize("payload", [0.0, 0.03])
def test_loads_at_rest_carry_it_where_it_is(payload: float) -> None:
    """Forces and moments balance about the centre of mass, which is where the masses put it."""
    worm = Worm(payload=payload)
    run = simulate(worm, Plane(), duration=0.02)
    force, place = (getattr(run, name)[-1].reshape(-1, 3) for name in ("contact_force", "points"))
    moment = np.cross(place, force).sum(axis=0)
    assert_allclose(force[:, 2].sum(), 9.81 * worm.mass, rtol=1e-9)
    assert_allclose(moment[1], -9.81 * worm.mass * run.com[-1, 0], rtol=1e-9)
    tail, head = run.joints[-1, [0, -1], 0]  # the weight lengthens the worm by 7 mm
    centre = ((worm.mass - payload) * 0.5 + payload * 1.0) / worm.mass
    assert_allclose((run.com[-1, 0] - tail) / (head - tail), centre, atol=1e-3)


def test_it_is_less_than_the_mass() -> None:
    with pytest.raises(ValueError, match=r"payload: got 0\.1 kg, must be below mass \(0\.1 kg\)"):
        Worm(payload=0.1)


def test_a_planar_worm_has_it_too() -> None:
    bare, loaded = Worm.planar(mass=0.1), Worm.planar(mass=0.1, payload=0.02)
    assert_allclose(loaded.joint_mass[-1], 0.8 * bare.joint_mass[-1] + 0.02, rtol=1e-14)
    assert_allclose(loaded.joint_mass.sum() + loaded.apex_mass.sum(), 0.1, rtol=1e-14)
