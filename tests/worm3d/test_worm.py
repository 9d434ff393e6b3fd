"""The 3D worm's parameters are checked once, complete and read-only."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import TravellingWave
from planar.linkage import Linkage
from worm3d import Worm, flattening_weight


def test_defaults_are_the_default_worm() -> None:
    worm = Worm()
    assert (worm.segments, worm.length, worm.mass, worm.chamber_offset) == (6, 1.0, 0.1, 0.03)
    assert_array_equal(worm.k_spring, np.full(6, 13.0))
    assert_array_equal(worm.k_torsion, np.full(5, 10.0))
    assert_array_equal(worm.k_yaw, np.full(5, 0.5))
    assert (worm.kelvin_voigt_time, worm.actuator_lag, worm.stroke) == (0.05, 0.1, (-0.1, 0.45))


def test_masses_add_up_and_are_shared() -> None:
    worm = Worm(segments=4, mass=0.2, joint_mass_fraction=0.3)
    assert_allclose(worm.joint_mass, 0.06 / 4 * np.array([0.5, 1, 1, 1, 0.5]))
    assert_allclose(worm.apex_mass, np.full((4, 6), 0.14 / 24))
    assert_allclose(worm.joint_mass.sum() + worm.apex_mass.sum(), 0.2)


def test_rhombus_closes() -> None:
    worm = Worm(half_height=np.linspace(0.04, 0.06, 6))
    assert_allclose((2 * np.linspace(0.04, 0.06, 6)) ** 2 + worm.l0**2, (2 * worm.link_length) ** 2)


def test_arrays_are_copies_and_read_only() -> None:
    stiffness = np.full(6, 9.0)
    worm = Worm(k_spring=stiffness)
    stiffness[0] = 1.0
    assert worm.k_spring[0] == 9.0
    with pytest.raises(ValueError, match="read-only"):
        worm.k_spring[0] = 1.0


def test_a_gait_binds_to_it_and_keeps_its_stroke() -> None:
    command = TravellingWave(amplitude=0.4, bias=1.0, rectified=False).bind(Worm())(0.4)
    assert command.contraction.max() == 0.45
    assert command.contraction.min() == -0.1


def test_the_planar_worm_has_the_parameters_of_the_linkage() -> None:
    given = {"segments": 4, "k_torsion": 2.0, "k_apex": 0.3, "cross0": 0.1, "apex_mass_fraction": 0.4, "drag": 0.2}
    worm, linkage = Worm.planar(**given), Linkage(**given)
    assert worm.flat
    assert worm.mass == linkage.total_mass
    assert_allclose(worm.half_height, linkage.rest_half_height)
    assert_allclose(worm.link_length, linkage.link_length)
    assert_allclose(worm.joint_mass, linkage.joint_mass)
    below, above, outward = worm.apex_mass[:, [0, 3]], worm.apex_mass[:, [1, 4]], worm.apex_mass[:, [2, 5]]
    assert_allclose(np.column_stack([below.sum(axis=1), above.sum(axis=1)]), linkage.apex_mass)
    assert_array_equal(outward, 0.0)


def test_the_limit_point_is_that_of_the_linkage() -> None:
    given = {"segments": 5, "half_height": 0.05, "k_spring": 13.0, "k_apex": 0.05, "mass": 0.1}
    assert_allclose(flattening_weight(Worm.planar(**given)), Linkage(**given).flattening_weight(), rtol=1e-6)
    assert_allclose(flattening_weight(Worm.planar(**given), 0.2), Linkage(**given).flattening_weight(0.2), rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"flat": True}, "chamber_offset: got 0.03, must be 0 in a worm that is flat"),
        ({"segments": 2.5}, "segments: got 2.5, must be a whole number of at least 1"),
        ({"mass": 0.0}, "mass: got 0.0 kg, must be finite and above 0"),
        ({"k_spring": np.ones(5)}, r"k_spring: got 5 values, must be a number or 6 of them"),
        ({"k_yaw": np.ones(6)}, r"k_yaw: got 6 values, must be a number or 5 of them"),
        ({"k_twist": -1.0}, "k_twist: .* must be finite and at least 0"),
        ({"half_height": float("nan")}, "half_height: .* must be finite"),
        ({"joint_mass_fraction": 1.1}, r"joint_mass_fraction: got 1.1, must be finite and in \[0, 1\]"),
        ({"cross0": 1.0}, r"cross0: got .*, every value must be finite and in \(-1, 1\)"),
        ({"stroke": (0.1, 0.4)}, r"stroke: got \(0.1, 0.4\), must be .* c_min <= 0 <= c_max < 1"),
        ({"rate_limit": 0.0}, "rate_limit: got 0.0 1/s, must be above 0"),
        ({"actuator_lag": float("inf")}, "actuator_lag: got inf s, must be finite"),
    ],
)
def test_bad_worms(changes: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Worm(**changes)
