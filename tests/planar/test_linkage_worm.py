"""The worm's parameters: validation, masses, and the weight that flattens it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planar import linkage
from planar.linkage import Friction, LimitPointError, Linkage
from planar.status import Status


def still(segments: int):
    return lambda t: np.zeros(segments)


def test_mass_is_density_times_area_times_depth_and_is_shared() -> None:
    worm = Linkage(segments=4, density=20.0, depth=0.3, half_height=0.06, apex_mass_fraction=0.4)
    assert_allclose(worm.total_mass, 20.0 * 4 * (0.25 * 2 * 0.06 / 2) * 0.3)
    assert_allclose(worm.joint_mass.sum(), 0.6 * worm.total_mass)
    assert_allclose(worm.joint_mass, 0.6 * worm.total_mass / 4 * np.array([0.5, 1, 1, 1, 0.5]))
    assert_allclose(worm.apex_mass, np.full((4, 2), 0.4 * worm.total_mass / 8))
    assert_allclose(Linkage(mass=0.3).total_mass, 0.3)


def test_defaults_are_table_i() -> None:
    worm = Linkage()
    assert (worm.segments, worm.length, worm.density) == (6, 1.0, 10.0)
    assert_array_equal(worm.k_spring, np.full(6, 13.0))
    assert_array_equal(worm.k_torsion, np.full(5, 1e4))
    assert_array_equal(worm.k_apex, np.full(6, 0.12))
    assert_allclose(worm.half_height, np.sqrt(3) / 4 / 6)
    assert_allclose(worm.link_length**2, worm.rest_half_height**2 + (worm.l0 / 2) ** 2)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"segments": 0}, "segments: got 0, must be a whole number of at least 1"),
        ({"mass": -1.0}, "mass: got -1.0 kg, must be finite and above 0"),
        ({"k_spring": np.ones(5)}, r"k_spring: got 5 values, must be a number or 6 of them"),
        ({"k_torsion": np.ones(6)}, r"k_torsion: got 6 values, must be a number or 5 of them"),
        ({"k_torsion": -1.0}, "k_torsion: .* must be finite and at least 0"),
        ({"k_spring": float("nan")}, "k_spring: .* must be finite"),
        ({"cross0": 1.0}, "cross0: .* must be finite and in"),
        ({"apex_mass_fraction": 1.2}, "apex_mass_fraction: got 1.2, must be finite and in"),
    ],
)
def test_bad_worms(changes: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Linkage(**changes)


def test_arrays_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Linkage().k_spring[0] = 1.0


@pytest.mark.parametrize(("half_height", "mass"), [(0.05, 0.56), (np.sqrt(3) / 4 / 6, 1.48)])
def test_limit_point_is_where_the_equilibrium_ends(half_height: float, mass: float) -> None:
    """Six segments, k = 13 N: nothing above 0.56 kg for h0 = 0.05 m, above 1.48 kg for the paper's shape."""
    worm = Linkage(half_height=half_height, mass=mass, k_apex=0.0, k_torsion=10.0)
    assert_allclose(worm.flattening_weight() / worm.apex_load() * mass, mass, rtol=0.01)
    critical = float((worm.flattening_weight() / worm.apex_load()).min()) * mass
    heavy = worm.with_changes(mass=0.98 * critical)
    run = linkage.simulate(heavy, still(6), duration=0.5)
    assert run.status is Status.DONE
    with pytest.raises(LimitPointError, match=rf"pressed flat.*lighter than {critical:.3g} kg"):
        linkage.simulate(worm.with_changes(mass=1.02 * critical), still(6))


def test_flattened_by_a_load_during_the_run(default_worm: Linkage) -> None:
    push = np.zeros((7, 2))
    push[:, 1] = -1.5
    run = linkage.simulate(default_worm, still(6), duration=2.0, external_force=lambda t: push * min(1.0, t))
    assert run.status in (Status.FLATTENED, Status.SUNK)  # the joints come down with the rhombi
    assert 0.2 < run.stop.time < 2.0
    assert np.isfinite(run.joints).all()


def test_folded_and_sunk_are_named(default_worm: Linkage) -> None:
    soft = default_worm.with_changes(k_torsion=1e-3)
    run = linkage.simulate(soft, still(6), duration=5.0)
    assert run.status is Status.FOLDED
    assert run.joints.shape == (1, 7, 2)
    tilt = np.eye(6)[0]
    run = linkage.simulate(soft, lambda t: 0.2 * min(1.0, t) * tilt, duration=5.0, settle=False)
    assert run.status in (Status.FOLDED, Status.SUNK)
    assert run.stop.sentence.startswith(run.status.value)
    assert np.isfinite(run.joints).all()


def test_a_soft_segment_is_carried_by_its_stiff_neighbours(default_worm: Linkage) -> None:
    """Its share of the weight is above its limit point, but stiff joints put it on the others: no refusal."""
    k = np.full(6, 13.0)
    k[2] = 1.5
    run = linkage.simulate(default_worm.with_changes(k_spring=k, k_torsion=1e4), still(6), duration=1.0)
    assert run.status is Status.DONE
    assert (default_worm.with_changes(k_spring=k).flattening_weight() < default_worm.apex_load())[2]


def test_lengthening_lowers_the_limit_point(default_worm: Linkage) -> None:
    """At -0.1 the limit of 0.564 kg falls to 0.114 kg; a worm between the two is flattened, with its name."""
    per_mass = default_worm.apex_load() / default_worm.total_mass
    assert_allclose(default_worm.flattening_weight(-0.1) / per_mass, 0.114, atol=1e-3)
    run = linkage.simulate(default_worm.with_changes(mass=0.25), lambda t: np.full(6, -0.1 * min(1.0, t)), duration=2.0)
    assert run.status in (Status.FLATTENED, Status.SUNK)
    assert run.stop.time > 0.3


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"dt": 0.0}, "dt: got 0.0 s, must be finite and above 0"),
        ({"duration": -1.0}, "duration: got -1.0 s"),
        ({"ground": "ice"}, "ground: got 'ice', must be 'contact' or 'clamped'"),
        ({"friction_law": "none"}, "friction_law: got 'none', must be 'anchored' or 'threshold'"),
        ({"start": np.zeros((6, 2))}, r"start: got shape \(6, 2\), must be \(7, 2\)"),
        ({"start": np.zeros((7, 2))}, "start: segment 0 is 0 m long, must lie between 0 and 0.1944 m"),
        ({"start": Linkage().rest()}, r"start: an apex lies 0.05 m inside the ground z = 0; lift the worm"),
        ({"held": np.zeros((6, 2), dtype=bool)}, r"held: got shape \(6, 2\), must be \(7, 2\)"),
        ({"external_force": lambda t: np.zeros((6, 2))}, r"external_force: got shape \(6, 2\), must be \(7, 2\)"),
        ({"gravity": float("nan")}, "gravity: got nan, must be finite and at least 0"),
        ({"slope": 2.0}, "slope: got 2.0 rad, must be finite and in"),
        (
            {"ground": "clamped", "friction_law": "threshold"},
            "held and friction_law are for ground='contact' only",
        ),
        ({"friction": Friction(np.ones(5), 0.2)}, r"forward: got 5 values, must be a number or 6 of them"),
    ],
)
def test_bad_arguments(default_worm: Linkage, arguments: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        linkage.simulate(default_worm, still(6), **arguments)
    with pytest.raises(ValueError, match=r"gait: got shape \(5,\), must be \(6,\)"):
        linkage.simulate(default_worm, still(5))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"forward": -0.1}, r"forward: got -0.1, must be finite and in \[0, 1e\+12\]"),
        ({"static_ratio": 0.9}, "static_ratio: got 0.9, must be finite and at least 1"),
    ],
)
def test_bad_friction(arguments: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Friction(**arguments)
